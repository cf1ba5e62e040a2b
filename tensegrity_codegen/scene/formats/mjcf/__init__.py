"""Reading models of MuJoCo (MJCF)."""

__all__: list[str] = []
