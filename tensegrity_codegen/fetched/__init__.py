"""Files of other projects that are used and not part of this package: fetched once and verified."""

__all__: list[str] = []
