"""Loops over repeated modules, equal members side by side."""
