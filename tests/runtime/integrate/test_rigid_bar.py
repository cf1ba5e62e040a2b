"""Motions with rigid bars: the common prism, stiff bars in the limit, and the first-order correction."""

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.simulation_quantities import simulation_quantities
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.request import ModelRequest
from tests.common_prism import BARS, POSITION, common_prism, span
from tests.runtime.build import bar, cable, make_structure

Array = NDArray[np.float64]


def compile_rigid(structure: Structure, **options: str) -> CompiledModel:
    request = ModelRequest(
        (*simulation_quantities("rigid_bar"), "consistent_coordinate", "consistent_velocity"),
        formulation="rigid_bar",
        integrators=("rk4", "rk54"),
        options=options,
    )
    return build_library(structure, request).load()


def test_common_prism_reaches_its_reference_and_keeps_its_bars() -> None:
    model = compile_rigid(common_prism())
    motion = simulate(model, 5.0, samples=51, method="rk4", stepping=Stepping(step=1.25e-3))
    assert motion.status == "ok"
    assert np.abs(motion.node_position[-1] - POSITION[-1].reshape(6, 3)).max() < 3e-7
    lengths = [
        np.linalg.norm(motion.node_position[:, i] - motion.node_position[:, j], axis=1) for i, j in BARS
    ]
    assert np.abs(np.array(lengths) - np.array([[span(i, j)] for i, j in BARS])).max() < 2e-15
    fine = simulate(model, 5.0, samples=2, method="rk54", rtol=1e-10, stepping=Stepping(atol=1e-12))
    assert np.abs(fine.node_position[-1] - POSITION[-1].reshape(6, 3)).max() < 3e-9
    assert np.ptp(fine.total_energy) < 1e-8


def twisted_prism(ratio: float) -> Structure:
    """A prism with point masses whose bars are `ratio` times as stiff as its cables."""
    angle = 2 * np.pi * np.arange(3) / 3
    top = angle + np.radians(150)
    low = np.stack([np.cos(angle), np.sin(angle), np.zeros(3)], axis=1)
    high = np.stack([np.cos(top), np.sin(top), np.ones(3)], axis=1)
    position = np.concatenate([low, high])
    cables = ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 4), (1, 5), (2, 3))

    def length(i: int, j: int) -> float:
        return float(np.linalg.norm(position[i] - position[j]))

    members = [bar(k, k + 3, length(k, k + 3), 100.0 * ratio) for k in range(3)]
    members += [cable(i, j, 0.8 * length(i, j)) for i, j in cables]
    velocity = 0.1 * np.random.default_rng(1).standard_normal((6, 3))
    return make_structure(position, members).with_changes(node_velocity=velocity)


def errors_of(ratio: float) -> tuple[float, float, float]:
    """Return errors [m] of rigid and corrected bars against springs, 0.5 s, and the corrected estimate."""
    structure = twisted_prism(ratio)
    plain, corrected = (
        compile_rigid(structure, bars="all", correction=word) for word in ("none", "first_order")
    )
    springs = build_library(
        structure, ModelRequest(simulation_quantities("node_position"), integrators=("rk54",))
    ).load()
    options = {"samples": 6, "method": "rk54", "rtol": 1e-11, "stepping": Stepping(atol=1e-13)}
    first = simulate(corrected, 0.5, **options)
    # Springs start on the slow motion, so that no bar vibrates.
    start = {"coordinate": first.coordinate[0], "velocity": first.velocity[0]}
    exact = simulate(springs, 0.5, **options, **start).coordinate
    rigid = simulate(plain, 0.5, **options, **start)
    estimate = corrected.compute("rigidity_error", **start).max()
    return (
        float(np.abs(rigid.coordinate - exact).max()),
        float(np.abs(first.coordinate - exact).max()),
        float(estimate),
    )


@pytest.mark.thorough
def test_rigid_bars_are_off_by_one_over_the_ratio_and_corrected_ones_by_its_square() -> None:
    (rigid_2, first_2, estimate_2), (rigid_3, first_3, estimate_3) = errors_of(1e2), errors_of(1e3)
    assert rigid_2 / rigid_3 == pytest.approx(10.0, rel=0.2)
    assert first_2 / first_3 == pytest.approx(100.0, rel=0.4)
    assert first_3 < 2e-6
    for estimate, error in ((estimate_2, first_2), (estimate_3, first_3)):
        assert 0.1 < estimate / error < 10.0


def test_an_initial_motion_that_stretches_a_rigid_bar_is_refused() -> None:
    model = compile_rigid(common_prism())
    velocity = model.nominal("velocity")
    velocity[0] = 0.3
    with pytest.raises(InvalidValueError, match="changes the length of a rigid bar"):
        simulate(model, 1.0, velocity=velocity)


@pytest.mark.thorough
def test_chains_of_rigid_bars_swing_as_stiff_ones_do() -> None:
    position = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 0, -1]]

    def chain(mu: float) -> Structure:
        members = [bar(0, 1, 1.0, mu), bar(1, 2, 1.0, mu, mass=0.5), cable(2, 3, 0.9)]
        return make_structure(position, members, anchored={0: "xyz", 3: "xyz"}, gravity=(0, 0, -9.81))

    rigid = simulate(compile_rigid(chain(0.0)), 1.0, samples=11, rtol=1e-9, stepping=Stepping(atol=1e-10))
    springs = build_library(
        chain(1e6), ModelRequest(simulation_quantities("node_position"), integrators=("rk54",))
    ).load()
    stiff = simulate(springs, 1.0, samples=11, method="rk54", rtol=1e-8, stepping=Stepping(atol=1e-10))
    assert np.abs(rigid.node_position - stiff.node_position).max() < 1e-3
    assert rigid.energy_drift is not None
    assert rigid.energy_drift < 1e-6
