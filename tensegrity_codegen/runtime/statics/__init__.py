"""Static equilibrium: energy minimisation with springs, rigid bars and bodies."""
