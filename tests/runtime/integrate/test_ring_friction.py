"""Motions of cables with friction at rings: closed forms, orders through slip, energy, another program."""

from itertools import pairwise
from math import exp, log, pi, radians
from typing import Any

import numpy as np
import pytest
from scipy.sparse import issparse

from tensegrity_codegen.pipeline.analyses import find_needs
from tensegrity_codegen.runtime.accuracy.choice import integrators_for
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.simulate.simulate_batch import simulate_batch
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.models import simulator
from tests.ring_cases import GRAVITY, Array, Motion, make_atwood, make_garland, make_loop, make_swing
from tests.scene.samples import build
from tests.symbolic.test_node_position import Evaluator

METHODS = ("rk54", "tsit5", "rk853", "rodas", "radau")
ATWOOD = 0.123805064269  # m/s2: mu 0.05 over pi


def move(model: CompiledModel, times: Any, method: str, rtol: float, **more: Any) -> Trajectory:
    stepping = Stepping(atol=1e-2 * rtol, control="steps")
    samples = np.array(times, dtype=float)
    return simulate(model, samples[-1], samples=samples, method=method, rtol=rtol, stepping=stepping, **more)


def compute(model: CompiledModel, name: str, motion: Trajectory, **given: Array) -> Array:
    """Return a quantity at all samples; given: arguments, a row a sample."""
    assert motion.internal is not None
    rows = {
        "coordinate": motion.coordinate,
        "velocity": motion.velocity,
        "internal": motion.internal,
        **given,
    }
    each = ({key: value[k] for key, value in rows.items() if len(value[k])} for k in range(len(motion.time)))
    return np.array([np.ravel(model.compute(name, **row)) for row in each])


def find_nodes(kinks: Any) -> tuple[Array, Array]:
    """Return abscissas and weights of Gauss's rule between kinks, in parts that halve towards these."""
    x, weight = np.polynomial.legendre.leggauss(12)
    places, weights = [], []
    half = np.concatenate([[0.0], 0.5 ** np.arange(14, 0, -1)])
    grade = np.concatenate([half, (1.0 - half[:-1])[::-1]])
    for begin, end in pairwise(sorted(set(kinks))):
        for low, high in pairwise(begin + (end - begin) * grade):
            places.append(low + (x + 1.0) * (high - low) / 2.0)
            weights.append(weight * (high - low) / 2.0)
    return np.concatenate(places), np.concatenate(weights)


@pytest.fixture(scope="module")
def swing() -> CompiledModel:
    more = ("state_derivative", "state_jacobian", "input_jacobian", "energy_rate", "friction_power")
    return simulator(make_swing(), *METHODS, more=(*more, "ring_margin", "ring_ratio"))


@pytest.fixture(scope="module")
def exact() -> dict[float, Array]:
    """States of the swing at 0.5 s and 0.9 s by another program."""
    other = Motion(make_swing())
    first = other.integrate(0.5, rtol=1e-13)
    return {0.5: first, 0.9: other.integrate(0.9, begin=(0.5, first))}


THREE = ("rk853", "rodas", "radau")
GARLAND = (
    *("state_derivative", "state_jacobian", "ring_margin", "ring_ratio", "friction_power", "energy_rate"),
    *("member_length", "elastic_energy"),
)


@pytest.fixture(scope="module")
def garland() -> CompiledModel:
    """Three rings: one library for all tests of them."""
    return simulator(make_garland(3), *THREE, more=GARLAND)


@pytest.mark.parametrize("wrap_deg", [0.0, 180.0])
def test_two_masses_over_a_ring_accelerate_as_the_capstan_says(wrap_deg: float) -> None:
    """a = g (1.2 - E) / (1.2 + E); from the tensions of this motion, so that only damping disturbs it."""
    ratio = exp(0.05 * pi)
    assert GRAVITY * (1.2 - ratio) / (1.2 + ratio) == pytest.approx(ATWOOD, rel=1e-11)
    pull = {"left": GRAVITY + ATWOOD, "right": 1.2 * (GRAVITY - ATWOOD)}
    more = ("acceleration", "friction_power")
    model = simulator(make_atwood(0.05, wrap_deg, 1e8, **pull), "rodas", more=more)
    motion = move(model, np.linspace(0.0, 0.5, 11), "rodas", 1e-9)
    assert motion.status == "ok"
    assert compute(model, "acceleration", motion)[-1] == pytest.approx([ATWOOD, -ATWOOD], rel=5e-7)
    assert motion.velocity[-1] == pytest.approx([0.5 * ATWOOD, -0.5 * ATWOOD], rel=1e-5)
    tension = motion.member_tension
    assert motion.internal is not None
    assert tension[1:, 1] / tension[1:, 0] == pytest.approx(ratio, rel=1e-12)
    power = compute(model, "friction_power", motion)[1:, 0]
    assert (power < 0.0).all()
    # Rest lengths slide with the masses: the difference of the tensions times their speed is lost.
    assert power[-1] == pytest.approx(-(tension[-1, 1] - tension[-1, 0]) * motion.velocity[-1, 0], rel=1e-5)


@pytest.mark.parametrize("method", THREE)
def test_it_sticks_where_the_friction_is_above_the_limit(method: str) -> None:
    """ln(1.2) / pi is 0.05804: 0.0581 holds the masses at rest, 0.0580 does not."""
    assert 0.0580 < log(1.2) / pi < 0.0581
    for friction, slips in ((0.0581, False), (0.0580, True)):
        rest = make_atwood(friction, left=GRAVITY, right=1.2 * GRAVITY)
        motion = move(simulator(rest, *THREE), [0.0, 0.5, 1.0], method, 1e-9)
        assert motion.internal is not None
        assert motion.log.count == 0
        assert (motion.internal[-1, 0] > 1e-4) == slips
        assert (abs(motion.velocity[-1]) > 1e-4).all() == slips
        if not slips:
            assert motion.internal[-1, 0] == 0.0
            assert np.abs(motion.velocity).max() < 1e-9


@pytest.mark.parametrize("method", METHODS)
def test_a_swing_moves_as_an_independent_program_says(
    swing: CompiledModel, exact: dict[float, Array], method: str
) -> None:
    """Twelve times it slips, sticks, goes slack or taut: two masses on one cable over a ring in springs."""
    end, n = exact[0.9], make_swing().n_coordinates
    motion = move(swing, np.linspace(0.0, 0.9, 46), method, 1e-10)
    assert motion.status == "ok"
    assert motion.log.kind == (*("ring",) * 5, *("cable",) * 2, *("ring",) * 4, "cable")
    assert set(motion.log.name) == {"rope_1"}
    assert motion.log.direction.tolist() == [-1, 1, -1, 1, -1, -1, 1, 1, -1, 1, -1, -1]
    assert motion.internal is not None
    assert motion.coordinate[-1] == pytest.approx(end[:n], abs=3e-10)
    assert motion.velocity[-1] == pytest.approx(end[n:-1], abs=3e-9)
    assert motion.internal[-1] == pytest.approx(end[-1:], abs=3e-10)
    # At the limit while it slips, exactly; below it while it sticks.
    before, behind = motion.member_tension[:, 1:3].T
    ratio, margin = (compute(swing, name, motion)[:, 0] for name in ("ring_ratio", "ring_margin"))
    larger, least = np.maximum(before, behind), np.minimum(before, behind)
    slips = (margin < 0.0) & (least > 0.0)
    sticks = margin > 0.0
    assert min(slips.sum(), sticks.sum()) > 5
    assert larger[slips] == pytest.approx((ratio * least)[slips], rel=1e-12)
    assert (larger[sticks] < (ratio * least)[sticks]).all()
    fixed = np.diff(motion.internal[:, 0])[sticks[1:] & sticks[:-1]]
    assert (fixed == 0.0).sum() > 3


@pytest.mark.parametrize("methods", [THREE[:2], *thorough((METHODS,))])
def test_the_methods_agree_through_several_rings_and_slack_strands(methods: tuple[str, ...]) -> None:
    """Two rings, one of them with an angle of its own, by C and by SciPy with another solver."""
    garland = make_garland(2)
    other, model = Motion(garland), simulator(garland, *methods, more=("ring_ratio",))
    exact = other.integrate(0.4, rtol=1e-10)
    for method in methods:
        motion = move(model, [0.0, 0.2, 0.4], method, 1e-10)
        assert motion.status == "ok"
        assert {"ring", "cable"} == set(motion.log.kind)
        assert motion.coordinate[-1] == pytest.approx(exact[: other.n], abs=1e-8)
        assert motion.internal is not None
        assert motion.internal[-1] == pytest.approx(exact[2 * other.n :], abs=1e-8)


@pytest.mark.parametrize(("rings", "t_end", "events"), [(3, 0.1, 3), *thorough((3, 0.3, 9), (4, 0.3, 9))])
def test_three_methods_agree_through_three_and_four_rings(rings: int, t_end: float, events: int) -> None:
    """Slip that nearly stands still is stiff: methods for stiff equations take a hundredth of the steps."""
    model = simulator(make_garland(rings), *THREE, more=GARLAND)
    first, *others = [move(model, [0.0, t_end], method, 1e-9) for method in THREE]
    assert first.log.count >= events
    assert {"ring", "cable"} == set(first.log.kind)
    for motion in others:
        assert motion.log.kind == first.log.kind
        assert motion.coordinate[-1] == pytest.approx(first.coordinate[-1], abs=1e-7)


@pytest.mark.parametrize(("method", "least"), [("rk54", 4.8), ("tsit5", 4.8), ("rk853", 7.5)])
def test_orders_hold_through_slip_and_stick(
    swing: CompiledModel, exact: dict[float, Array], method: str, least: float
) -> None:
    """Error over the number of steps, with the tolerance, through nine events up to 0.5 s."""
    end = exact[0.5][: make_swing().n_coordinates]
    runs = [move(swing, [0.0, 0.5], method, rtol) for rtol in (1e-6, 1e-7, 1e-8, 1e-9)]
    assert all(run.log.count == 9 for run in runs)
    errors = [float(np.abs(run.coordinate[-1] - end).max()) for run in runs]
    order = np.polyfit(np.log([run.n_steps for run in runs]), np.log(errors), 1)[0]
    assert -order > least


def test_the_energy_changes_by_what_friction_and_damping_take(swing: CompiledModel) -> None:
    """The integral of `energy_rate` between the kinks, by Gauss's rule, is the change of the total energy."""
    first = move(swing, [0.0, 0.85], "rk853", 1e-12)
    times, weights = find_nodes([0.0, *first.log.time.tolist(), 0.85])
    motion = move(swing, [0.0, *times, 0.85], "rk853", 1e-12)
    rate = compute(swing, "energy_rate", motion)[1:-1, 0]
    change = motion.total_energy[-1] - motion.total_energy[0]
    assert change < -0.5
    assert weights @ rate == pytest.approx(change, rel=1e-9)


def test_the_loop_of_a_winch_has_the_area_that_friction_takes() -> None:
    """A winch draws to and fro over a held ring: the area over a steady period is what friction takes."""
    model = simulator(make_loop(), "rk853", more=("energy_rate", "friction_power"))
    period, size = 2.0, 0.04
    knots = period * np.arange(0.0, 3.25, 0.25)
    value = size * np.array([0.0, *[1.0, 0.0, -1.0, 0.0] * 3])
    winch = Profile(knots, {"winch": value})
    first = move(model, [0.0, knots[-1]], "rk853", 1e-12, schedule=winch)
    late = [time for time in first.log.time if time > 2.0 * period]
    assert len(late) == 4
    times, weights = find_nodes([*knots[8:], *late])
    motion = move(model, [0.0, *times, knots[-1]], "rk853", 1e-12, schedule=winch)
    u = np.interp(motion.time, knots, value)
    rate = np.diff(value)[np.searchsorted(knots, times) - 1] / (0.25 * period)
    assert motion.internal is not None
    one = make_loop()
    e = one.member_name.index("rope_1")
    rest = one.rest_length[e] + u - motion.internal[:, 0]
    elastic = one.axial_stiffness[e] * (one.member_length()[e] - rest) / rest
    # A metre of material that the winch lets out takes its strain energy with it.
    force = elastic + elastic**2 / (2.0 * one.axial_stiffness[e])
    area = -weights @ (force[1:-1] * rate)
    lost, slip = (
        -compute(model, name, motion, input=u[:, None])[1:-1, 0] for name in ("energy_rate", "friction_power")
    )
    assert (slip >= 0.0).all()
    assert (lost >= slip).all()  # the rest is what damping of the strands takes
    assert area > 2.0
    assert area == pytest.approx(weights @ lost, rel=1e-9)


def test_jacobians_are_those_of_an_independent_program_by_complex_steps(swing: CompiledModel) -> None:
    """One ring that slips forth, slips back, sticks: state and input, to twelve digits."""
    other, rng = Motion(make_swing()), np.random.default_rng(0)
    n, step, modes = other.n, 1e-30, set()
    for _ in range(60):
        state = other.start() + 0.1 * rng.normal(size=2 * n + 1)
        u = 0.05 * rng.normal()
        tension, _, flow, _ = other.solve(state, u)
        if min(tension[1:3]) <= 0.0:
            continue
        modes.add(int(np.sign(flow[0])))
        given = {"coordinate": state[:n], "velocity": state[n:-1], "internal": state[-1:], "input": [u]}
        found = np.ravel(swing.compute("state_derivative", **given))
        np.testing.assert_allclose(found, other.rate(0.0, state, u), rtol=0, atol=1e-11)
        shifted = state + 1j * step * np.eye(2 * n + 1)
        columns = np.array([other.rate(0.0, row, u).imag / step for row in shifted]).T
        jacobian = swing.compute("state_jacobian", **given).toarray()
        np.testing.assert_allclose(jacobian, columns, rtol=1e-12, atol=1e-12 * np.abs(columns).max())
        by_input = other.rate(0.0, state.astype(complex), u + 1j * step).imag / step
        column = swing.compute("input_jacobian", **given).toarray().ravel()
        np.testing.assert_allclose(column, by_input, rtol=1e-12, atol=1e-12 * np.abs(by_input).max())
    assert modes == {-1, 0, 1}


def test_the_jacobian_of_three_rings_is_that_of_differences(garland: CompiledModel) -> None:
    other, rng, step = Motion(make_garland(3)), np.random.default_rng(5), 1e-6
    n, seen = other.n, set()
    for _ in range(30):
        state = other.start() + 0.1 * rng.normal(size=2 * n + 3)

        def rate(x: Array) -> Array:
            given = {"coordinate": x[:n], "velocity": x[n : 2 * n], "internal": x[2 * n :]}
            return np.ravel(garland.compute("state_derivative", **given))

        np.testing.assert_allclose(rate(state), other.rate(0.0, state), rtol=1e-9, atol=1e-9)
        columns, other_columns = (
            np.array(
                [(rate(state + row) - rate(state - row)) / (2.0 * h) for row in h * np.eye(len(state))]
            ).T
            for h in (step, 0.5 * step)
        )
        if np.abs(columns - other_columns).max() > 1e-6 * np.abs(columns).max():
            continue  # a kink lies between
        given = {"coordinate": state[:n], "velocity": state[n : 2 * n], "internal": state[2 * n :]}
        found = garland.compute("state_jacobian", **given).toarray()
        np.testing.assert_allclose(found, columns, rtol=1e-6, atol=1e-6 * np.abs(columns).max())
        seen.add(tuple(np.sign(other.solve(state)[2]).tolist()))
    assert len(seen) > 5


def test_the_code_in_c_computes_what_the_expressions_say(garland: CompiledModel) -> None:
    symbolic, rng = Evaluator(make_garland(3)), np.random.default_rng(3)
    for name in GARLAND[:6]:
        for _ in range(20):
            given = {
                key: value + 0.1 * rng.normal(size=value.shape) for key, value in symbolic.nominal.items()
            }
            expected, found = symbolic(name, **given), garland.compute(name, **given)
            found = np.reshape(found.toarray() if issparse(found) else found, expected.shape)
            size = np.abs(expected).max() + 1e-300
            np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13 * size)


def test_many_motions_go_side_by_side() -> None:
    model = simulator(make_swing(), "rk853", batch_width=8)
    speeds = np.random.default_rng(1).normal(size=(5, 6))
    batch = simulate_batch(model, 0.3, velocity=speeds, samples=3, method="rk853", rtol=1e-10)
    assert batch.internal is not None
    for k, speed in enumerate(speeds):
        one = move(model, [0.0, 0.15, 0.3], "rk853", 1e-12, velocity=speed)
        assert batch.status[k] == "ok"
        assert batch.coordinate[k] == pytest.approx(one.coordinate, abs=1e-6)
        assert batch.internal[k] == pytest.approx(one.internal, abs=1e-6)


def test_rigid_bars_stand_beside_cables_with_friction() -> None:
    """The same motion with bars of any length of their own: rigid ones, by three methods."""
    structure = make_swing()
    rigid = structure.with_changes(spring_constant=np.where(structure.is_bar, 0.0, structure.spring_constant))
    length = rigid.member_length()
    rigid = rigid.with_changes(rest_length=np.where(rigid.is_bar, length, rigid.rest_length))
    place = np.zeros_like(rigid.node_velocity)
    rigid = rigid.with_changes(node_velocity=place)
    model = simulator(rigid, "rk853", "rk54", "rodas", formulation="rigid_bar")
    found = [move(model, [0.0, 0.4], method, 1e-10) for method in ("rk853", "rk54", "rodas")]
    assert "ring" in found[0].log.kind
    for motion in found[1:]:
        assert motion.status == "ok"
        assert motion.coordinate[-1] == pytest.approx(found[0].coordinate[-1], abs=1e-8)


def test_derivatives_of_a_motion_pass_through_slip(swing: CompiledModel) -> None:
    """By the velocities at the start, through ten events, against differences of fourth order."""
    model = simulator(make_swing(), "rk853", columns=("velocity",))
    motion = move(model, [0.0, 0.6], "rk853", 1e-11)
    assert motion.columns is not None
    assert motion.log.count == 10
    start, step = model.nominal("velocity"), 1e-4

    def end(k: int, change: float) -> Array:
        speed = start + change * np.eye(len(start))[k]
        one = move(swing, [0.0, 0.6], "rk853", 1e-12, velocity=speed)
        assert one.internal is not None
        return np.concatenate([one.coordinate[-1], one.velocity[-1], one.internal[-1]])

    for k in range(len(start)):
        near, far = end(k, step) - end(k, -step), end(k, 2 * step) - end(k, -2 * step)
        expected = (8.0 * near - far) / (12.0 * step)
        assert motion.columns[-1][:, k] == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("request_of", "word"),
    [
        ({"emitter": "table"}, "friction at rings is not supported here: emitter 'table'"),
        ({"keep": ("energy",)}, "energy that is kept"),
        ({"solvers": ("equilibrium",)}, "solvers in C"),
        ({"formulation": "node_distance"}, "formulation 'node_distance'"),
        ({"more": ("rest_length_jacobian",)}, "rest_length_jacobian"),
    ],
)
def test_what_does_not_know_friction_at_rings_is_refused(request_of: dict[str, Any], word: str) -> None:
    with pytest.raises(FormulationError, match=word) as caught:
        simulator(make_swing(), "rk54", **request_of)
    assert caught.value.where == "swing: members.rope.friction"


@pytest.mark.parametrize(
    "analysis",
    ["sensitivity", "load_path", "analyse", "plan", "time_motion", "control"],
)
def test_analyses_without_friction_at_rings_say_so(analysis: str) -> None:
    with pytest.raises(FormulationError, match=f"not supported here: the analysis '{analysis}'"):
        find_needs(analysis, make_swing(), ModelRequest(()))


def test_methods_of_scipy_are_refused(swing: CompiledModel) -> None:
    with pytest.raises(FormulationError, match="SciPy know no internal states"):
        simulate(swing, 0.01, method="scipy_dop853")


def test_a_stated_angle_takes_the_place_of_that_between_the_strands() -> None:
    model = simulator(make_garland(2), *THREE[:2], more=("ring_ratio",))
    ratio = np.ravel(model.compute("ring_ratio"))
    ends = make_garland(2).node_position
    one, two = ends[0] - ends[4], ends[1] - ends[0]  # strands at the first ring
    assert make_garland(2).node_name[:5] == ("r1", "r2", "h1", "h2", "a")
    turn = np.arccos(one @ two / np.linalg.norm(one) / np.linalg.norm(two))
    assert ratio == pytest.approx([exp(0.1 * turn), exp(0.15 * radians(90.0))], rel=1e-13)


def test_strands_keep_the_rest_length_together(garland: CompiledModel) -> None:
    """What has slid leaves one strand and enters the next: their tensions say so at every sample."""
    structure = make_garland(3)
    motion = move(garland, np.linspace(0.0, 0.1, 6), "rodas", 1e-9)
    assert motion.internal is not None
    (cable,) = structure.sliding
    rows = list(cable.members)
    slid = np.pad(motion.internal, ((0, 0), (1, 1)))
    rest = structure.rest_length[rows] + slid[:, :-1] - slid[:, 1:]
    assert rest.sum(axis=1) == pytest.approx(structure.rest_length[rows].sum(), rel=1e-14)
    length = compute(garland, "member_length", motion)
    x = np.maximum(length[:, rows] - rest, 0.0)
    bars = np.flatnonzero(structure.is_bar)
    stored = 0.5 * structure.axial_stiffness[rows] * x**2 / rest
    springs = 0.5 * structure.spring_constant[bars] * (length[:, bars] - structure.rest_length[bars]) ** 2
    expected = stored.sum(axis=1) + springs.sum(axis=1)
    assert compute(garland, "elastic_energy", motion)[:, 0] == pytest.approx(expected, rel=1e-12)


@pytest.fixture(scope="module")
def falling() -> CompiledModel:
    """Return a mass on a cable over a held ring to a held end; the strand there gives all that it has."""
    rope = {
        "kind": "cable", "nodes": ["mass", "ring", "end"], "axial_stiffness": 1334.0, "rest_length": 2.1257,
        "damping": 2.563, "friction": [0.23],
    }  # fmt: skip
    nodes = {
        "mass": {
            "position": [-1.1148, -0.0384, -0.0634],
            "mass": 0.2117,
            "velocity": [0.1211, 0.1533, -0.9502],
        },
        "ring": {"position": [-0.0767, 0.1147, -0.3632], "anchored": True},
        "end": {"position": [0.9373, -0.148, -0.2076], "anchored": True},
    }
    gravity = [-0.1224, 0.0, -12.56]
    scene = {"name": "fall", "gravity": gravity, "nodes": nodes, "members": {"rope": rope}}
    return simulator(build(scene)[0], "rk54", "rk853")


@pytest.mark.parametrize("method", ["rk54", "rk853"])
def test_a_strand_that_stands_at_its_rest_length_holds_up_no_run(falling: CompiledModel, method: str) -> None:
    """Its margin is rounding, and long steps in the air are far beyond what any error estimate knows."""
    times = [0.0, 0.2, 0.3, 0.5]
    exact = move(falling, times, "rk853", 1e-12)
    for rtol in (1e-4, 1e-6, 1e-7, 1e-9):
        found = move(falling, times, method, rtol)
        assert found.status == "ok", found.message
        assert found.n_steps < 2000
        np.testing.assert_allclose(found.coordinate, exact.coordinate, rtol=0, atol=30.0 * rtol)


def test_auto_takes_rodas_where_slack_strands_give_their_material_in_no_time() -> None:
    """Up to 0.3 s `rk54` takes 36,253 steps, and half a million up to 0.5 s."""
    held: dict[str, Any] = {"anchored": True}
    nodes = {
        "n0": {"position": [-0.816, -0.151], "mass": 0.246, "velocity": [-0.0561, 0.747]},
        "n1": {"position": [-0.777, 0.235], "mass": 0.455, "velocity": [-0.379, 0.463]},
        "n2": {"position": [0.124, -0.0304], "mass": 3.76, "velocity": [-1.51, 0.395]},
        "n3": {"position": [0.399, -0.288], **held},
        "n4": {"position": [0.821, -0.288], "mass": 0.457, "velocity": [-0.744, 0.385]},
    }
    hangers = [
        ("bar", "n0", [-0.529, 0.229], 34.9, 0.479, 0.295),
        ("cable", "n1", [-0.678, 1.17], 72.9, 0.952, 0.728),
        ("cable", "n1", [-0.727, 0.946], 313.0, 0.575, 0.722),
        ("cable", "n2", [0.284, 0.852], 46.8, 0.666, 0.18),
        ("cable", "n4", [0.721, 0.524], 72.4, 0.538, 0.765),
        ("cable", "n4", [0.471, 0.451], 237.0, 0.501, 0.825),
    ]
    rope = {"kind": "cable", "nodes": list(nodes), "axial_stiffness": 132.0, "rest_length": 1.98}
    members: dict[str, Any] = {"rope": rope | {"damping": 1.68, "friction": [0.377, 0.272, 0.434]}}
    for k, (kind, node, place, stiffness, rest, damping) in enumerate(hangers):
        nodes[f"s{k}"] = {"position": place, **held}
        law = {"spring_constant": stiffness, "rest_length": rest, "damping": damping}
        members[f"h{k}"] = {"kind": kind, "nodes": [node, f"s{k}"], **law}
    scene = {"name": "hard", "axes": "xz", "gravity": [0.0, -9.81], "nodes": nodes, "members": members}
    structure = build(scene)[0]
    assert integrators_for("auto", structure) == ("rk54", "rodas")
    model = simulator(structure, "rk54", "rodas")
    found = simulate(model, 0.3, samples=5, rtol=1e-6)
    assert (found.status, found.method) == ("ok", "auto (rodas, tolerance tightened)")
    assert found.n_steps < 3000
    assert found.coordinate[-1][:4] == pytest.approx(
        [-0.79506492, 0.51604525, -0.53022831, 0.37078268], abs=1e-6
    )
