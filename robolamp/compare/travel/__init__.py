"""How far a lamp came, and in which hops, by what is known of it."""
