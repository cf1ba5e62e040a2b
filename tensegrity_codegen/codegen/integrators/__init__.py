"""C text of integrators, event search and the equilibrium solver."""
