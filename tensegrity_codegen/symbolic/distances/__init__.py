"""Node distances as coordinates: pairs, cycles, constraints and inertia."""
