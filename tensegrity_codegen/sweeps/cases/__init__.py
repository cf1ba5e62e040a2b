"""The cases of a sweep: grids of ranges, samples of distributions, rows of a table."""
