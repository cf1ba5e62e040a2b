"""The sections of a chapter one after the other: their progress, and those that are finished already."""

from collections.abc import Callable, Sequence
from typing import TypeVar

from tensegrity_codegen.report.pages.page import Section
from tensegrity_codegen.report.pages.page_json import read_section, section_as_json
from tensegrity_codegen.system.errors import TensegrityError
from tensegrity_codegen.system.journal import Journal
from tensegrity_codegen.system.progress import ProgressFunction

Result = TypeVar("Result")
# Name of the study, its share of the time, and what computes its section.
Step = tuple[str, float, Callable[[], Section]]


def build_sections(
    steps: Sequence[Step], progress: ProgressFunction | None = None, journal: Journal | None = None
) -> tuple[Section, ...]:
    """Return the sections of the steps in their order; `progress` is called with the fraction done.

    Sections that the journal has are taken from there; others are kept in it as soon as they are built.
    """
    journal = journal or Journal(None)
    sections = {name: read_section(journal.find(name)) for name, _, _ in steps}
    kept = [name for name, section in sections.items() if section is not None]
    journal.announce(steps[0][0].split()[0], "sections", len(kept), len(steps))
    total = sum(share for _, share, _ in steps)
    done = sum(share for name, share, _ in steps if name in kept)
    if progress is not None:
        progress(min(done / total, 1.0))
    for name, share, build in steps:
        if sections[name] is not None:
            continue
        sections[name] = section = run_study(name, build)
        journal.store(name, section_as_json(section))
        done += share
        if progress is not None:
            progress(min(done / total, 1.0))
    return tuple(section for section in sections.values() if section is not None)


def run_study(name: str, build: Callable[[], Result]) -> Result:
    """Return what `build` returns; the place of an error starts with the study's name."""
    try:
        return build()
    except TensegrityError as error:
        error.where = f"study {name}" + (f": {error.where}" if error.where else "")
        raise
