"""Sensitivities of equilibria: how nodes and tensions follow changes of rest lengths."""
