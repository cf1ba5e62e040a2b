"""Which disturbance forces measurements tell apart."""

import numpy as np
import pytest
from scipy.linalg import expm

from tensegrity_codegen.control.feedback.design.estimator import Estimator
from tensegrity_codegen.control.feedback.design.shown_forces import find_shown_forces
from tensegrity_codegen.control.feedback.kalman import design_kalman
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.structure.actuators import Sensor

FEW = (Sensor("member_length", (3, 4, 5), 1e-3),)


def chain(stiffness: float) -> np.ndarray:
    """Return the rates of two masses, each on a spring, coupled by another; forces on both."""
    rate = np.zeros((6, 6))
    rate[:2, 2:4] = np.eye(2)
    rate[2:4, :2] = -np.array([[1 + stiffness, -stiffness], [-stiffness, 1 + stiffness]])
    rate[2:4, 2:4], rate[2:4, 4:] = -0.5 * np.eye(2), np.eye(2)
    return rate


@pytest.mark.parametrize(
    ("stiffness", "rows", "shown"),
    [
        (1.0, [0, 1], [0, 1]),  # both positions measured
        (1.0, [0], [0]),  # one measurement: the force that it shows best
        (1.0, [1], [1]),
        (1e5, [0, 1], 1),  # as rigid as one body: one force
    ],
)
def test_as_many_forces_as_measurements_tell_apart(
    stiffness: float, rows: list[int], shown: list[int] | int
) -> None:
    slope = np.eye(6)[rows]
    found = find_shown_forces(
        expm(0.01 * chain(stiffness)), slope, np.full(len(rows), 1e-3), np.ones(2), 0.01
    ).tolist()
    assert len(found) == shown if isinstance(shown, int) else found == shown


def test_larger_forces_are_preferred() -> None:
    at = expm(0.01 * chain(1.0))
    assert find_shown_forces(at, np.eye(6)[:1], np.ones(1), np.array([0.1, 10.0]), 0.01).tolist() == [1]


def test_a_filter_of_few_sensors_estimates_few_forces(model: CompiledModel, motion: Motion) -> None:
    found = design_kalman(model, motion, FEW, only_observable=True, knots=2)
    assert len(found.disturbed) == 3
    assert np.abs(found.E).max() < 1.0


def test_nothing_is_left_out_where_all_forces_are_shown(model: CompiledModel, motion: Motion) -> None:
    whole: Estimator = design_kalman(model, motion, knots=2)
    again = design_kalman(model, motion, only_observable=True, knots=2)
    assert again.disturbed.tolist() == whole.disturbed.tolist()
    np.testing.assert_array_equal(again.L, whole.L)
    none = design_kalman(model, motion, FEW, disturbance=0.0, only_observable=True, knots=2)
    assert len(none.disturbed) == 0
