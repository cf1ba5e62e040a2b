"""Node distances against node positions: the figures of S&K, and what lies beyond them."""

from tensegrity_codegen.studies.papers.sk.drift import measure_constraint_drift
from tensegrity_codegen.studies.papers.sk.inverse_time import compare_inverse_times
from tensegrity_codegen.studies.papers.sk.offset_error import (
    compare_offset_trajectories,
    compare_offsets,
)
from tensegrity_codegen.studies.papers.sk.sample import sample_prism, sample_structure
from tensegrity_codegen.studies.papers.sk.stored_numbers import (
    compare_stored_numbers,
    count_stored_numbers,
    find_difference_pattern,
)
from tensegrity_codegen.studies.papers.sk.trajectory_difference import compare_trajectories

__all__ = [
    "compare_inverse_times",
    "compare_offset_trajectories",
    "compare_offsets",
    "compare_stored_numbers",
    "compare_trajectories",
    "count_stored_numbers",
    "find_difference_pattern",
    "measure_constraint_drift",
    "sample_prism",
    "sample_structure",
]
