"""Parts of the design of feedback: linear models along a motion, Riccati equations, checks."""
