"""Motions on the ground, against closed forms and against motions found by two programs to 12 digits.

Normal force: Hunt and Crossley, Journal of Applied Mechanics 42 (1975) 440. Friction: a bristle, a spring and
a damper side by side, in series with a slider of Coulomb friction; F <= mu N holds exactly. The numbers
without a closed form are from the same equations integrated by SciPy's DOP853 with located events and two
tolerances, 1e-9 and 1e-11.
"""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.read_trajectory import read_trajectory
from tensegrity_codegen.structure.structure import ActuatedInput
from tensegrity_codegen.tables.integrators import INTEGRATORS
from tests.cases import thorough
from tests.ground_cases import (
    GRAVITY,
    METHODS,
    compute_at,
    make_belt,
    make_block,
    make_icosahedron,
    make_prism,
    make_rod,
    make_slope,
    move,
)
from tests.models import simulator

Array = NDArray[np.float64]


@pytest.mark.parametrize("method", METHODS)
def test_a_block_sticks_on_a_slope_of_20_degrees(method: str) -> None:
    slope, down = make_slope(np.radians(20.0))
    model, motion = move(slope, method, [0.0, 2.0])
    offset = GRAVITY * np.sin(np.radians(20.0)) / 1e5  # m g sin / kt
    assert motion.node_position[-1, 0] @ down == pytest.approx(offset, rel=1e-12)
    assert abs(motion.node_velocity[-1, 0] @ down) < 1e-15
    force = compute_at(model, motion, "contact_force", -1)[0]
    np.testing.assert_allclose(force, [0.0, 0.0, GRAVITY], atol=1e-10)
    assert motion.log.count == 0


@pytest.mark.parametrize("method", METHODS)
def test_a_block_slips_on_a_slope_of_30_degrees(method: str) -> None:
    slope, down = make_slope(np.radians(30.0))
    _, motion = move(slope, method, [0.0, 2.0])
    assert motion.node_position[-1, 0] @ down == pytest.approx(1.3266802926541, rel=1e-11)
    assert motion.node_velocity[-1, 0] @ down == pytest.approx(1.3204886374288, rel=1e-11)
    assert (motion.log.kind, motion.log.direction.tolist()) == (("stick",), [-1])
    assert motion.log.time[0] == pytest.approx(0.00312515239373, rel=1e-10)


@pytest.mark.parametrize("method", METHODS)
def test_a_ball_bounces_with_the_restitution_of_its_speed(method: str) -> None:
    factor = 0.311252583112
    ball = make_block([0.0, 0.0, 0.5], dissipation=factor)
    _, motion = move(ball, method, [0.0, 0.9, 2.0], rtol=1e-13)
    np.testing.assert_allclose(motion.node_position[1:, 0, 2], [0.077226660238, 0.00133266944494], rtol=1e-9)
    ground = np.array(motion.log.kind) == "ground"
    times, turns = motion.log.time[ground], motion.log.direction[ground]
    np.testing.assert_allclose(times[:2], [np.sqrt(2 * 0.5 / GRAVITY), 0.329547481086], rtol=1e-11)
    assert (turns == 1).sum() == 10
    assert np.all(turns == np.resize([1, -1], len(turns)))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_restitution_without_weight_is_a_closed_form(method: str, exponent: float) -> None:
    """v_o/a + ln(1 - a v_o)/a^2 = -(v_i/a - ln(1 + a v_i)/a^2), for any k and p (Hunt and Crossley 1975)."""
    a, v_in = 0.311252583112, 5.0
    ball = make_block([0.0, 0.0, 0.01], gravity=0.0, exponent=exponent, dissipation=a, friction=0.0)
    _, motion = move(ball, method, [0.0, 0.5], velocity=[0.0, 0.0, -v_in])
    v_out = float(motion.velocity[-1, 2])
    left = v_out / a + np.log(1 - a * v_out) / a**2
    assert left == pytest.approx(-(v_in / a - np.log(1 + a * v_in) / a**2), rel=1e-9)
    assert v_out / v_in == pytest.approx(0.4779, abs=5e-5)


@pytest.mark.parametrize("method", METHODS)
def test_a_rod_falls_slips_and_rests_on_its_other_end(method: str) -> None:
    _, motion = move(make_rod(), method, [0.0, 0.3, 0.4])
    centre, span = motion.node_position.mean(axis=1), np.diff(motion.node_position, axis=1)[:, 0]
    rate, turn = motion.node_velocity.mean(axis=1), np.diff(motion.node_velocity, axis=1)[:, 0]
    angle = np.arctan2(span[:, 2], span[:, 0])
    spin = span[:, 0] * turn[:, 2] - span[:, 2] * turn[:, 0]
    found = [*centre[1, ::2], angle[1], *rate[1, ::2], spin[1], *centre[2, ::2]]
    expected = [0.450435465242, 0.177463125872, 0.21658276417, 0.297663920198, -1.77696061716, -5.18673038702]
    np.testing.assert_allclose(found, [*expected, 0.471672799761, 0.0314634318143], rtol=1e-10)
    assert angle[2] == pytest.approx(0.0014294551004, abs=1e-12)
    log = list(zip(motion.log.kind, motion.log.name, motion.log.direction.tolist(), strict=True))
    assert log[2:5] == [("stick", "n0", -1), ("ground", "n0", -1), ("ground", "n1", 1)]
    np.testing.assert_allclose(
        motion.log.time[[0, 2, 3, 4]], [0.238924, 0.240974, 0.245161, 0.357153], atol=5e-7
    )


@pytest.mark.parametrize("method", METHODS)
def test_a_curved_slide_stops_for_good(method: str) -> None:
    rest = -GRAVITY / 1e5
    block = make_block([0.0, 0.0, rest], load=(0.5, 0.0, 0.0), friction=0.3, stick_damping=200.0)
    _, motion = move(block, method, [0.0, 1.5, 3.0], velocity=[1.0, 2.0, 0.0])
    np.testing.assert_allclose(
        motion.node_position[1:, 0, :2], np.tile([0.480339374882, 0.794369623386], (2, 1)), rtol=1e-10
    )
    assert motion.internal is not None
    np.testing.assert_allclose(motion.internal[-1], [5e-6, 0.0], atol=1e-14)  # F / kt
    lost = motion.total_energy[0] - motion.total_energy[-1]
    assert lost == pytest.approx(2.74016843744, rel=1e-10)


@pytest.mark.parametrize("method", METHODS)
def test_a_fast_belt_pulls_with_constant_friction(method: str) -> None:
    """x = (mu N / k) (1 - cos(w t)) while the belt is faster than the block."""
    times = np.linspace(0.0, 1.0, 6)
    _, motion = move(make_belt(2.0), method, times)
    np.testing.assert_allclose(motion.node_position[:, 0, 0], 0.04 * (1 - np.cos(10 * times)), atol=1e-12)
    assert motion.status == "ok"


@pytest.mark.parametrize("method", METHODS)
def test_a_slow_belt_carries_the_block_until_the_spring_wins(method: str) -> None:
    """It then swings about mu N / k with the amplitude V / w that it has when it comes loose."""
    _, motion = move(make_belt(0.2), method, [0.0, 0.15, 3.0])
    middle, amplitude = 0.04, 0.2 / 10.0
    assert motion.velocity[1, 0] == pytest.approx(0.2, abs=2e-3)
    reach = np.hypot(motion.coordinate[-1, 0] - middle, motion.velocity[-1, 0] / 10.0)
    assert reach == pytest.approx(amplitude, rel=2e-2)  # the bristle is not rigid


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("stiffness", "damping", "period", "near"),
    [(1e4, 100.0, 0.6711454574, 1e-9), (1e6, 1e3, 0.671238898038, 1e-6)],
)
def test_a_belt_with_static_friction_sticks_and_slips(
    method: str, stiffness: float, damping: float, period: float, near: float
) -> None:
    """Rigid bristle: T = (2/w) (pi - atan(dF w / (k v))) + 2 dF / (k v), dF = (mu_s - mu) N.

    The amplitude tends to sqrt((dF / k)^2 + (v / w)^2) = 0.0282842712475 m.
    """
    belt = make_belt(0.2, static_friction=0.6, stick_stiffness=stiffness, stick_damping=damping)
    _, motion = move(belt, method, np.linspace(0.0, 4.0, 2001), rtol=1e-10, atol=1e-13)
    log = zip(motion.log.time, motion.log.kind, motion.log.direction, strict=True)
    slips = [time for time, kind, direction in log if (kind, direction) == ("stick", -1)]
    assert np.diff(slips)[-2:] == pytest.approx(np.full(2, period), rel=near)
    assert np.ptp(motion.coordinate[1000:, 0]) / 2 == pytest.approx(0.0282842712475, rel=1e-2)
    assert belt.internal_name == ("n0_stick1", "n0_stick2", "n0_slips")
    assert motion.internal is not None
    assert set(np.unique(np.round(motion.internal[:, 2], 9))) == {0.0, 1.0}


@pytest.mark.parametrize("method", METHODS)
def test_static_friction_holds_on_a_slope_that_friction_would_not(method: str) -> None:
    """tan 30 degrees is 0.577: between 0.5 and 0.6; once it slips it goes on, as with 0.5 alone."""
    angle = np.radians(30.0)
    stuck = GRAVITY * np.sin(angle) / 1e5
    slope, down = make_slope(angle, static_friction=0.6)
    _, still = move(slope, method, [0.0, 2.0], arguments={"internal": [stuck, 0.0, 0.0]})
    assert np.abs(still.velocity).max() < 1e-12
    rate = GRAVITY * (np.sin(angle) - 0.5 * np.cos(angle))
    velocity = np.concatenate([1.0 * down])
    _, slid = move(slope, method, [0.0, 1.0], velocity=velocity)
    assert slid.node_velocity[-1, 0] @ down == pytest.approx(1.0 + rate, rel=1e-3)
    assert still.log.count == 0


@pytest.mark.parametrize("method", [METHODS[1], *thorough(METHODS[0])])
def test_an_icosahedron_stands_on_three_feet(method: str) -> None:
    times = [0.0, 6.0]
    model, motion = move(make_icosahedron(), method, times, rtol=1e-10, atol=1e-13, integrators=(method,))
    assert motion.internal is None
    force = compute_at(model, motion, "contact_force", -1)
    feet = force[:, 2] > 0.0
    np.testing.assert_allclose(force[feet, 2], np.full(3, 12 * 0.05 * GRAVITY / 3), rtol=1e-8)
    assert not force[~feet].any()
    assert motion.node_position[-1].mean(axis=0)[2] == pytest.approx(0.2083229558, abs=2e-10)


PRISM_TIMES = (0.0, 0.33, 0.4, 0.5, 0.6)
IMPLICIT = ("rodas", "radau")  # of order five: a looser tolerance, so that their steps are not too many


@pytest.mark.parametrize("method", METHODS)
def test_an_upright_prism_lands_on_three_feet_at_once(method: str) -> None:
    rtol = 1e-10 if method in IMPLICIT else 1e-12
    _, motion = move(make_prism(), method, PRISM_TIMES, rtol=rtol, atol=0.01 * rtol)
    centre = motion.node_position.mean(axis=1)
    expected = [0.19239413106, 0.23075183622, 0.21352514159, 0.20482617638]
    np.testing.assert_allclose(centre[1:, 2], expected, rtol=1e-9)
    assert np.abs(centre[:, :2]).max() < 1e-12
    assert motion.log.kind[:6] == ("ground",) * 3 + ("stick",) * 3
    assert set(motion.log.name[:6]) == {"n0", "n1", "n2"}
    np.testing.assert_allclose(motion.log.time[:6], np.sqrt(2 * 0.5 / GRAVITY), rtol=1e-10)


def rotate(angles: tuple[float, float, float]) -> Array:
    """Return the rotation by angles [rad] about z, y and x."""
    result = np.eye(3)
    for axis, angle in zip((2, 1, 0), angles, strict=True):
        turn, (i, j) = np.eye(3), [(1, 2), (2, 0), (0, 1)][axis]
        turn[[i, j], [i, j]] = np.cos(angle)
        turn[i, j], turn[j, i] = -np.sin(angle), np.sin(angle)
        result = result @ turn
    return result


@pytest.mark.parametrize("method", [METHODS[1], *thorough(METHODS[0], METHODS[2])])
@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_a_turned_and_renumbered_prism_moves_in_the_same_way(method: str, tilt: float) -> None:
    order = np.array([4, 2, 0, 5, 1, 3])
    about, tilted = rotate((0.7, 0.0, 0.0)), rotate((0.0, tilt, tilt / 2))
    _, motion = move(make_prism(tilted), method, PRISM_TIMES, integrators=(method,))
    _, turned = move(make_prism(about @ tilted, order), method, PRISM_TIMES, integrators=(method,))
    expected = (motion.node_position @ about.T)[:, order]
    np.testing.assert_allclose(turned.node_position, expected, atol=1e-10)
    assert motion.log.count == turned.log.count


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("rtol", [1e-3, 1e-4, *thorough(1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11)])
def test_no_tolerance_loses_a_contact(method: str, rtol: float) -> None:
    """Two tolerances can agree on a motion in which a foot went unnoticed: compare with a tight one."""
    prism = make_prism(rotate((0.0, 0.3, 0.2)))
    _, exact = move(prism, "rk853", PRISM_TIMES)
    _, motion = move(prism, method, PRISM_TIMES, rtol=rtol, atol=0.01 * rtol)
    assert motion.status == "ok"
    assert motion.log.count == exact.log.count
    assert np.abs(motion.node_position - exact.node_position).max() < rtol


@pytest.mark.parametrize("method", METHODS)
def test_friction_stays_within_the_cone_and_energy_only_falls(method: str) -> None:
    prism = make_prism(rotate((0.4, 0.3, 0.2)))
    rtol = 1e-10 if method in IMPLICIT else 1e-12
    model, motion = move(prism, method, np.linspace(0.0, 0.6, 301), rtol=rtol, atol=0.01 * rtol)
    seen = 0
    for row in range(len(motion.time)):
        force = compute_at(model, motion, "contact_force", row)
        friction, normal = np.hypot(force[:, 0], force[:, 1]), force[:, 2]
        assert np.all(friction <= 0.5 * normal * (1 + 1e-12))
        seen += int((normal > 0).sum())
    assert seen > 30
    assert np.diff(motion.total_energy).max() < 1e-9


def test_energy_lost_is_the_power_over_time() -> None:
    """E(t) - E(0) = integral of the power of friction, impacts and dampers."""
    times = np.linspace(0.3, 0.4, 2001)
    model, motion = move(make_prism(rotate((0.4, 0.3, 0.2))), "rk853", [0.0, *times])
    power = [float(compute_at(model, motion, "energy_rate", row + 1)) for row in range(len(times))]
    lost = np.sum((np.array(power[1:]) + np.array(power[:-1])) / 2) * (times[1] - times[0])
    change = motion.total_energy[-1] - motion.total_energy[1]
    assert change < -0.1
    assert change == pytest.approx(lost, rel=1e-4)  # of the trapezoidal rule, over kinks


@pytest.mark.parametrize("duration", [10.0, *thorough(1000.0)])
def test_a_block_rests_at_0_999_of_the_friction_cone(duration: float) -> None:
    angle = np.arctan(0.999 * 0.5)
    slope, _ = make_slope(angle)
    stuck = GRAVITY * np.sin(angle) / 1e5
    model, motion = move(slope, "rk853", [0.0, duration / 2, duration], arguments={"internal": [stuck, 0.0]})
    assert np.abs(motion.velocity).max() < 1e-12
    assert np.abs(motion.coordinate - motion.coordinate[0]).max() < 1e-12
    force = compute_at(model, motion, "contact_force", -1)
    np.testing.assert_allclose(force, [[0.0, 0.0, GRAVITY]], atol=1e-11)


@pytest.mark.parametrize("method", ["rodas", "radau"])
@pytest.mark.parametrize("stiffness", [1e4, 1e9])
def test_implicit_steps_at_rest_do_not_depend_on_the_stiffness(stiffness: float, method: str) -> None:
    """1,000 s at 0.999 of the cone in a few steps; explicit methods take sqrt(k / m) of them a second."""
    angle = np.arctan(0.999 * 0.5)
    normal = np.array([np.sin(angle), 0.0, np.cos(angle)])
    block = make_block(
        -GRAVITY * np.cos(angle) / stiffness * normal,
        normal=normal,
        stiffness=stiffness,
        stick_stiffness=stiffness,
        stick_damping=2.0 * np.sqrt(stiffness),
    )
    stuck = GRAVITY * np.sin(angle) / stiffness
    at = {"internal": [stuck, 0.0]}
    _, motion = move(block, method, [0.0, 500.0, 1000.0], rtol=1e-8, atol=1e-12, arguments=at)
    assert motion.status == "ok"
    assert motion.n_steps < 20
    assert np.abs(motion.velocity).max() < 1e-12
    assert np.abs(motion.coordinate - motion.coordinate[0]).max() < 1e-12


def test_an_implicit_run_without_events_counts_its_steps() -> None:
    """A block falls on the ground, over more steps than one call into C takes."""
    model = simulator(make_block([0.0, 0.0, 0.3]), "radau", events=())
    stepping = Stepping(control="steps")
    found = simulate(model, 0.5, samples=[0.0, 0.2, 0.5], method="radau", rtol=1e-8, stepping=stepping)
    assert found.status == "ok"
    assert found.node_position[1, 0, 2] == pytest.approx(0.3 - GRAVITY * 0.2**2 / 2, abs=1e-8)
    assert found.n_steps > 50


@pytest.mark.parametrize(
    ("method", "loose", "order"),
    [("rk54", 1e-8, 4.8), ("rk853", 1e-7, 7.5), ("rodas", 1e-6, 4.5), ("radau", 1e-6, 4.5)],
)
def test_errors_fall_with_the_order_through_38_events(method: str, loose: float, order: float) -> None:
    prism = make_prism(rotate((0.0, 0.3, 0.2)))
    _, exact = move(prism, "rk853", PRISM_TIMES, rtol=1e-13, atol=1e-16)
    found = []
    for rtol in (loose, 1e-3 * loose):
        _, motion = move(prism, method, PRISM_TIMES, rtol=rtol, atol=0.01 * rtol)
        found.append((np.abs(motion.node_position - exact.node_position).max(), motion.n_evaluations))
    (coarse, few), (fine, many) = found
    assert np.log(coarse / fine) / np.log(many / few) > order


@pytest.mark.parametrize("cycles", [100, 5_000, *thorough(100_000)])
def test_loads_inside_the_cone_move_nothing_in_the_long_run(cycles: int) -> None:
    """A push of 0.5 N to and fro, 50 times a second, where mu N is 4.9 N; LuGre friction drifts here."""
    push = ActuatedInput("push", "force", (0,), (1.0, 0.0, 0.0))
    block = make_block([0.0, 0.0, -GRAVITY / 1e5]).with_changes(inputs=(push,))
    model = simulator(block, "rk853")
    times = np.arange(4 * cycles + 1) * 0.005
    schedule = Profile(times, {"push": np.array([0.0, 0.5, 0.0, -0.5] * cycles + [0.0])})
    stepping = Stepping(atol=1e-14, control="steps", max_steps=10**7)
    samples = times[:: 2 * cycles]
    motion = simulate(
        model, times[-1], samples=samples, method="rk853", rtol=1e-10, schedule=schedule, stepping=stepping
    )
    assert motion.status == "ok"
    assert 1e-6 < abs(motion.coordinate[1, 0]) < 5e-6  # up to F / kt
    assert abs(motion.coordinate[2, 0] - motion.coordinate[1, 0]) < 1e-12
    assert motion.log.count == 0


def test_a_fixed_step_ends_at_events_too() -> None:
    rod = make_rod()
    _, exact = move(rod, "rk853", [0.0, 0.15, 0.3])
    model = simulator(rod, "rk4", formulation="rigid_bar")
    errors = []
    for step in (2e-4, 1e-4):
        stepping = Stepping(step=step, control="steps")
        motion = simulate(model, 0.3, samples=[0.0, 0.15, 0.3], method="rk4", stepping=stepping)
        errors.append(float(np.abs(motion.node_position - exact.node_position).max()))
    assert errors[1] < 1e-7
    assert errors[0] / errors[1] > 10.0  # order 4


def test_the_error_at_the_samples_is_held_by_default() -> None:
    prism = make_prism(rotate((0.0, 0.3, 0.2)))
    model, exact = move(prism, "rk853", PRISM_TIMES)
    motion = simulate(model, 0.6, samples=PRISM_TIMES, rtol=1e-7)
    assert motion.status == "ok"
    assert motion.error_estimate is not None
    assert motion.error_estimate <= 1.0
    assert np.abs(motion.node_position - exact.node_position).max() < 1e-6


def test_internal_states_are_in_the_file_of_a_motion_that_has_some(tmp_path: Any) -> None:
    _, motion = move(make_rod(), "rk54", [0.0, 0.3], rtol=1e-6)
    path = tmp_path / "rod.npz"
    motion.write(path)
    with np.load(path) as data:
        assert data["internal"].shape == (2, 2)
        assert data["internal_name"].tolist() == ["n0_stick1", "n1_stick1"]
    again = read_trajectory(path, make_rod())
    np.testing.assert_array_equal(again.internal, motion.internal)
    assert again.internal_name == motion.internal_name
    _, without = move(make_block([0.0, 0.0, 0.1], friction=0.0), "rk54", [0.0, 0.1], rtol=1e-6)
    without.write(tmp_path / "ball.npz")
    with np.load(tmp_path / "ball.npz") as data:
        assert "internal" not in data


def test_one_library_holds_all_integrators() -> None:
    model = simulator(make_rod(), *INTEGRATORS, formulation="rigid_bar")
    assert {spec.name for spec in model.manifest.integrators} == set(INTEGRATORS)
    ends = []
    for name in INTEGRATORS:
        stepping = Stepping(step=1e-5) if name == "rk4" else Stepping()
        ends.append(simulate(model, 0.3, method=name, rtol=1e-8, stepping=stepping).coordinate[-1])
    assert np.ptp(ends, axis=0).max() < 1e-7
