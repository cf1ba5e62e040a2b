"""Three papers computed by the general models: studies, chapters, figures and errata."""

__all__: list[str] = []
