"""The prism of three bars under load: the tables of LIN, its largest load, and what they depend on."""

from tensegrity_codegen.studies.papers.lin.errata import check_errata
from tensegrity_codegen.studies.papers.lin.events import (
    find_load_events,
    follow_load,
    reach_load,
    survey_directions,
)
from tensegrity_codegen.studies.papers.lin.model import compile_prism
from tensegrity_codegen.studies.papers.lin.sensitivity import compare_sensitivity
from tensegrity_codegen.studies.papers.lin.stiffness import compare_stiffness
from tensegrity_codegen.studies.papers.lin.tables import compare_tables, compare_unloaded, read_tables
from tensegrity_codegen.studies.papers.lin.work import compare_work

__all__ = [
    "check_errata",
    "compare_sensitivity",
    "compare_stiffness",
    "compare_tables",
    "compare_unloaded",
    "compare_work",
    "compile_prism",
    "find_load_events",
    "follow_load",
    "reach_load",
    "read_tables",
    "survey_directions",
]
