"""The progress of a part of a longer piece of work."""

from collections.abc import Callable

ProgressFunction = Callable[[float], None]


def part_of(progress: ProgressFunction | None, start: float, share: float) -> ProgressFunction | None:
    """Return the progress of a part that begins at the fraction `start` and has `share` of the whole."""
    if progress is None:
        return None
    return lambda fraction: progress(start + share * fraction)
