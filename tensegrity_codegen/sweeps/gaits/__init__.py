"""Gaits of structures that roll from facet to facet on the ground."""
