"""Functional mock-up units: what is inside, in C and in XML."""
