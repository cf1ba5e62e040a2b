"""Linear models about a state, natural frequencies and damping ratios."""
