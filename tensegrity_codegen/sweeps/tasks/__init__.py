"""What is computed for a chunk of cases with one library: one file an operation."""
