"""Inverse dynamics: the full model in C follows; least squares and bounds; what is missing is reported."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

from tensegrity_codegen.control.feedback.equilibrium_path import EquilibriumPath
from tensegrity_codegen.control.feedback.inverse_dynamics import InverseDynamics
from tensegrity_codegen.control.feedback.time_motion import time_motion
from tensegrity_codegen.control.planning.plan import plan
from tensegrity_codegen.control.planning.plan_point import PlanModel, find_actuation
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.structure.actuators import Actuator
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, UnknownNameError
from tests.control.feedback.structures import build_prism, compile_motion, plan_prism

PINNED = build_prism(free=False)
RIGID = build_prism(rigid=True, free=False)


def follow(model: Any, motion: Motion) -> tuple[float, float]:
    """Return the largest differences of coordinates and tensions between the simulation and the motion."""
    run = simulate(
        model,
        motion.duration,
        schedule=motion.profile(),
        coordinate=motion.coordinate[0],
        samples=len(motion.time),
    )
    assert run.status == "ok", run.message
    off = np.abs(run.coordinate - motion.coordinate).max()
    return float(off), float(np.abs(run.member_tension - motion.member_tension).max())


def test_rigid_bars_are_followed_exactly() -> None:
    model, found = compile_motion(RIGID, "rigid_bar"), plan_prism(RIGID, "rigid_bar")
    motion = time_motion(model, found, 0.8)
    assert motion.warnings == ()
    assert motion.residual.max() < 1e-9
    off, tension = follow(model, motion)
    assert off < 1e-9
    assert tension < 1e-5


@pytest.mark.thorough
def test_elastic_bars_are_followed_up_to_their_vibration() -> None:
    model, found = compile_motion(PINNED), plan_prism(PINNED)
    dynamic = time_motion(model, found, 0.8)
    static = time_motion(model, found, 0.8, feedforward="static")
    assert static.residual.size == 0
    off, tension = follow(model, dynamic)
    assert off < 1e-6
    assert tension < 1e-3
    assert follow(model, static)[0] > 300 * off
    np.testing.assert_allclose(dynamic.input[[0, -1]], static.input[[0, -1]], atol=1e-9)


def group(structure: Structure) -> Structure:
    """Return the structure with one motor for each kind of cable, and cables with an axial stiffness."""
    cable, length = ~structure.is_bar, structure.member_length()
    tension = structure.spring_constant * (length - structure.rest_length)
    kinds = ("vertical", "opposite", "top", "bottom")
    of = {
        kind: tuple(e for e, name in enumerate(structure.member_name) if name.startswith(kind))
        for kind in kinds
    }
    return structure.with_changes(
        spring_constant=np.where(cable, 0.0, structure.spring_constant),
        axial_stiffness=np.where(cable, 300.0, 0.0),
        rest_length=np.where(cable, 300.0 * length / (300.0 + tension), structure.rest_length),
        actuators=tuple(Actuator(kind, members, 0.05) for kind, members in of.items()),
        inputs=tuple(ActuatedInput(kind, "rest_length", members) for kind, members in of.items()),
    )


@pytest.mark.thorough
def test_motors_of_several_cables_with_axial_stiffness() -> None:
    model = compile_motion(group(build_prism()))
    found = plan(model, "twist=165")
    motion = time_motion(model, found, 1.0, samples=101)
    assert motion.warnings == ()
    off, _ = follow(model, motion)
    assert off < 1e-6


def test_what_too_few_motors_do_not_produce_is_left_in_least_squares() -> None:
    structure = build_prism("vertical", rigid=True)
    model = compile_motion(structure, "rigid_bar", simulates=False)
    found = plan(model, "height=0.302")
    motion = time_motion(model, found, 0.5, samples=51)
    (warning,) = motion.warnings
    assert "do not produce this motion exactly" in warning
    row = int(motion.residual.argmax())
    assert f"{motion.residual[row]:.3g} N" in warning
    assert f"{motion.time[row]:.4g} s" in warning
    given = {"coordinate": motion.coordinate[row], "input": motion.input[row]}
    matrix = model.compute("equilibrium_matrix", **given).toarray()
    mass = model.compute("mass_matrix", **given).toarray()
    # Without the loads and weights there are only tensions: M a + A t is what is missing.
    missing = mass @ motion.acceleration[row] + matrix @ motion.member_tension[row]
    assert np.abs(missing).max() == pytest.approx(motion.residual[row], rel=1e-6)
    driven = [structure.member_name.index(f"vertical{k}") for k in (1, 2, 3)]
    chosen = matrix[:, [*driven, *np.flatnonzero(structure.is_bar)]]
    assert np.abs(chosen.T @ missing).max() < 1e-6 * np.abs(missing).max()


def bound(above: float) -> tuple[Any, PlanModel, Motion, np.ndarray]:
    """Return a prism whose tensions have bounds [N] next to those of the path, and a fast static motion.

    above: by how much tensions may exceed those of the path.
    """
    structure = build_prism(rate=float("inf"), rigid=True, free=False)
    model = compile_motion(structure, "rigid_bar", simulates=False)
    found = plan_prism(structure, "rigid_bar", simulates=False)
    motion = time_motion(model, found, 0.05, feedforward="static")
    cable = ~structure.is_bar
    least = np.where(cable, motion.member_tension.min(axis=0), -np.inf)
    most = np.where(cable, motion.member_tension.max(axis=0) + above, np.inf)
    limits = dataclasses.replace(structure.limits, least_tension=least, most_tension=most)
    tight = structure.with_changes(limits=limits)
    model = compile_motion(tight, "rigid_bar", simulates=False)
    return tight, PlanModel(model, find_actuation(model)), motion, least


def test_tensions_stay_above_the_least_and_are_nearest_to_those_of_the_path() -> None:
    structure, plan_model, static, least = bound(100.0)
    inverse = InverseDynamics(plan_model, static.coordinate[0])
    cable, active = ~structure.is_bar, 0
    for row in range(10, 200, 20):
        q, v, a = static.coordinate[row], static.velocity[row], static.acceleration[row]
        preferred = static.member_tension[row]
        drive = inverse.solve(q, v, a, static.input[row], preferred)
        assert np.abs(drive.residual).max() < 1e-8
        damping = structure.damping * (plan_model.model.compute("equilibrium_matrix", coordinate=q).T @ v)
        low = (np.minimum(least, preferred) + np.maximum(damping, 0.0))[cable]
        assert np.all(drive.tension[cable] >= low - 1e-7)
        active += int(drive.bounded.sum())
        matrix = plan_model.model.compute("equilibrium_matrix", coordinate=q).toarray()
        best = minimize(
            lambda t, preferred=preferred: float(np.sum((t - preferred[cable]) ** 2)),
            drive.tension[cable],
            jac=lambda t, preferred=preferred: 2 * (t - preferred[cable]),
            constraints=_balance(matrix, cable, matrix @ drive.tension),
            bounds=[(value, None) for value in low],
            method="SLSQP",
            options={"ftol": 1e-14, "maxiter": 200},
        )
        np.testing.assert_allclose(drive.tension[cable], best.x, atol=1e-5)
    assert active > 0


def _balance(matrix: np.ndarray, cable: np.ndarray, force: np.ndarray) -> dict[str, Any]:
    """Return the equations of cable tensions, without the forces of bars."""
    bars = matrix[:, ~cable]
    left = np.linalg.svd(bars, full_matrices=True)[0][:, np.linalg.matrix_rank(bars) :].T
    rows, right = left @ matrix[:, cable], left @ force
    return {"type": "eq", "fun": lambda t: rows @ t - right, "jac": lambda t: rows}


def test_bounds_that_leave_no_exact_tensions_yield_a_residual_not_a_slack_cable() -> None:
    structure, plan_model, static, least = bound(1.0)
    inverse = InverseDynamics(plan_model, static.coordinate[0])
    a = 10 * static.acceleration[20]
    drive = inverse.solve(static.coordinate[20], 0 * a, a, static.input[20], static.member_tension[20])
    cable = ~structure.is_bar
    most = structure.limits.most_tension
    assert np.all(drive.tension[cable] >= least[cable] - 1e-6)
    assert np.all(drive.tension[cable] <= most[cable] + 1e-6)
    assert np.abs(drive.residual).max() > 1e-3
    assert drive.bounded.any()


def test_without_masses_only_static_inputs_are_possible() -> None:
    found = plan_prism(PINNED, simulates=False)
    model = compile_motion(PINNED.with_changes(node_mass=np.zeros(6)), simulates=False)
    with pytest.raises(FormulationError, match="masses"):
        time_motion(model, found, 1.0)
    static = time_motion(model, found, 1.0, feedforward="static")
    np.testing.assert_allclose(static.input[-1], found.change[-1], atol=1e-12)


def test_wrong_feedforward() -> None:
    model, found = compile_motion(PINNED, simulates=False), plan_prism(PINNED, simulates=False)
    with pytest.raises(UnknownNameError, match="dynamic"):
        time_motion(model, found, 1.0, feedforward="none")


def test_the_shortest_duration_counts_inertia() -> None:
    model, found = compile_motion(PINNED, simulates=False), plan_prism(PINNED, simulates=False)
    shortest = time_motion(model, found, samples=51)
    assert shortest.peak_rate.max() == pytest.approx(0.05, rel=1e-5)
    static = time_motion(model, found, feedforward="static", samples=51).duration
    assert 1e-3 < abs(shortest.duration - static) < 0.1 * static
    with pytest.raises(InvalidValueError, match="at least"):
        time_motion(model, found, 0.999 * shortest.duration, samples=51)


@pytest.mark.thorough
def test_other_inputs_are_held_at_their_arguments() -> None:
    structure = PINNED.with_changes(
        inputs=(ActuatedInput("push", "force", (3,), (1.0, 0.0, 0.0)), *PINNED.inputs)
    )
    model = compile_motion(structure)
    path = EquilibriumPath([[0.0] * 12, [-0.002] * 12])
    motion = time_motion(model, path, 1.0, arguments={"push": 0.3}, samples=101)
    assert np.all(motion.input[:, motion.input_name.index("push")] == 0.3)
    assert follow(model, motion)[0] < 1e-6
