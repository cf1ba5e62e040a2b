"""From a checked scene to a structure or a system of bodies."""
