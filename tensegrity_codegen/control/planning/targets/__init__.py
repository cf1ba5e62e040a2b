"""Targets of plans: their texts, shape parameters, values and derivatives."""
