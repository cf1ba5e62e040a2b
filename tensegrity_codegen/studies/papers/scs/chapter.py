"""The chapter on SCS: the two-stage tower, its equilibria, its reconfigurations and where it can stand."""

from functools import partial

from tensegrity_codegen.report.pages.page import Chapter
from tensegrity_codegen.studies.papers.chapter_progress import Step, build_sections, run_study
from tensegrity_codegen.studies.papers.scs.figures import compute_figures, load_paper_tower
from tensegrity_codegen.studies.papers.scs.scs_equilibria import equilibrium_section, formula_section
from tensegrity_codegen.studies.papers.scs.scs_map import map_section
from tensegrity_codegen.studies.papers.scs.scs_motion import motion_sections
from tensegrity_codegen.studies.papers.scs.scs_tracking import tracking_section
from tensegrity_codegen.system.journal import Journal
from tensegrity_codegen.system.progress import ProgressFunction

# Degrees between two points of the maps.
FULL_STEP, QUICK_STEP = 0.5, 3.0


def build_scs_chapter(
    quick: bool = False, progress: ProgressFunction | None = None, journal: Journal | None = None
) -> Chapter:
    """Return the chapter; quick: coarser maps and looser integration. Raises what the studies raise."""
    tower = run_study("SCS tower", load_paper_tower)
    figures = run_study("SCS Figs. 4 to 11", partial(compute_figures, tower))
    steps: tuple[Step, ...] = (
        ("SCS (44), (45), (52), (53)", 2.0, partial(equilibrium_section, tower)),
        *((f"SCS {figure}", 0.3, build) for figure, build in motion_sections(figures)),
        ("SCS tracking", 20.0, partial(tracking_section, tower, quick)),
        ("SCS maps", 2.0, partial(map_section, tower, QUICK_STEP if quick else FULL_STEP)),
        ("SCS formulas", 2.0, partial(formula_section, tower)),
    )
    return Chapter(
        "scs",
        "SCS",
        "a two-stage tower that changes its shape",
        "Symmetrical reconfiguration of tensegrity structures. Elsevier Science, 2002.",
        build_sections(steps, progress, journal),
    )
