"""What is true: member laws, geometry and formulations as CasADi expressions."""
