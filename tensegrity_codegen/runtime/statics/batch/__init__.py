"""Equilibria of many cases of one structure: loads, parameters and starts."""

__all__: list[str] = []
