"""Quantities and motions as functions with derivatives forward and backward, for JAX and PyTorch."""
