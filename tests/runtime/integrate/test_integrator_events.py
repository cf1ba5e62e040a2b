"""Steps that end where cables go slack or taut: order, times, symmetry, grazes, limits, conditions."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.codegen.integrators import events
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.accuracy.integrate import integrate_once
from tensegrity_codegen.runtime.integrate import c_run, event_log, event_run
from tensegrity_codegen.runtime.integrate.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.integrate.event_log import Watch
from tensegrity_codegen.runtime.integrate.integration import BoundIntegrator
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.trajectory.simulation_quantities import SIMULATION_QUANTITIES
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError, NonFiniteError
from tensegrity_codegen.tables.request import ModelRequest
from tests.common_prism import BARS, EVENTS, POSITION, common_prism
from tests.runtime.build import bar, cable, make_structure, prism, spring

METHODS = ("rk54", "rk853")
each = pytest.mark.parametrize("method", METHODS)
PLAIN = Watch()


def build(structure: Structure, *quantities: str, **options: Any) -> CompiledModel:
    request = ModelRequest((*SIMULATION_QUANTITIES, *quantities), integrators=METHODS, **options)
    return build_library(structure, request).load()


def run(
    method: str, model: CompiledModel, time: Any, tol: float, watch: Watch | None = None
) -> RawTrajectory:
    state = np.concatenate([model.nominal("coordinate"), model.nominal("velocity")])
    return integrate_adaptive(Motion(model, state, np.array(time), watch=watch), RunOptions(method, tol, tol))


def net(damping: float = 0.0) -> Structure:
    """A mass in a plane that flies about between four cables, all slack in the middle."""
    position = [[0, 0, 0], [3, 0, 0], [1.3, 0, 2.5], [1.7, 0, -2.2], [1.45, 0, 0.1]]
    cables = ((0, 1.5, 40.0), (1, 1.6, 60.0), (2, 2.5, 30.0), (3, 2.4, 50.0))
    members = [cable(k, 4, rest, mu, damping=damping) for k, rest, mu in cables]
    structure = make_structure(
        position, members, anchored=dict.fromkeys(range(4), "xyz"), axes="xz", mass=0.3
    )
    velocity = np.zeros((5, 3))
    velocity[4] = (1.0, 0.0, 0.7)
    return structure.with_changes(node_velocity=velocity)


# --- order -----------------------------------------------------------------------------------------


def equal_steps(
    method: str, model: CompiledModel, t_end: float, count: int, watch: bool
) -> tuple[np.ndarray, int]:
    """End state and events of equal steps, each cut at its events, at a tolerance that any step meets."""
    time = np.linspace(0.0, t_end, count + 1)
    state = np.concatenate([model.nominal("coordinate"), model.nominal("velocity")])
    bound = BoundIntegrator(method, Motion(model, state, time[[0, -1]]))
    null, now, counts = bound.ffi.NULL, bound.ffi.new("double *"), bound.ffi.new("integrator_run *")
    if watch:
        counts.watch = 1
    for end in time[1:].tolist():
        step = bound.ffi.new("double *", t_end / count)
        given = (end, 1e9, 1e9, 1000, now, step, bound.pointer(bound.state), *bound.arguments(), 0)
        assert bound.call(*given, null, null, bound.n_sampled, counts, bound.pointer(bound.work)) == 0
        assert now[0] == end
    return bound.state, int(counts.n_events) if watch else 0


@pytest.mark.parametrize(
    ("method", "order", "counts"), [("rk54", 5, (400, 800, 1600)), ("rk853", 8, (100, 200, 400))]
)
def test_order_is_kept_through_59_events(method: str, order: int, counts: tuple[int, ...]) -> None:
    model = build(net())
    best, n_events = equal_steps("rk853", model, 6.0, 1500, True)
    assert n_events == 59
    assert np.abs(best - equal_steps("rk853", model, 6.0, 1200, True)[0]).max() < 5e-13
    found = [equal_steps(method, model, 6.0, count, True) for count in counts]
    assert [events for _, events in found] == [59] * len(counts)
    errors = [np.abs(state - best).max() for state, _ in found]
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx(order, abs=0.5)
    plain = [np.abs(equal_steps(method, model, 6.0, count, False)[0] - best).max() for count in counts]
    assert plain[-1] > 1e3 * errors[-1]


@pytest.mark.parametrize(
    ("method", "order", "counts"), [("rk54", 5, (400, 800, 1600)), ("rk853", 7, (100, 200, 400))]
)
def test_order_is_kept_where_damped_cables_jump(method: str, order: int, counts: tuple[int, ...]) -> None:
    """A damped cable is pulled taut with a jump of its force: nothing may be evaluated on the wrong side."""
    model = build(net(0.5))
    best, n_events = equal_steps("rk853", model, 6.0, 1500, True)
    assert n_events == 34
    errors = [np.abs(equal_steps(method, model, 6.0, count, True)[0] - best).max() for count in counts]
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] > order - 0.4


@pytest.mark.parametrize("method", ["rk4", "rk54", "rk853", "tsit5", "radau"])
def test_a_damped_cable_pulls_from_where_it_is_taut(method: str) -> None:
    """A kilometre from the origin a length is known to 1e-13 m, and counts as beyond zero from 4e-12 m on.

    x'' = -(c / m) x' - (k / m) x from the time on at which the mass has gone half a metre at 2 m/s.
    """
    start, c, k, m, speed = 1000.0, 1.0, 10.0, 0.01, 2.0
    members = [cable(0, 1, 1.0, k, damping=c), bar(2, 3, 1.0)]
    position = np.array([[start, 0, 0], [start + 0.5, 0, 0], [start, 0, 0], [start + 1.0, 0, 0]])
    structure = make_structure(position, members, anchored={0: "xyz", 2: "xyz"}, axes="x", mass=m)
    model = build_library(
        structure.with_changes(node_velocity=np.outer([0, speed, 0, 0], [1, 0, 0])),
        ModelRequest(SIMULATION_QUANTITIES, integrators=(method,)),
    ).load()
    state = np.concatenate([model.nominal("coordinate"), model.nominal("velocity")])
    options = RunOptions(method, 1e-13, 1e-13, step=1e-5 if method == "rk4" else None)
    found = integrate_once(Motion(model, state, np.array([0.0, 0.251, 0.26, 0.3])), options)
    assert (found.status, found.log.name) == ("ok", ("e0",))
    roots = np.roots([1.0, c / m, k / m])
    after = np.exp(np.outer(found.time[1:] - 0.25, roots))
    expected = speed * after @ (roots * [1.0, -1.0]) / (roots[0] - roots[1])
    assert np.abs(found.state[1:, 2] - expected).max() < 3e-11


@each
def test_the_error_falls_with_the_tolerance_as_on_smooth_motions(method: str) -> None:
    model, time = build(net()), [0.0, 10.0]
    best = run("rk853", model, time, 1e-15)
    assert best.log.count == 99
    tolerances = 10.0 ** -np.arange(6, 13)
    errors = [np.abs(run(method, model, time, tol).state[-1] - best.state[-1]).max() for tol in tolerances]
    assert np.polyfit(np.log(tolerances), np.log(errors), 1)[0] == pytest.approx(1.0, abs=0.1)
    assert errors[-1] < 3e-9


# --- the common prism ------------------------------------------------------------------------------


@pytest.mark.parametrize(("method", "tol"), [("rk54", 1e-13), ("rk853", 1e-12)])
def test_the_common_prism_is_met_to_1e_10(method: str, tol: float) -> None:
    model = build(common_prism(), formulation="rigid_bar")
    found = run(method, model, np.arange(6.0), tol)
    assert (found.status, found.log.count) == ("ok", EVENTS)
    place = found.state[:, :18].reshape(6, 6, 3)
    assert np.abs(place[1:] - POSITION.reshape(5, 6, 3)).max() < 1e-11
    start, end = (np.array([place[:, bar[k]] for bar in BARS]) for k in (0, 1))
    length = np.linalg.norm(end - start, axis=-1)
    assert np.abs(length - length[:, :1]).max() < 1e-14
    energy = [model.compute("total_energy", coordinate=x[:18], velocity=x[18:]) for x in found.state]
    assert np.ptp(energy) < 1e-11
    assert energy[0] == pytest.approx(1.124978, abs=1e-6)


def test_strings_of_the_common_prism_switch_in_pairs() -> None:
    """A half turn maps the prism onto itself: strings switch two by two, at one time and in one cut."""
    model = build(common_prism(), formulation="rigid_bar")
    log = run("rk853", model, [0.0, 5.0], 1e-12).log
    times, counts = np.unique(log.time, return_counts=True)
    assert counts.tolist() == [2] * (EVENTS // 2)
    assert np.diff(times).min() > 1e-7
    by_name = {name: log.direction[np.array(log.name) == name] for name in set(log.name)}
    assert all((np.abs(np.diff(turns)) == 2).all() for turns in by_name.values())  # slack and taut in turn


# --- symmetry, grazes, many events -----------------------------------------------------------------


@each
def test_three_cables_that_switch_at_once_are_one_cut(method: str) -> None:
    structure = prism(150.0, bar_stiffness=2e3, strain=0.02)
    place = structure.node_position
    velocity = np.column_stack([-place[:, 1], place[:, 0], 0.3 * np.ones(6)]) * np.array(
        [[1.0]] * 3 + [[-1.0]] * 3
    )
    model = build(structure.with_changes(node_velocity=velocity))
    log = run(method, model, [0.0, 1.0], 1e-9).log
    times, counts = np.unique(log.time, return_counts=True)
    assert log.count >= 12
    assert set((counts % 3).tolist()) == {0}
    assert np.diff(times).min() > 1e-5


def swinging(depth: float) -> CompiledModel:
    """x = 0.2 cos(20 t) + 1 on a spring, and a weak cable that is taut for the last `depth` of the way up."""
    members = [spring(0, 1, 1.0, 40.0), cable(0, 1, 1.2 - depth, 1e-9)]
    structure = make_structure([[0, 0, 0], [0.8, 0, 0]], members, anchored={0: "xyz"}, mass=0.1, axes="x")
    return build(structure)


@each
@pytest.mark.parametrize("tol", [1e-3, 1e-6, 1e-10])
@pytest.mark.parametrize("depth", [1e-2, 1e-4, 1e-6, 1e-8])
def test_a_graze_within_a_step_is_found(method: str, tol: float, depth: float) -> None:
    log = run(method, swinging(depth), [0.0, 0.5 * np.pi], tol).log  # five periods
    if depth > 20 * tol:
        middle, half = np.pi / 20, np.arccos(1 - depth / 0.2) / 20
        tops = middle * np.arange(1, 10, 2)
        expected = np.sort(np.concatenate([tops - half, tops + half]))
        assert log.direction.tolist() == [1, -1] * 5
        assert np.abs(log.time - expected).max() < 50 * tol / np.sqrt(depth)
    else:  # whether the top is reached is for the tolerance to say; each taut has its slack
        assert log.direction.tolist() == [1, -1] * (log.count // 2)


@each
def test_a_near_miss_is_no_event(method: str) -> None:
    assert run(method, swinging(-1e-7), [0.0, 1.5], 1e-11).log.count == 0


@each
def test_events_that_accumulate_end_with_a_status(method: str) -> None:
    """sin(50 log(1 - t)) changes its sign ever faster, without end before t = 1."""
    model = swinging(-1.0)
    watch = Watch(("condition",), (), lambda t, q, v: float(np.sin(50 * np.log(max(1.0 - t, 1e-300)))))
    found = run(method, model, [0.0, 2.0], 1e-8, watch)
    assert found.status == "too_many_events"
    assert "ever more closely after t = " in found.message
    assert len(found.time) == 1
    assert found.log.count > 200
    exact = 1.0 - np.exp(-np.pi / 50 * np.arange(1, 31))
    np.testing.assert_allclose(found.log.time[:30], exact, rtol=1e-9)


def test_a_small_mass_between_stiff_cables_is_no_succession() -> None:
    """It is thrown to and fro thousands of times a second: many events, each steps apart from the next."""
    members = [cable(0, 1, 1.0, 1e6), cable(2, 1, 1.05, 1e6)]
    structure = make_structure(
        [[0, 0, 0], [1.05, 0, 0], [2.0, 0, 0]], members, anchored={0: "xyz", 2: "xyz"}, mass=1e-3, axes="x"
    )
    found = run("rk853", build(structure), [0.0, 0.1], 1e-8)
    assert found.status == "ok"
    # Half a swing at the angular frequency sqrt(1e6 / 1e-3) in each cable, 0.05 m of flight between.
    omega = np.sqrt(1e6 / 1e-3)
    period = 2 * np.pi / omega + 2 * 0.05 / (0.05 * omega)
    assert found.log.count == pytest.approx(4 * 0.1 / period, abs=3)


@each
def test_flight_between_short_pulls_takes_few_steps(method: str) -> None:
    """A light body flies straight for 20 times as long as its cable pulls: steps grow until they tell of
    no event rightly."""
    structure = make_structure([[0, 0, 0], [1, 0, 0]], [cable(0, 1, 1.0, 1e4)], axes="x", mass=1.0)
    mass, velocity = np.array([1e3, 1e-3]), np.zeros((2, 3))
    velocity[1, 0] = -30.0
    model = build(structure.with_changes(node_mass=mass, node_velocity=velocity))
    found = run(method, model, [0.0, 1.0], 1e-6)
    pull, flight = np.pi / np.sqrt(1e4 * (1 / mass).sum()), 2.0 / 30.0
    assert found.log.count == 2 * int(1.0 / (flight + pull))
    assert found.n_evaluations < 300 * found.log.count


# --- log and calls ---------------------------------------------------------------------------------


@each
def test_the_same_bits_come_out_again_and_in_many_calls(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    model, time = build(net()), np.linspace(0.0, 5.0, 41)
    first, again = (run(method, model, time, 1e-9) for _ in range(2))
    monkeypatch.setattr(c_run, "FIRST_CHUNK", 3)
    monkeypatch.setattr(c_run, "CHUNK_SECONDS", 0.0)
    many = run(method, model, time, 1e-9)
    for other in (again, many):
        np.testing.assert_array_equal(first.state, other.state)
        np.testing.assert_array_equal(first.log.time, other.log.time)
        assert first.n_evaluations == other.n_evaluations


def test_events_beyond_the_log_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    model = build(net())
    whole = run("rk853", model, [0.0, 3.0], 1e-8)
    monkeypatch.setattr(event_run, "MAX_LOGGED", 7)
    short = run("rk853", model, [0.0, 3.0], 1e-8)
    assert short.log.count == whole.log.count > 7
    np.testing.assert_array_equal(short.log.time, whole.log.time[:7])
    np.testing.assert_array_equal(short.state, whole.state)


def test_samples_around_events_are_as_good_as_others() -> None:
    model, time = build(net()), np.linspace(0.0, 4.0, 4001)
    found, best = (run("rk853", model, time, tol) for tol in (1e-9, 1e-14))
    assert np.abs(found.state - best.state).max() < 1e-7


def test_energy_is_kept_through_events() -> None:
    model = build(net())
    found = run("rk853", model, np.linspace(0.0, 10.0, 21), 1e-13)
    energy = [model.compute("total_energy", coordinate=x[:2], velocity=x[2:]) for x in found.state]
    assert np.ptp(energy) < 1e-12


# --- what is watched -------------------------------------------------------------------------------


def test_a_scene_without_slack_cables_has_no_events() -> None:
    structure = make_structure([[0, 0, 0], [1.2, 0, 0]], [spring(0, 1, 1.0)], anchored={0: "xyz"}, axes="x")
    model = build(structure)
    assert [(spec.events, spec.cables) for spec in model.manifest.integrators] == [((), ())] * 2
    assert not model.has("cable_margin")
    with pytest.raises(FormulationError, match="built without these events") as caught:
        run("rk54", model, [0.0, 1.0], 1e-6, Watch(("condition",), (), lambda t, q, v: t - 0.5))
    assert "condition" in caught.value.hint


def test_the_manifest_names_the_cables_that_are_watched() -> None:
    members = [bar(0, 1, 1.0), cable(1, 2, 1.0), spring(2, 0, 1.0), cable(0, 2, 1.0)]
    structure = make_structure([[0, 0, 0], [1, 0, 0], [0, 1, 0]], members)
    spec = build(structure).manifest.integrators[0]
    assert (spec.events, spec.cables) == (("cable", "condition"), (1, 3))


@each
def test_contact_of_bars_is_logged_and_may_end_the_run(method: str) -> None:
    """A bar flies through another: their surfaces meet at t = 0.45 s and part at 0.55 s."""
    position = [[0, -0.5, 0], [0, 0.5, 0], [-0.5, 0, 1], [0.5, 0, 1]]
    structure = make_structure(position, [bar(0, 1, 1.0), bar(2, 3, 1.0)])
    velocity = np.array([[0.0] * 3] * 2 + [[0.0, 0.0, -2.0]] * 2)
    structure = structure.with_changes(radius=np.full(2, 0.05), node_velocity=velocity)
    model = build(structure, events=("contact",))
    logged = run(method, model, [0.0, 1.0], 1e-10, Watch(("contact",)))
    assert logged.log.kind == ("contact", "contact")
    assert logged.log.name == ("e0_e1", "e0_e1")
    assert logged.log.direction.tolist() == [-1, 1]
    np.testing.assert_allclose(logged.log.time, [0.45, 0.55], rtol=1e-12)
    assert logged.time.tolist() == [0.0, 1.0]
    ended = run(method, model, [0.0, 0.2, 1.0], 1e-10, Watch(("contact",), ("contact",)))
    assert ended.status == "ok"
    assert ended.time.tolist() == [0.0, 0.2, pytest.approx(0.45, rel=1e-12)]
    assert ended.state[-1, 8] == pytest.approx(0.1, rel=1e-11)


@each
def test_a_condition_of_ones_own_ends_the_run_where_it_turns(method: str) -> None:
    model = swinging(-1.0)
    watch = Watch(("condition",), ("condition",), lambda t, q, v: q[0] - 1.1)
    found = run(method, model, [0.0, 1.0], 1e-12, watch)
    exact = np.arccos(-0.5) / 20
    assert found.time[-1] == pytest.approx(exact, rel=1e-10)
    assert found.state[-1] == pytest.approx([1.1, 4.0 * np.sin(20 * exact)], rel=1e-9)
    assert (found.log.kind, found.log.direction.tolist()) == (("condition",), [1])


def test_what_a_condition_raises_comes_out() -> None:
    def fail(t: float, q: np.ndarray, v: np.ndarray) -> float:
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        run("rk853", build(net()), [0.0, 1.0], 1e-6, Watch(("condition",), (), fail))


def test_a_condition_that_is_no_number_ends_the_run() -> None:
    watch = Watch(("condition",), (), lambda t, q, v: float("nan") if t > 0.5 else 1.0)
    with pytest.raises(NonFiniteError, match=r"not a finite number at t = 0\.5"):
        run("rk853", build(net()), np.linspace(0.0, 1.0, 11), 1e-6, watch)


def test_the_log_keeps_at_least_a_hundred_thousand_events() -> None:
    assert event_log.MAX_LOGGED >= 100_000


@pytest.mark.parametrize("damping", [0.0, 0.3])
def test_loops_over_tables_find_the_same_events(damping: float) -> None:
    """The emitter table writes the margins in loops: the same bits, so the same events and states."""
    structure = net(damping)
    unrolled, table = (build(structure, emitter=emitter) for emitter in ("unrolled", "table"))
    found, other = (run("rk54", model, np.linspace(0.0, 4.0, 9), 1e-9) for model in (unrolled, table))
    assert found.log.count > 10
    assert other.log.name == found.log.name
    np.testing.assert_array_equal(other.log.time, found.log.time)
    np.testing.assert_array_equal(other.state, found.state)


def test_many_cables_are_watched_only_where_that_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(events, "MOST_WATCHED", 1)
    time = np.linspace(0.0, 1.0, 3)
    other = net(damping=0.01)  # that no other test has built with the limit as it is
    silent, asked = (build(other, emitter="table", **more) for more in ({}, {"events": ("cable",)}))
    count = int(other.tension_only.sum())
    assert [spec.unwatched for spec in silent.manifest.integrators] == [count] * 2
    assert (
        f"events of {count} cables are not monitored (model.events)"
        in run("rk54", silent, time, 1e-6).message
    )
    assert [spec.unwatched for spec in asked.manifest.integrators] == [0] * 2
    assert "not monitored" not in run("rk54", asked, time, 1e-6).message
