"""How the examples are built and run, and the numbers that Python computes for the same structures."""
