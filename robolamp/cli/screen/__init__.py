"""What verbs show on a terminal and take from it."""
