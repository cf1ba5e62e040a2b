"""Checks of scene values, and warnings of what looks odd."""
