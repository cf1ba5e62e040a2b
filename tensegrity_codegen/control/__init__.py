"""Planning, timed motions, feedback, controllers in C, and their pages."""
