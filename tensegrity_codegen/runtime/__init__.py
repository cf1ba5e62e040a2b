"""What is run: compiled models and the analyses made with them; imports no casadi."""
