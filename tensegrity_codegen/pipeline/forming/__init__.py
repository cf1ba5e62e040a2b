"""Shapes in balance: what is stated of members, and the shape that has it."""
