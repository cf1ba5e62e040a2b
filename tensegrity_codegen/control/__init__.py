"""Planning, timed motions, feedback, controllers in C, and their pages."""

__all__: list[str] = []
