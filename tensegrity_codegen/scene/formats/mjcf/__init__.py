"""Reading models of MuJoCo (MJCF)."""
