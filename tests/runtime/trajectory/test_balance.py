"""The energy balance of motions: what is rounding, and what is a fault."""

import numpy as np
import pytest

from tensegrity_codegen.runtime.trajectory.evaluate import balance_energy

TIME = np.linspace(0.0, 1.0, 5)
NOISE = np.array([0.0, 3e-27, 1e-28, 2e-27, 1e-26])  # [J], of a structure of 20 m that nothing moves


def ends(coordinate: np.ndarray, kinetic: np.ndarray, total: np.ndarray) -> str:
    return balance_energy(kinetic, total, coordinate).judge((), TIME, True, False, "")[0]


def test_energies_of_a_structure_at_rest_are_rounding() -> None:
    at_rest = np.full((5, 3), 20.0)
    at_rest[1:, 0] += 3.6e-15
    assert ends(at_rest, NOISE / 3, NOISE) == "ok"
    assert balance_energy(NOISE / 3, NOISE, at_rest).drift == 0.0


def test_rounding_that_moves_rigid_bodies_is_no_motion() -> None:
    """As measured: 30 nodes on rigid bars, 70 m, at rest with cables at their rest lengths."""
    at_rest = 70.0 + 6.8e-12 * np.sin(TIME)[:, None] * np.ones(3)
    total = np.array([0.0, 4.9e-25, 2.0e-20, 1.1e-19, 8.0e-20])
    assert ends(at_rest, 0.3 * total, total) == "ok"


@pytest.mark.parametrize("scale", [1e-9, 1.0])
def test_energy_that_grows_while_something_moves_is_a_fault(scale: float) -> None:
    moving = 20.0 + scale * np.sin(TIME)[:, None] * np.ones(3)
    assert ends(moving, NOISE / 3, NOISE) == "unstable"
    assert ends(moving, NOISE / 3, -NOISE) == "inaccurate"


def test_each_motion_of_a_batch_is_judged_by_itself() -> None:
    still, moving = np.full((5, 3), 20.0), 20.0 + np.outer(TIME, np.ones(3))
    balance = balance_energy(
        np.array([NOISE, NOISE]) / 3, np.array([NOISE, NOISE]), np.array([still, moving])
    )
    assert [balance.judge(k, TIME, True, False, "")[0] for k in (0, 1)] == ["ok", "unstable"]
