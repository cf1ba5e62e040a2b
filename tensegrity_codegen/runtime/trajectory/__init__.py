"""Sampled motions: states, derived quantities, and files of them."""
