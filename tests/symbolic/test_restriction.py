"""Families of configurations in the full equations of bodies, apart from any study."""

import math

import numpy as np
import pytest

from tensegrity_codegen.structure.bodies import Bar, BodyInput, BodySystem, FixedBody
from tensegrity_codegen.symbolic.restriction import RestrictedBodies
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError

MASS, LENGTH, INERTIA, GRAVITY = 2.0, 1.5, 0.3, 9.81


def pendulums(second_mass: float = MASS) -> BodySystem:
    """Two bars hanging side by side from a base, a cable between their ends, a force on the second end."""
    bars = tuple(
        Bar(f"bar{k + 1}", LENGTH, mass, INERTIA, held="A", anchor=k)
        for k, mass in enumerate((MASS, second_mass))
    )
    none = np.zeros(1)
    return BodySystem(
        name="pendulums",
        bodies=(FixedBody("base"), *bars),
        coordinate=np.array([2.8, 0.0, 2.8, math.pi]),
        velocity=np.zeros(4),
        gravity=np.array([0.0, 0.0, -GRAVITY]),
        node_name=("base_P1", "base_P2", "bar1_B", "bar2_B"),
        node_body=np.array([0, 0, 1, 2]),
        node_local=np.array([[-1.0, 0, 0], [1.0, 0, 0], [LENGTH / 2, 0, 0], [LENGTH / 2, 0, 0]]),
        node_load=np.zeros((4, 3)),
        member_name=("tie",),
        member_class=("tie",),
        connectivity=np.array([[2, 3]]),
        tension_only=np.array([True]),
        rest_length=np.array([1.0]),
        spring_constant=np.array([100.0]),
        axial_stiffness=none,
        damping=none,
        radius=none,
        inputs=(BodyInput("push", "force", (3,), (1.0, 0.0, 0.0)),),
    )


def mirrored(system: BodySystem | None = None) -> RestrictedBodies:
    """Both bars at one declination, the second in the mirror image of the first."""

    def family(s: list[object]) -> list[object]:
        return [s[0], 0.0, s[0], math.pi]

    return RestrictedBodies(system or pendulums(), ("delta",), family, {"tie": (0,)})  # type: ignore[arg-type]


def test_coordinates_and_lengths_follow_the_family() -> None:
    restricted = mirrored()
    assert restricted.coordinate([2.8]) == pytest.approx([2.8, 0.0, 2.8, math.pi])
    assert restricted.velocity([2.8], [0.5]) == pytest.approx([0.5, 0.0, 0.5, 0.0])
    assert restricted.group_length([2.8]) == pytest.approx([2.0 - 2 * LENGTH * math.sin(2.8)])
    assert restricted.length_spread([2.8]) == 0.0


def test_reduced_equation_is_that_of_a_pendulum() -> None:
    # 2 (J + m l^2/4) delta'' - 2 m g (l/2) sin(delta) + dl/d(delta) t = 0, by hand
    delta, rate, change = 2.6, 0.7, -1.1
    reduced = mirrored().balance([delta], [rate], [change]).reduced()
    about_end = INERTIA + MASS * LENGTH**2 / 4
    own = 2 * about_end * change - MASS * GRAVITY * LENGTH * math.sin(delta)
    assert reduced.own_force == pytest.approx([own])
    assert reduced.tendon_matrix == pytest.approx(np.array([[-2 * LENGTH * math.cos(delta)]]))
    assert reduced.input_matrix == pytest.approx(np.array([[LENGTH * math.cos(delta)]]))


def test_control_balances_all_equations_where_the_family_is_a_class_of_motions() -> None:
    control = mirrored().find_control([2.6], [0.7], [-1.1], [0.0], [])
    assert np.abs(control.residual).max() < 1e-13
    assert control.rank == 1


def test_residual_shows_a_family_that_is_none() -> None:
    # The second bar is heavier: its weight and inertia differ, and half of the difference stays with each.
    control = mirrored(pendulums(3.0)).find_control([2.6], [0.7], [-1.1], [0.0], [])
    extra = 1.0 * LENGTH**2 / 4 * -1.1 - 1.0 * GRAVITY * LENGTH / 2 * math.sin(2.6)
    assert control.residual == pytest.approx([-extra / 2, 0.0, extra / 2, 0.0], abs=1e-12)


def test_a_free_input_makes_up_for_it() -> None:
    control = mirrored(pendulums(3.0)).find_control([2.6], [0.7], [-1.1], [5.0], [0])
    assert np.abs(control.residual).max() < 1e-12
    extra = LENGTH**2 / 4 * -1.1 - GRAVITY * LENGTH / 2 * math.sin(2.6)
    assert control.input == pytest.approx([-extra / (LENGTH * math.cos(2.6))])


def test_known_inputs_stay() -> None:
    balance = mirrored().balance([2.6], [0.0], [0.0])
    control = mirrored().find_control([2.6], [0.0], [0.0], [4.0], [])
    assert control.input == pytest.approx([4.0])
    assert control.residual == pytest.approx(balance.residual(control.tension, [4.0]))


def test_group_matrix_runs_over_configurations() -> None:
    found = mirrored().group_matrix([[2.6], [2.8]])
    assert found.shape == (2, 1, 1)
    assert found[:, 0, 0] == pytest.approx([-2 * LENGTH * math.cos(d) for d in (2.6, 2.8)])


def test_wrong_families_and_arguments_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="another number of coordinates"):
        RestrictedBodies(pendulums(), ("delta",), lambda s: [s[0]], {"tie": (0,)})
    with pytest.raises(InvalidValueError, match="wrong shape"):
        mirrored().balance([2.6, 1.0], [0.0], [0.0])
    with pytest.raises(NonFiniteError):
        mirrored().balance([math.nan], [0.0], [0.0])
