"""Pages of plans and of feedback."""

__all__: list[str] = []
