"""Checks of scene values, and warnings of odd ones."""
