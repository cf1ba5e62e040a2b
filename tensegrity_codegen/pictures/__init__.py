"""Pictures and live pages of structures and motions, for scripts and notebooks."""

__all__: list[str] = []
