"""Member laws, geometry and formulations as CasADi expressions."""
