"""Explicit Runge-Kutta methods: their coefficients, by themselves."""
