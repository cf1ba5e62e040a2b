"""Equilibria of many cases of one structure: loads, parameters and starts."""
