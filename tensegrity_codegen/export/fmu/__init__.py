"""Functional mock-up units: what is inside, in C and in XML."""

__all__: list[str] = []
