"""Registered laws, quantities, formulations, tableaus, integrators, targets; request and manifest."""
