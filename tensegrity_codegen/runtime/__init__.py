"""Compiled models and the analyses made with them; imports no casadi."""
