"""The chapter on S&K: node distances as coordinates, its Figs. 2 to 5 and what lies beyond them."""

from dataclasses import dataclass
from functools import partial

from tensegrity_codegen.report.pages.page import Chapter
from tensegrity_codegen.studies.papers.chapter_progress import build_sections
from tensegrity_codegen.studies.papers.sk.sk_inverse import inverse_section
from tensegrity_codegen.studies.papers.sk.sk_motion import drift_section, trajectory_section
from tensegrity_codegen.studies.papers.sk.sk_offset import offset_section
from tensegrity_codegen.studies.papers.sk.sk_storage import pattern_section, storage_section
from tensegrity_codegen.system.journal import Journal
from tensegrity_codegen.system.progress import ProgressFunction


@dataclass(frozen=True)
class SkSizes:
    """How large the studies are: numbers of nodes in Figs. 2 and 4, and simulated times [s]."""

    inverse_nodes: tuple[int, ...]
    storage_nodes: tuple[int, ...]
    motion_time: float
    drift_time: float


FULL = SkSizes(tuple(range(6, 25, 2)), tuple(range(6, 31, 2)), 2.0, 1000.0)
QUICK = SkSizes((6, 8, 10), (6, 8, 10), 0.2, 10.0)


def build_sk_chapter(
    quick: bool = False, progress: ProgressFunction | None = None, journal: Journal | None = None
) -> Chapter:
    """Return the chapter, in full or in small sizes; raises what the studies raise, with the study's name."""
    sizes = QUICK if quick else FULL
    steps = (
        ("S&K Fig. 2", 6.0, partial(inverse_section, sizes.inverse_nodes)),
        ("S&K Fig. 3", 0.2, pattern_section),
        ("S&K Fig. 4", 1.0, partial(storage_section, sizes.storage_nodes)),
        ("S&K Fig. 5", 3.0, partial(trajectory_section, sizes.motion_time)),
        ("S&K invariant", 1.0, partial(drift_section, sizes.drift_time)),
        ("S&K offsets", 2.0, offset_section),
    )
    return Chapter(
        "sk",
        "S&K",
        "node distances as coordinates",
        "S. I. Savin, R. R. Khusainov: Sparse Node-Distance Coordinate Representation for Tensegrity "
        "Structures. Russian Journal of Nonlinear Dynamics 18 (2022) 5, 885–898.",
        build_sections(steps, progress, journal),
    )
