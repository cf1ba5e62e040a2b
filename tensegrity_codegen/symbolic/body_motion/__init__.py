"""Bodies in motion: their arguments, velocities and Lagrange equations."""
