"""Error against run time: every formulation and method that a scene allows, beside installed peers."""
