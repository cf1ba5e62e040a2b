"""The progress of a chapter whose sections take unequal times."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from tensegrity_codegen.errors import TensegrityError
from tensegrity_codegen.report.page import Section

__all__ = ["ProgressFunction", "Step", "build_sections"]

ProgressFunction = Callable[[float], None]
# Name of the study, its share of the time, and what computes its section.
Step = tuple[str, float, Callable[[], Section]]


def build_sections(steps: Sequence[Step], progress: ProgressFunction | None = None) -> tuple[Section, ...]:
    """Return the sections of the steps in their order; `progress` is called with the fraction done.

    An error of a study names the study in its place.
    """
    total = sum(share for _, share, _ in steps)
    done, sections = 0.0, []
    for name, share, build in steps:
        try:
            sections.append(build())
        except TensegrityError as error:
            error.where = f"study {name}" + (f": {error.where}" if error.where else "")
            raise
        done += share
        if progress is not None:
            progress(min(done / total, 1.0))
    return tuple(sections)
