"""Three papers computed by the general models: studies, chapters, figures and errata."""
