"""What all results share: values by name, short texts."""

__all__: list[str] = []
