"""The chapter on LIN: the prism under load, its tables and Fig. 4, and the largest load."""

from functools import partial

from tensegrity_codegen.report.pages.page import Chapter
from tensegrity_codegen.studies.papers.chapter_progress import build_sections, run_study
from tensegrity_codegen.studies.papers.lin.lin_events import maximum_section
from tensegrity_codegen.studies.papers.lin.lin_stiffness import stiffness_section
from tensegrity_codegen.studies.papers.lin.lin_tables import (
    error_section,
    extension_section,
    figure_section,
    measured_section,
    unloaded_section,
)
from tensegrity_codegen.studies.papers.lin.stiffness import FACTORS
from tensegrity_codegen.studies.papers.lin.tables import compare_tables
from tensegrity_codegen.system.journal import Journal
from tensegrity_codegen.system.progress import ProgressFunction

QUICK_FACTORS = (0.5, 1.0, 2.0)


def build_lin_chapter(
    quick: bool = False, progress: ProgressFunction | None = None, journal: Journal | None = None
) -> Chapter:
    """Return the chapter; quick: fewer spring constants and directions of load. Raises what studies raise."""
    data = run_study("LIN Tables 1 to 3", compare_tables)
    steps = (
        ("LIN Table 1", 0.5, partial(measured_section, data)),
        ("LIN Table 2", 0.5, partial(extension_section, data)),
        ("LIN without load", 1.0, unloaded_section),
        ("LIN Table 3", 0.5, partial(error_section, data)),
        ("LIN Fig. 4", 1.0, partial(figure_section, data)),
        ("LIN spring constants", 3.0, partial(stiffness_section, QUICK_FACTORS if quick else FACTORS)),
        ("LIN largest load", 3.0, partial(maximum_section, quick)),
    )
    return Chapter(
        "lin",
        "LIN",
        "a three-bar prism under load",
        "Min Lin, Tuanjie Li, Zhifei Ji, Mingkui Che: Force-Displacement Relationships of a Tensegrity "
        "Structure Considering Bar Interference.",
        build_sections(steps, progress, journal),
    )
