"""Stiff bars taken as rigid by `auto`: where they are, and what their error is said to be."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.scene.read import read_scene
from tests.models import EXAMPLES


def stiff_prism(ratio: float, **changes: Any) -> CompiledModel:
    """Return the prism of the examples, its bars so many times as stiff as its cables."""
    scene = read_scene(EXAMPLES / "prism.toml").to_document()
    classes = scene["classes"]
    classes["bar"]["spring_constant"] = ratio * classes["cable"]["spring_constant"]
    classes["cable"].pop("damping", None)
    return compile_scene({**scene, **changes}, for_=("simulate",))


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    return stiff_prism(1e3)


@pytest.fixture(scope="module")
def exact(model: CompiledModel) -> Trajectory:
    """The motion with elastic bars, to 1e-9 m."""
    return simulate(model, 1.0, samples=11, method="rk853", rtol=1e-10, stepping=Stepping(atol=1e-10))


def test_a_loose_tolerance_is_met_with_rigid_bars_in_a_tenth_of_the_steps(
    model: CompiledModel, exact: Trajectory
) -> None:
    rtol = 0.1
    found = simulate(model, 1.0, samples=11, rtol=rtol)
    assert (found.status, found.n_steps < 100 < 0.1 * exact.n_steps) == ("ok", True)
    assert "rigid bars" in found.method
    assert "1,000 times stiffer than cables" in found.why_method
    # The vibration that the load excites at the start is what both differ by, and is told.
    off = np.linalg.norm(found.node_position - exact.node_position, axis=2)
    told = found.evidence["vibration_error"]
    assert 1e-6 < off.max() < 2.0 * told + found.error_estimate * rtol * 0.3
    assert told < 0.3 * found.evidence["atol"] * 2.0
    speed = np.linalg.norm(found.node_velocity - exact.node_velocity, axis=2)
    assert speed.max() < 2.0 * found.evidence["vibration_speed_error"] + found.evidence["atol_speed"]
    tension = np.abs(found.member_tension - exact.member_tension)[1:]
    assert tension.max() < 2.0 * found.evidence["vibration_tension_error"]
    # The first sample is the start, and the energy of the vibration is not called lost.
    np.testing.assert_array_equal(found.coordinate[0], model.nominal("coordinate"))


def test_vibrations_beyond_the_tolerance_are_followed(model: CompiledModel, exact: Trajectory) -> None:
    """Of positions, and of velocities: 5 % of the largest one."""
    for rtol in (1e-2, 1e-5):
        found = simulate(model, 1.0, samples=11, rtol=rtol)
        assert (found.status, "rigid" in found.method) == ("ok", False)
        off = np.abs(found.node_velocity - exact.node_velocity).max()
        assert off < found.evidence["atol_speed"] + rtol * np.abs(exact.node_velocity).max()
    # Two runs of twelve evaluations a step, the first not much looser: errors of all steps add up.
    assert found.n_evaluations < 27 * found.n_steps


def test_a_start_in_balance_does_not_excite_bars() -> None:
    model = compile_scene(EXAMPLES / "icosahedron.toml", for_=("simulate",))
    velocity = np.full_like(model.nominal("velocity"), 0.1)
    given: dict[str, Any] = {"samples": 5, "velocity": velocity}
    found = simulate(model, 0.5, rtol=1e-4, **given)
    assert "rigid bars" in found.method
    exact = simulate(model, 0.5, rtol=1e-10, method="rk853", **given)
    off = np.abs(found.node_position - exact.node_position).max()
    assert off < max(1e-9, 2.0 * found.evidence["vibration_error"] + found.evidence["atol"])


def test_what_rigid_bars_cannot_do_is_left_to_elastic_ones(model: CompiledModel) -> None:
    for options in (
        {"method": "rk853"},
        {"stepping": Stepping(control="steps")},
    ):
        assert "rigid" not in simulate(model, 0.2, samples=5, rtol=0.1, **options).method  # type: ignore[arg-type]
    assert "rigid" not in simulate(model, 1e-3, samples=5, rtol=0.1).method  # as cheap with elastic bars
    soft = stiff_prism(10.0)
    assert soft.rigid_twin is None
    assert "rigid" not in simulate(soft, 0.2, samples=5, rtol=0.1).method


def test_bars_that_are_much_stiffer_have_as_many_steps() -> None:
    steps = [simulate(stiff_prism(ratio), 0.5, samples=11, rtol=1e-2).n_steps for ratio in (1e5, 1e7)]
    assert steps[0] == pytest.approx(steps[1], rel=0.1)
    assert max(steps) < 60
