"""Estimates about contacts with the ground, compared with integration of impacts and with closed forms."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.structure.contact_estimates import (
    compute_gap,
    compute_slope,
    estimate_contacts,
    find_dissipation,
    find_movable,
    find_surface_nodes,
)
from tensegrity_codegen.structure.structure import Structure
from tests.body_scenes import EVERYTHING, assemble_document


def stand(**ground: Any) -> Structure:
    """Return a mast of 2 kg on a foot of 1 kg, beside an anchor that a cable ties to its head."""
    document = {
        "name": "mast",
        "axes": "xz",
        "gravity": [0, -10],
        "nodes": {
            "foot": {"position": [0, 0.1], "mass": 1.0},
            "head": {"position": [0, 1.1], "mass": 0.5},
            "wall": {"position": [1, 1.1], "anchored": True},
        },
        "members": {
            "mast": {"kind": "bar", "nodes": ["foot", "head"], "axial_stiffness": 1e5, "mass": 2.0},
            "rope": {"kind": "cable", "nodes": ["head", "wall"], "spring_constant": 100.0},
        },
        "ground": {"radius": 0.1, "stiffness": 1e4, **ground},
    }
    return assemble(parse_scene(document))[0]


def bounce(dissipation: float, speed: float, exponent: float, stiffness: float) -> float:
    """Return the restitution of 1 kg without weight, by integrating its impact."""

    def rate(_: float, state: np.ndarray) -> list[float]:
        depth, closing = state
        return [closing, -stiffness * max(depth, 0.0) ** exponent * max(0.0, 1 + dissipation * closing)]

    def leaves(time: float, state: np.ndarray) -> float:
        return float(state[0]) if time > 0 else 1.0

    leaves.terminal, leaves.direction = True, -1  # type: ignore[attr-defined]
    found = solve_ivp(rate, (0, 10), [0.0, speed], events=leaves, rtol=1e-11, atol=1e-14, method="DOP853")
    return float(-found.y_events[0][0, 1]) / speed


@pytest.mark.parametrize(
    ("speed", "value"), [(0.1, 0.9797), (1.0, 0.8276), (math.sqrt(9.81), 0.6), (5.0, 0.4779), (10.0, 0.2980)]
)
def test_one_dissipation_gives_less_restitution_at_more_speed(speed: float, value: float) -> None:
    assert find_dissipation(value, speed) == pytest.approx(0.311252583112, rel=2e-3)
    if value == 0.6:
        assert find_dissipation(value, speed) == pytest.approx(0.311252583112, rel=1e-12)


@pytest.mark.parametrize(("exponent", "stiffness"), [(1.0, 1e4), (1.5, 1e6)])
@pytest.mark.parametrize(("value", "speed"), [(0.95, 0.3), (0.6, 3.132), (0.1, 2.0)])
def test_an_impact_has_the_restitution_whatever_stiffness_and_exponent(
    value: float, speed: float, exponent: float, stiffness: float
) -> None:
    assert bounce(find_dissipation(value, speed), speed, exponent, stiffness) == pytest.approx(
        value, rel=1e-7
    )


@pytest.mark.parametrize("value", [1e-200, 1e-9, 0.02, 0.3, 0.999999, 1 - 2.0**-53])
def test_restitutions_of_any_size_have_a_dissipation(value: float) -> None:
    """For e near 0, a v = 1/e; for e near 1, a v = (3/2) (1 - e^2) / (1 + e^3)."""
    found = find_dissipation(value, 2.0) * 2.0
    if value < 0.025:
        assert found == pytest.approx(1 / value, rel=1e-12)
    elif value > 0.99:
        assert found == pytest.approx(1.5 * (1 - value**2) / (1 + value**3), rel=1e-5)
    else:
        assert value * found + math.log(1 - value * found) == pytest.approx(math.log(1 + found) - found)


def test_the_slope_of_the_normal_force() -> None:
    assert compute_slope(1e4, 1.0, 7.0) == 1e4
    assert compute_slope(1e4, 1.0, 0.0) == 1e4
    depth = (7.0 / 1e6) ** (2 / 3)
    assert compute_slope(1e6, 1.5, 7.0) == pytest.approx(1.5 * 1e6 * depth**0.5, rel=1e-14)


def test_estimates_of_a_mast() -> None:
    structure = stand(contacts=["foot"], friction=0.5, stick_stiffness=5e3)
    assert structure.ground is not None
    found = estimate_contacts(structure, structure.ground)
    assert found.mass.tolist() == [2.0]  # and half of the bar
    assert found.weight == pytest.approx(35.0)
    assert found.penetration == pytest.approx(35e-4)
    assert found.largest_penetration == found.penetration
    assert found.frequency == pytest.approx(math.sqrt(1e4 / 2.0) / (2 * math.pi))
    assert found.stick_offset == pytest.approx(0.5 * 35 / 5e3)
    assert compute_gap(structure, structure.ground) == pytest.approx([0.0], abs=1e-15)


def test_all_contacts_share_the_weight_and_the_lightest_has_the_frequency() -> None:
    structure = stand()
    assert structure.ground is not None
    found = estimate_contacts(structure, structure.ground)
    assert found.mass.tolist() == [2.0, 1.5]
    assert found.penetration == pytest.approx(35e-4 / 2)
    assert found.largest_penetration == pytest.approx(35e-4)
    assert found.frequency == pytest.approx(math.sqrt(1e4 / 1.5) / (2 * math.pi))
    assert found.stick_offset == 0.0
    assert compute_gap(structure, structure.ground) == pytest.approx([0.0, 1.0])


def test_gravity_out_of_the_ground_is_no_weight() -> None:
    structure = stand(normal=[0, -1], offset=-2)
    assert structure.ground is not None
    found = estimate_contacts(structure, structure.ground)
    assert (found.weight, found.penetration, found.stiffness) == (0.0, 0.0, 1e4)


def test_ends_that_a_fixed_point_holds_do_not_move_and_held_ends_are_no_surface() -> None:
    system = assemble_document(EVERYTHING)[0]
    up = np.array([0.0, 0.0, 1.0])
    still = {
        name for name, moves in zip(system.node_name, find_movable(system, up), strict=True) if not moves
    }
    assert still == {"ground_a", "ground_b", "mast_A"}
    surface = {system.node_name[node] for node in find_surface_nodes(system, up)}
    assert surface == set(system.node_name) - still - {"leg_B", "boom_A", "plate_centre"}
