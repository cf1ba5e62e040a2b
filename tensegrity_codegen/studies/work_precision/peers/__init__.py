"""Other integrators over the same structure, where they are installed: one file each."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from tensegrity_codegen.studies.work_precision.contender import Contender
from tensegrity_codegen.studies.work_precision.peers import mujoco_tendons, scipy_ivp, sundials
from tensegrity_codegen.studies.work_precision.problem import MotionProblem

__all__ = ["peer_contenders"]


def peer_contenders(problem: MotionProblem) -> Iterator[tuple[str, Callable[[], Contender]]]:
    """Yield name and maker of each peer; makers raise Unavailable where it is not installed or not able."""
    for peer in (mujoco_tendons, sundials, scipy_ivp):
        yield from peer.contenders(problem)
