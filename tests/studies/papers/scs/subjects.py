"""The paper's tower and changed ones, for the tests of its studies."""

import math
from functools import cache

import numpy as np
from hypothesis import strategies as st

from tensegrity_codegen.studies.papers.scs.figures import load_paper_tower, plan_paper_motions
from tensegrity_codegen.studies.papers.scs.printed import SIXTY, THIRTY, PrintedTower
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


def determinant_condition(printed: PrintedTower, alpha: float, delta: float, height: float) -> float:
    """Return the left side of SCS (42) [m2], zero where det(A_r) is."""
    l, b, cosine = printed.length, printed.side, math.cos(delta)  # noqa: E741, as in the paper
    u = math.sin(delta) * math.cos(alpha + THIRTY)
    linear = (3 * l * u + b / math.sqrt(3.0)) * cosine
    return height**2 * u - height * linear + (3 * l * u + math.sqrt(3.0) / 2 * b) * l * cosine**2


def torque_free(printed: PrintedTower, alpha: float, delta: float, start: SymmetricPose) -> float:
    """Return f(alpha, delta) of SCS (49) [kg m2], zero on motions without torque from the start."""
    coupling = printed.bar_moment * printed.side / math.sqrt(3.0)
    turned = math.sin(delta) * math.cos(alpha + SIXTY) - math.sin(start.delta) * math.cos(start.alpha + SIXTY)
    spin = 3 * printed.bar_inertia * math.sin(alpha - start.alpha) * math.sin(delta) * math.sin(start.delta)
    return spin + coupling * turned
