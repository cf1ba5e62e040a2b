"""Functional mock-up units: their content, in C and in XML."""
