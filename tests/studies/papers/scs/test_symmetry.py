"""SCS section 4: symmetrical motions, obtained from the model of 18 coordinates."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tensegrity_codegen.structure.bodies import Bar
from tensegrity_codegen.studies.papers.scs.printed import PAPER_POSES, PrintedTower
from tensegrity_codegen.studies.papers.scs.symmetry import SymmetricPose, SymmetricTower
from tensegrity_codegen.system.errors import (
    InfeasibleError,
    InvalidValueError,
    NonFiniteError,
    StructureError,
)
from tests.studies.papers.scs.subjects import angles, determinant_condition, pose, rates, tower

PRINTED = PrintedTower.of(tower())
few = settings(max_examples=40, deadline=None)


@few
@given(angles())
def test_all_tendons_of_a_class_have_the_length_of_17_to_19(s: np.ndarray) -> None:
    assert tower().restricted.length_spread(s) < 1e-14
    assert tower().lengths(SymmetricPose(*s)) == pytest.approx(PRINTED.lengths(*s), rel=1e-13)


@few
@given(angles(), rates(), rates(), st.floats(-50, 50))
def test_symmetrical_motions_leave_nothing_of_the_18_equations_over(
    s: np.ndarray, rate: np.ndarray, change: np.ndarray, force: float
) -> None:
    # SCS (20): F_1 = F_2 = M_1 = M_2 = 0. Invariance: with the tensions and M_3 found, all 18 rows vanish.
    control = tower().restricted.find_control(s, rate, change, [0, 0, 0, 0, 0, force], range(5))
    size = 1.0 + np.abs(control.tension).max()
    assert np.abs(control.residual).max() < 1e-12 * size
    assert np.abs(control.input[[0, 1, 3, 4]]).max() < 1e-12 * size


@few
@given(angles(), rates(), rates())
def test_reduced_equations_are_22_to_25_with_the_centrifugal_term(
    s: np.ndarray, rate: np.ndarray, change: np.ndarray
) -> None:
    reduced = tower().restricted.balance(s, rate, change).reduced()
    ours = reduced.own_force[[1, 0, 2]] / [6, 6, 1]  # rows delta, alpha, Z
    assert ours == pytest.approx(PRINTED.own_force(s, rate, change, 0.0), abs=1e-12)
    missing = tower().bar_inertia * math.sin(s[1]) * math.cos(s[1]) * rate[0] ** 2
    as_printed = PRINTED.own_force(s, rate, change, 0.0, as_printed=True)
    assert as_printed - ours == pytest.approx([missing, 0.0, 0.0], abs=1e-12)
    # F_3 acts on the equation of Z alone, M_3 on none of the three.
    inputs = np.zeros((3, 6))
    inputs[2, 5] = -1.0
    assert np.abs(reduced.input_matrix - inputs).max() < 1e-15


@few
@given(angles(), rates(), rates())
def test_torque_is_33(s: np.ndarray, rate: np.ndarray, change: np.ndarray) -> None:
    control = tower().restricted.find_control(s, rate, change, np.zeros(6), range(5))
    size = 1.0 + np.abs(control.tension).max()
    assert control.input[2] == pytest.approx(PRINTED.torque(s, rate, change), abs=1e-12 * size)


@few
@given(angles())
def test_matrix_is_appendix_a_with_sines_in_its_second_row(s: np.ndarray) -> None:
    matrix = tower().matrix(s[None])[0]
    assert np.abs(matrix - PRINTED.matrix(*s)).max() < 1e-13 * np.abs(matrix).max()
    as_printed = PRINTED.matrix(*s, as_printed=True)
    assert as_printed[1] * math.tan(s[1]) == pytest.approx(matrix[1], abs=1e-12 * np.abs(matrix).max())


@few
@given(angles())
def test_determinant_vanishes_where_42_does(s: np.ndarray) -> None:
    # det(A_r) = -6 l^2 b sin(delta) / (S V D) times the left side of (42).
    ours = tower().determinant(s[None])[0] * np.prod(tower().lengths(SymmetricPose(*s)))
    factor = -6.0 * tower().bar.length ** 2 * tower().side * math.sin(s[1])
    assert ours == pytest.approx(factor * determinant_condition(PRINTED, *s), abs=1e-12)


@few
@given(angles(), rates(), rates(), st.floats(-2, 2), st.floats(-2, 2))
def test_motions_stay_symmetrical_only_at_constant_speed_of_the_top(
    s: np.ndarray, rate: np.ndarray, change: np.ndarray, speed: float, gain: float
) -> None:
    # SCS (21) prints d/dt(Z' sin(delta)) = 0; the stages' equations of delta differ by m l/2 Z'' sin(delta).
    rate[2], change[2] = speed, gain
    balance = tower().restricted.balance(s, rate, change)
    tilts = [k for k, name in enumerate(tower().system.coordinate_name) if name.endswith("_declination")]
    lower, upper = balance.own_force[tilts[:3]], balance.own_force[tilts[3:]]
    arm = 0.5 * tower().bar.mass * tower().bar.length
    assert upper - lower == pytest.approx(np.full(3, arm * math.sin(s[1]) * gain), abs=1e-12)
    pulls = balance.tendon_matrix
    assert np.abs(pulls[tilts[:3]] - pulls[tilts[3:]]).max() < 1e-12 * np.abs(pulls).max()


@pytest.mark.parametrize("key", list(PAPER_POSES))
def test_tensions_of_the_printed_equilibria(key: str) -> None:
    # SCS (44), (45), (52), (53), each within 0.006 N.
    item = PAPER_POSES[key]
    delta = 22.036 if key == "53" else item.delta_deg
    tension = tower().equilibrium(pose(item.alpha_deg, delta, item.height), item.force)
    assert np.abs(tension - item.tension).max() < 0.006


def test_rest_lengths_are_35_and_give_the_tensions_back() -> None:
    length, tension = np.array([0.5, 0.8, 0.6]), np.array([10.0, 20.0, 30.0])
    rest = tower().rest_lengths(length, tension)
    assert 1000.0 * (length - rest) / rest == pytest.approx(tension, rel=1e-12)


def changed_tower() -> SymmetricTower:
    """A tower with other bars, stiffness and top, and without friction."""
    system = tower().system
    bodies = tuple(
        replace(body, length=1.3, mass=0.7, inertia=0.2) if isinstance(body, Bar) else body
        for body in system.bodies
    )
    bars = [isinstance(system.bodies[k], Bar) for k in system.node_body]
    local = np.where(np.array(bars)[:, None], 1.3, 1.1) * system.node_local
    half = np.full(system.n_members, 500.0)
    return SymmetricTower(
        system.with_changes(bodies=bodies, node_local=local, axial_stiffness=half, friction=())
    )


def test_the_agreement_is_not_one_of_the_papers_numbers() -> None:
    changed, s = changed_tower(), np.array([1.0, 0.5, 1.7])
    rate, change = np.array([0.4, -0.3, 0.0]), np.array([-0.2, 0.6, 0.0])
    printed, ours = PrintedTower.of(changed), changed.compute_control(s, rate, change, 20.0)
    assert (printed.length, printed.friction) == (1.3, 0.0)
    assert printed.side == pytest.approx(1.1 * 2 / 3)
    assert printed.bar_inertia == pytest.approx(0.2 + 0.7 * 1.3**2 / 4)
    assert changed.lengths(SymmetricPose(*s)) == pytest.approx(printed.lengths(*s), rel=1e-13)
    assert ours.tension == pytest.approx(printed.tension(s, rate, change, 20.0), rel=1e-11)
    assert ours.input[2] == pytest.approx(printed.torque(s, rate, change), abs=1e-12)
    factor = -6.0 * 1.3**2 * printed.side * math.sin(s[1]) / np.prod(printed.lengths(*s))
    expected = factor * determinant_condition(printed, *s)
    assert changed.determinant(s[None])[0] == pytest.approx(expected, rel=1e-11)


def test_unequal_bars_are_refused() -> None:
    system = tower().system
    bodies = tuple(replace(b, mass=2.0) if b.name == "bar22" else b for b in system.bodies)
    with pytest.raises(StructureError, match="left-out residual"):
        SymmetricTower(system.with_changes(bodies=bodies))


@pytest.mark.parametrize(
    ("angles_and_height", "words"),
    [
        ((30.0, 40.0, 1.2), "bars intersect"),
        ((390.0, 40.0, 1.2), "bars intersect"),
        ((-330.0, 40.0, 1.2), "bars intersect"),
        ((55.0, 0.0, 1.2), "declination is outside"),
        ((55.0, 90.0, 1.2), "declination is outside"),
        ((55.0, -10.0, 1.2), "declination is outside"),
        ((55.0, 40.0, math.cos(math.radians(40.0))), "reach the other end"),
        ((55.0, 40.0, 0.7), "reach the other end"),
    ],
)
def test_poses_outside_the_bounds_of_section_4_are_refused(
    angles_and_height: tuple[float, float, float], words: str
) -> None:
    with pytest.raises(InvalidValueError, match=words):
        tower().equilibrium(pose(*angles_and_height), -50.0)


def test_a_pose_that_is_no_number_is_refused() -> None:
    with pytest.raises(NonFiniteError):
        pose(math.nan, 40.0, 1.2)


def test_a_pushing_tendon_is_named() -> None:
    tension = tower().equilibrium(pose(55.0, 40.0, 0.8), -50.0)
    with pytest.raises(InfeasibleError, match="vertical would have to push") as caught:
        tower().check_taut(tension, "start")
    assert caught.value.exit_code == 3
    assert list(caught.value.evidence) == ["saddle", "vertical", "diagonal"]


def test_gravity_breaks_the_symmetry_and_is_refused() -> None:
    with pytest.raises(StructureError, match="does not move symmetrically"):
        SymmetricTower(tower().system.with_changes(gravity=np.array([0.0, 0.0, -9.81])))


def test_unequal_stiffness_in_a_class_is_refused() -> None:
    stiffness = np.array(tower().system.axial_stiffness)
    stiffness[0] *= 2
    with pytest.raises(StructureError, match="does not move symmetrically") as caught:
        SymmetricTower(tower().system.with_changes(axial_stiffness=stiffness))
    assert "stiffnesses" in str(caught.value)


def test_friction_on_some_joints_only_is_refused() -> None:
    with pytest.raises(StructureError, match="left-out residual"):
        SymmetricTower(tower().system.with_changes(friction=tower().system.friction[:4]))


def test_a_scene_of_another_kind_is_refused() -> None:
    system = tower().system.with_changes(member_class=("cable",) * 18)
    with pytest.raises(StructureError, match="not the tendons"):
        SymmetricTower(system)
    with pytest.raises(StructureError, match="not the bars"):
        SymmetricTower(
            tower().system.with_changes(bodies=tower().system.bodies[:1] + tower().system.bodies[-1:])
        )
