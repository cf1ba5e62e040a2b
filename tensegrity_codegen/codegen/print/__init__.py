"""Expressions printed as C: scalar, in vector registers, and through templates."""
