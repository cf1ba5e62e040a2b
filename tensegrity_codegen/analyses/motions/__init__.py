"""Motions of the analysis `simulate`: one, many starts of a file, and results over time in a sweep."""
