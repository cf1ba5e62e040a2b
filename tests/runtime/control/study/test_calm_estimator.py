"""Disturbance forces of an estimator that are as large as noise of the sensors permits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tensegrity_codegen import design_kalman
from tensegrity_codegen.runtime.control.design.usual_forces import UNKNOWN, find_usual_forces
from tensegrity_codegen.runtime.control.motion import Motion
from tensegrity_codegen.runtime.control.study.calm_estimator import (
    design_calm_estimator,
    predict_displacement,
)
from tensegrity_codegen.runtime.control.study.scales import find_scales
from tensegrity_codegen.runtime.model.model import CompiledModel


def test_the_pinned_prism_keeps_the_default(model: CompiledModel, motion: Motion) -> None:
    scales = find_scales(model, motion, {})
    usual = design_kalman(model, motion, sample=0.005)
    found, warning = design_calm_estimator(
        model, motion, scales, sample=0.005, only_observable=False, arguments={}
    )
    assert warning is None
    np.testing.assert_array_equal(found.L, usual.L)
    assert 0 < predict_displacement(found, scales) < 0.005 * scales.size


@pytest.mark.parametrize("part", [0.95, 1e-4])
def test_forces_are_divided_until_noise_moves_nodes_little(
    model: CompiledModel, motion: Motion, part: float
) -> None:
    """With a size that is smaller than the true one, the same noise is too much; three divisions at most."""
    scales = find_scales(model, motion, {})
    usual = design_kalman(model, motion, sample=0.005)
    small = replace(scales, size=part * predict_displacement(usual, scales) / 0.005)
    found, warning = design_calm_estimator(
        model, motion, small, sample=0.005, only_observable=False, arguments={}
    )
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
