"""Motions on the ground side by side in lanes: steps do not end at contacts, whose forces are continuous."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen.pipeline.analyses import find_needs
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate_batch import simulate_batch
from tensegrity_codegen.runtime.trajectory.trajectory import BatchTrajectory
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.ground_cases import GRAVITY, make_block, make_prism, make_slope, move
from tests.runtime.integrate.test_ground import rotate

Array = NDArray[np.float64]


METHODS = ("rk54", "rk853")


def build(structure: Structure, *methods: str) -> CompiledModel:
    formulation = "rigid_bar" if structure.is_rigid.any() else "node_position"
    request = ModelRequest(("contact_force",), formulation=formulation, integrators=methods)
    needs = find_needs("simulate_batch", structure, request)
    return build_library(structure, needs.besides(request)).load()


def run(model: CompiledModel, method: str, t_end: float, coordinate: Array, **more: Any) -> BatchTrajectory:
    stepping = Stepping(atol=1e-12)
    found = simulate_batch(
        model,
        t_end,
        samples=3,
        coordinate=coordinate,
        method=method,
        rtol=1e-10,
        stepping=stepping,
        **more,
    )
    assert set(found.status) == {"ok"}
    return found


@pytest.mark.parametrize("method", METHODS)
def test_balls_bounce_side_by_side(method: str) -> None:
    """The first from 0.5 m: z(0.9 s) = 0.077226660238; the others rest, fall freely, and go up."""
    model = build(make_block([0.0, 0.0, 0.5], dissipation=0.311252583112), *METHODS)
    heights = np.array([0.5, -GRAVITY / 1e5, 50.0, 0.5, 0.3, 0.2, 0.1, 0.7, 0.4, 0.9])
    start = np.stack([0 * heights, 0 * heights, heights], axis=1)
    velocity = np.zeros_like(start)
    velocity[3, 2] = 10.0
    motions = run(model, method, 0.9, start, velocity=velocity)
    found = motions.coordinate[:, -1, 2]
    assert found[0] == pytest.approx(0.077226660238, abs=2e-7)
    assert found[1] == pytest.approx(heights[1], rel=1e-9)
    assert found[2] == pytest.approx(50.0 - GRAVITY * 0.9**2 / 2, rel=1e-12)
    assert found[3] == pytest.approx(0.5 + 9.0 - GRAVITY * 0.9**2 / 2, rel=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_lanes_have_bristles_of_their_own(method: str) -> None:
    """On 30 degrees a block slips 1.3266802926541 m in 2 s; one that starts with its bristle bent, less."""
    slope, down = make_slope(np.radians(30.0))
    model = build(slope, *METHODS)
    start = np.tile(model.nominal("coordinate"), (3, 1))
    bent = 0.5 * GRAVITY * np.cos(np.radians(30.0)) / 1e5  # mu N / kt: slips at once
    internal = np.array([[0.0, 0.0], [bent, 0.0], [0.0, 0.0]])
    motions = run(model, method, 2.0, start, arguments={"internal": internal})
    slid = motions.node_position[:, -1, 0] @ down
    assert slid[[0, 2]] == pytest.approx(np.full(2, 1.3266802926541), abs=1e-8)
    rate = GRAVITY * (np.sin(np.radians(30.0)) - 0.5 * np.cos(np.radians(30.0)))
    assert slid[1] == pytest.approx(rate * 2.0**2 / 2, rel=1e-9)
    assert motions.internal is not None
    assert motions.internal.shape == (3, 3, 2)
    assert motions[1].internal_name == ("n0_stick1", "n0_stick2")


def test_prisms_in_lanes_move_as_alone() -> None:
    prism = make_prism(rotate((0.0, 0.3, 0.2)))
    model = build(prism, "rk853")
    start = np.tile(model.nominal("coordinate"), (3, 1))
    motions = run(model, "rk853", 0.6, start)
    _, alone = move(prism, "rk853", [0.0, 0.3, 0.6])
    np.testing.assert_allclose(motions.coordinate[0], alone.coordinate, atol=1e-8)
    np.testing.assert_allclose(motions.total_energy[0], alone.total_energy, atol=1e-7)
    np.testing.assert_array_equal(motions.coordinate[1], motions.coordinate[0])


@pytest.mark.parametrize("integrators", [("rk4", "rk54"), *thorough((("rk54",),))])
def test_loops_over_tables_move_lanes_one_by_one(integrators: tuple[str, ...]) -> None:
    """The emitter `table` has no rates over lanes; a fixed step, which has no batch, may come first."""
    prism = make_prism(rotate((0.0, 0.3, 0.2)))
    springs = prism.with_changes(spring_constant=np.where(prism.is_bar, 2e4, prism.spring_constant))
    found = {}
    for emitter in ("table", "unrolled"):
        request = ModelRequest((), integrators=integrators, emitter=emitter)
        needs = find_needs("simulate_batch", springs, request, method="rk54")
        model = build_library(springs, needs.besides(request)).load()
        start = np.tile(model.nominal("coordinate"), (3, 1))
        start[1] += np.tile([0.0, 0.0, 0.02], 6)
        found[emitter] = run(model, "rk54", 0.4, start)
    assert found["table"].internal is not None
    np.testing.assert_allclose(found["table"].coordinate, found["unrolled"].coordinate, atol=1e-8)
    np.testing.assert_allclose(found["table"].internal, found["unrolled"].internal, atol=1e-8)


def test_what_is_not_a_number_is_a_status_of_its_lane() -> None:
    slope, _ = make_slope(np.radians(20.0))
    model = build(slope, "rk853")
    start = np.tile(model.nominal("coordinate"), (2, 1))
    internal = np.array([[np.nan, 0.0], [0.0, 0.0]])
    found = simulate_batch(model, 0.1, coordinate=start, method="rk853", arguments={"internal": internal})
    assert found.status == ("non_finite_input", "ok")
