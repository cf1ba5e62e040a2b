"""Inputs over time: tables of knots, their piecewise polynomials, and the arguments that they change."""
