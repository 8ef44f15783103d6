"""Studies: many runs, and which of the papers' claims they agree with."""
