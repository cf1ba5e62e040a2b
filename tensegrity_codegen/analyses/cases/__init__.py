"""Cases of an analysis: their arguments, statuses, and what is kept of each."""
