"""Results that several rooms read: plans and timed motions."""

__all__: list[str] = []
