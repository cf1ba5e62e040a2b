"""Loops over members: index tables, kernels, and the writer of their C text."""
