"""Disturbance forces of an estimator that are as large as noise of the sensors permits."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import (
    ControlStudy,
    Tuning,
    choose_weights,
    design_kalman,
    design_lqr,
    study_control,
)
from tensegrity_codegen.control.feedback.design.estimator import Estimator
from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.design.usual_forces import UNKNOWN, find_usual_forces
from tensegrity_codegen.control.feedback.study.calm_estimator import (
    design_calm_estimator,
    predict_displacement,
)
from tensegrity_codegen.control.feedback.study.linear_loop import build_linear_loop
from tensegrity_codegen.control.feedback.study.scales import find_scales
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion


def test_the_pinned_prism_keeps_the_default(model: CompiledModel, motion: Motion, gains: Gains) -> None:
    scales = find_scales(model, motion, {})
    usual = design_kalman(model, motion, sample=0.005)
    found, warning = design_calm_estimator(model, motion, gains, scales)
    assert warning is None
    np.testing.assert_array_equal(found.L, usual.L)
    assert 0 < predict_displacement(found, scales) < 0.005 * scales.size


@pytest.mark.parametrize("part", [0.95, 1e-4])
def test_forces_are_divided_until_noise_moves_nodes_little(
    model: CompiledModel, motion: Motion, gains: Gains, part: float
) -> None:
    """With a size that is smaller than the true one, the same noise is too much; three divisions at most."""
    scales = find_scales(model, motion, {})
    usual = design_kalman(model, motion, sample=0.005)
    small = replace(scales, size=part * predict_displacement(usual, scales) / 0.005)
    found, warning = design_calm_estimator(model, motion, gains, small)
    assert warning is not None
    divisor = int(warning.split("Divided by ")[1].split(", to")[0].replace(",", ""))
    assert divisor in (10, 100, 1000)
    forces = UNKNOWN * find_usual_forces(model, motion, {}) / divisor
    expected = design_kalman(model, motion, sample=0.005, disturbance=forces)
    np.testing.assert_allclose(found.L, expected.L, rtol=1e-9, atol=1e-12)
    assert predict_displacement(found, scales) < predict_displacement(usual, scales)
    left = predict_displacement(found, scales) / (0.005 * small.size)
    assert left <= 0.25 or divisor == 1000
    assert f"{1000 * predict_displacement(found, scales):.3g} mm" in warning
    assert "`disturbance`" in warning


def make_strong(model: CompiledModel, motion: Motion) -> tuple[Tuning, Gains]:
    """Return weights that accept five times the effort of the default."""
    usual = choose_weights(model, motion)
    tuning = choose_weights(model, motion, effort=5.0 * float(usual.effort[0]))
    names = model.manifest.coordinate_name
    return tuning, design_lqr(model, motion, tuning.Q, tuning.R, integral_action=names)


def test_strong_gains_take_smaller_forces_by_the_covariance_of_the_loop(
    model: CompiledModel, motion: Motion
) -> None:
    tuning, gains = make_strong(model, motion)
    usual = design_kalman(model, motion, sample=0.005)
    found, warning = design_calm_estimator(model, motion, gains, tuning.scales)
    assert warning is not None
    assert "Divided by 10," in warning

    def shake(estimator: Estimator) -> float:
        return float(build_linear_loop(model, motion, gains, gains.delay, estimator, {}).deviation().max())

    assert shake(found) < 0.65 * shake(usual)
    slowest = -0.005 / np.log(np.abs(found.E).max())
    assert slowest < 0.5  # [s], a fifth of the time until errors are compared


@pytest.mark.thorough
def test_smaller_forces_hold_the_prism_better_with_strong_gains(model: CompiledModel, motion: Motion) -> None:
    tuning, gains = make_strong(model, motion)

    def study(**options: Any) -> ControlStudy:
        return study_control(model, motion, tuning=tuning, gains=gains, draws=3, t_end=3.0, **options)

    chosen, loud = study(), study(estimator=design_kalman(model, motion, sample=0.005))
    assert chosen.notes[0].startswith("estimator: with disturbance forces of the default size")
    ends = [found.loops["estimator"].end_error.max() for found in (chosen, loud)]
    assert ends[0] < 0.8 * ends[1]
