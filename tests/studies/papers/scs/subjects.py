"""The paper's tower and changed ones, for the tests of its studies."""

import math
from functools import cache

import numpy as np
from hypothesis import strategies as st

from tensegrity_codegen.studies.papers.scs.figures import load_paper_tower, plan_paper_motions
from tensegrity_codegen.studies.papers.scs.reconfiguration import Reconfiguration
from tensegrity_codegen.studies.papers.scs.symmetry import SymmetricPose, SymmetricTower

pose = SymmetricPose.from_degrees


@cache
def tower() -> SymmetricTower:
    return load_paper_tower()


@cache
def motions() -> dict[str, Reconfiguration]:
    return plan_paper_motions(tower())


def paper_motion(name: str) -> Reconfiguration:
    return motions()[name]


def angles() -> st.SearchStrategy[np.ndarray]:
    """s = (alpha, delta, Z) inside the bounds of SCS 4."""
    return st.tuples(
        st.floats(0.0, 2 * math.pi), st.floats(0.05, 1.5), st.floats(1.05, 2.5)
    ).map(np.array)  # fmt: skip


def rates() -> st.SearchStrategy[np.ndarray]:
    """s' or s'' at constant height."""
    return st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)).map(lambda pair: np.array([*pair, 0.0]))
