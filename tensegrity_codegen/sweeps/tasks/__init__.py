"""Tasks: the results of a chunk of cases with one library, one file an operation."""
