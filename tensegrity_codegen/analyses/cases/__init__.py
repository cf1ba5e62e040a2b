"""Cases of an analysis: their arguments, statuses and stored results."""
