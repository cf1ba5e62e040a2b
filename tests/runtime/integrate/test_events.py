"""Steps that end where cables go slack or taut, by every method: order, times, symmetry, grazes, limits."""

import functools
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.codegen.integrators import events
from tensegrity_codegen.runtime.accuracy.integrate import integrate_once
from tensegrity_codegen.runtime.integrate import c_run, event_log, event_run
from tensegrity_codegen.runtime.integrate.event_log import Watch
from tensegrity_codegen.runtime.integrate.integration import BoundIntegrator
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions, Stepping
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError, NonFiniteError
from tests.cases import thorough
from tests.common_prism import BARS, EVENTS, POSITION, common_prism
from tests.models import simulator, start_of
from tests.runtime.build import bar, cable, make_structure, prism, spring
from tests.runtime.integrate.nets import crossing_bars, net, swinging

EXPLICIT = ("rk54", "rk853")
METHODS = ("rk4", *EXPLICIT, "radau")
each_explicit = pytest.mark.parametrize("method", EXPLICIT)
each = pytest.mark.parametrize("method", METHODS)


@functools.cache
def load_net(damping: float = 0.0, rod: float | None = None) -> CompiledModel:
    mass: Any = [0, 0, 0, 0, 0.3, 0.2] if rod else 0.3
    return simulator(net(damping, rod, mass=mass), *METHODS)


@functools.cache
def load_swinging() -> CompiledModel:
    """One library for all depths of the cable."""
    return simulator(swinging(), *METHODS, parameters={"rest_length": (1,)})


@functools.cache
def load_common_prism() -> CompiledModel:
    return simulator(common_prism(), "rk4", *EXPLICIT, formulation="rigid_bar")


def run(
    method: str, model: CompiledModel, time: Any, tol: float, watch: Watch | None = None, **given: Any
) -> RawTrajectory:
    """Return one run; tol: the tolerance, or the step [s] of rk4."""
    options = RunOptions(method, step=tol) if method == "rk4" else RunOptions(method, tol, tol)
    return integrate_once(Motion(model, start_of(model), np.array(time), given, watch=watch), options)


def swing(
    method: str, time: Any, tol: float, depth: float = -1.0, watch: Watch | None = None
) -> RawTrajectory:
    """Return a run in which the cable is taut for the last `depth` [m] of the way up."""
    return run(method, load_swinging(), time, tol, watch, rest_length=np.array([1.2 - depth]))


def slope(counts: Any, errors: Any) -> float:
    return float(-np.polyfit(np.log(counts), np.log(errors), 1)[0])


# --- order -----------------------------------------------------------------------------------------


def equal_steps(
    method: str, model: CompiledModel, t_end: float, count: int, watch: bool
) -> tuple[np.ndarray, int]:
    """End state and events of equal steps, each cut at its events, at a tolerance that any step meets."""
    time = np.linspace(0.0, t_end, count + 1)
    bound = BoundIntegrator(method, Motion(model, start_of(model), time[[0, -1]]))
    null, now, counts = bound.ffi.NULL, bound.ffi.new("double *"), bound.ffi.new("integrator_run *")
    if watch:
        counts.watch = 1
    for end in time[1:].tolist():
        step = bound.ffi.new("double *", t_end / count)
        given = (end, 1e9, 1e9, 1000, now, step, bound.pointer(bound.state), *bound.arguments(), 0)
        assert bound.call(*given, null, null, bound.n_sampled, counts, bound.pointer(bound.work)) == 0
        assert now[0] == end
    return bound.state, int(counts.n_events) if watch else 0


@pytest.mark.parametrize(("damping", "events"), [(0.5, 34), *thorough((0.0, 59))])
@pytest.mark.parametrize(
    ("method", "order", "counts"), [("rk54", 5, (400, 800, 1600)), ("rk853", 8, (100, 200, 400))]
)
def test_order_is_kept_through_events(
    method: str, order: int, counts: tuple[int, ...], damping: float, events: int
) -> None:
    """A damped cable is pulled taut with a jump of its force: nothing may be evaluated on the wrong side."""
    model = load_net(damping)
    best, n_events = equal_steps("rk853", model, 6.0, 1500, True)
    assert n_events == events
    found = [equal_steps(method, model, 6.0, count, True) for count in counts]
    errors = [np.abs(state - best).max() for state, _ in found]
    if damping:
        assert slope(counts, errors) > min(order, 7) - 0.4
        return
    assert [seen for _, seen in found] == [events] * len(counts)
    assert slope(counts, errors) == pytest.approx(order, abs=0.5)
    plain = np.abs(equal_steps(method, model, 6.0, counts[-1], False)[0] - best).max()
    assert plain > 1e3 * errors[-1]


@pytest.mark.parametrize(("damping", "count"), [(0.0, 59), (0.5, 34)])
def test_order_four_of_fixed_steps_is_kept_through_events(damping: float, count: int) -> None:
    model, time, steps = load_net(damping), [0.0, 6.0], (500, 1000, 2000, 4000)
    best = run("rk853", model, time, 1e-14)
    found = [run("rk4", model, time, 6.0 / n) for n in steps]
    assert [raw.log.count for raw in found] == [count] * len(steps)
    assert found[-1].log.name == best.log.name
    np.testing.assert_allclose(found[-1].log.time, best.log.time, atol=1e-7)
    errors = [np.abs(raw.state[-1] - best.state[-1]).max() for raw in found]
    assert slope(steps, errors) == pytest.approx(4.0, abs=0.4)
    plain = run("rk4", model, time, 6.0 / steps[-1], Watch())
    assert plain.log.count == 0
    assert np.abs(plain.state[-1] - best.state[-1]).max() > 1e3 * errors[-1]


@pytest.mark.thorough
@pytest.mark.parametrize(("damping", "count"), [(0.0, 50), (0.5, 34)])
def test_order_five_of_radau_is_kept_through_events(damping: float, count: int) -> None:
    """Over the number of steps; a damped cable is pulled taut with a jump of its force."""
    model, time = load_net(damping, 80.0), [0.0, 6.0]
    best = run("rk853", model, time, 1e-14)
    found = [run("radau", model, time, tol) for tol in (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)]
    assert [raw.log.count for raw in found] == [best.log.count] * len(found) == [count] * len(found)
    assert found[-1].log.name == best.log.name
    np.testing.assert_allclose(found[-1].log.time, best.log.time, atol=1e-7)
    errors = [np.abs(raw.state[-1] - best.state[-1]).max() for raw in found]
    assert slope([raw.n_steps for raw in found], errors) > 4.6
    assert errors[-1] < 1e-6
    assert run("radau", model, time, 1e-4, Watch()).log.count == 0


@pytest.mark.parametrize("method", [*METHODS, "tsit5"])
def test_a_damped_cable_pulls_from_where_it_is_taut(method: str) -> None:
    """A kilometre from the origin a length is known to 1e-13 m, and counts as beyond zero from 4e-12 m on.

    x'' = -(c / m) x' - (k / m) x from the time on at which the mass has gone half a metre at 2 m/s.
    """
    start, c, k, m, speed = 1000.0, 1.0, 10.0, 0.01, 2.0
    members = [cable(0, 1, 1.0, k, damping=c), bar(2, 3, 1.0)]
    position = np.array([[start, 0, 0], [start + 0.5, 0, 0], [start, 0, 0], [start + 1.0, 0, 0]])
    structure = make_structure(position, members, anchored={0: "xyz", 2: "xyz"}, axes="x", mass=m)
    velocity = np.outer([0, speed, 0, 0], [1, 0, 0])
    model = simulator(structure.with_changes(node_velocity=velocity), *METHODS, "tsit5")
    found = run(method, model, [0.0, 0.251, 0.26, 0.3], 1e-5 if method == "rk4" else 1e-13)
    assert (found.status, found.log.name) == ("ok", ("e0",))
    roots = np.roots([1.0, c / m, k / m])
    after = np.exp(np.outer(found.time[1:] - 0.25, roots))
    expected = speed * after @ (roots * [1.0, -1.0]) / (roots[0] - roots[1])
    assert np.abs(found.state[1:, 2] - expected).max() < 3e-11


@each_explicit
def test_the_error_falls_with_the_tolerance_as_on_smooth_motions(method: str) -> None:
    model, time = load_net(), [0.0, 10.0]
    best = run("rk853", model, time, 1e-15)
    assert best.log.count == 99
    tolerances = 10.0 ** -np.arange(6, 13)
    errors = [np.abs(run(method, model, time, tol).state[-1] - best.state[-1]).max() for tol in tolerances]
    assert -slope(tolerances, errors) == pytest.approx(1.0, abs=0.1)
    assert errors[-1] < 3e-9


# --- the common prism ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("method", "tol", "most"), [("rk4", 1e-3, 1e-7), ("rk54", 1e-13, 1e-11), ("rk853", 1e-12, 1e-11)]
)
def test_the_common_prism_is_met_with_its_strings_switching_in_pairs(
    method: str, tol: float, most: float
) -> None:
    """A half turn maps the prism onto itself: strings switch two by two, at one time and in one cut."""
    model = load_common_prism()
    found = run(method, model, np.arange(6.0), tol)
    assert (found.status, found.log.count) == ("ok", EVENTS)
    place = found.state[:, :18].reshape(6, 6, 3)
    assert np.abs(place[1:] - POSITION.reshape(5, 6, 3)).max() < most
    times, counts = np.unique(found.log.time, return_counts=True)
    assert counts.tolist() == [2] * (EVENTS // 2)
    assert np.diff(times).min() > 1e-7
    names, direction = np.array(found.log.name), found.log.direction
    assert all((np.abs(np.diff(direction[names == name])) == 2).all() for name in set(names))
    start, end = (np.array([place[:, ends[k]] for ends in BARS]) for k in (0, 1))
    length = np.linalg.norm(end - start, axis=-1)
    assert np.abs(length - length[:, :1]).max() < 1e-14
    energy = [model.compute("total_energy", coordinate=x[:18], velocity=x[18:]) for x in found.state]
    assert np.ptp(energy) < 10 * most
    assert energy[0] == pytest.approx(1.124978, abs=1e-6)


# --- symmetry, grazes, many events -----------------------------------------------------------------


@each_explicit
def test_three_cables_that_switch_at_once_are_one_cut(method: str) -> None:
    structure = prism(150.0, bar_stiffness=2e3, strain=0.02)
    place = structure.node_position
    turn = np.column_stack([-place[:, 1], place[:, 0], 0.3 * np.ones(6)])
    velocity = turn * np.array([[1.0]] * 3 + [[-1.0]] * 3)
    model = simulator(structure.with_changes(node_velocity=velocity), *EXPLICIT)
    log = run(method, model, [0.0, 1.0], 1e-9).log
    times, counts = np.unique(log.time, return_counts=True)
    assert log.count >= 12
    assert set((counts % 3).tolist()) == {0}
    assert np.diff(times).min() > 1e-5


TOLERANCES = {
    "rk4": (np.pi / 1000,),
    "rk54": (1e-3, 1e-6, 1e-10),
    "rk853": (1e-3, 1e-6, 1e-10),
    "radau": (1e-8,),
}


@pytest.mark.parametrize(("method", "tol"), [(name, tol) for name in METHODS for tol in TOLERANCES[name]])
@pytest.mark.parametrize("depth", [1e-2, 1e-4, 1e-6, 1e-8])
def test_a_graze_within_a_step_is_found(method: str, tol: float, depth: float) -> None:
    log = swing(method, [0.0, 0.5 * np.pi], tol, depth).log  # five periods
    error = 2e-9 if method == "rk4" else tol  # of the place of the mass
    if depth > 20 * error:
        middle, half = np.pi / 20, np.arccos(1 - depth / 0.2) / 20
        tops = middle * np.arange(1, 10, 2)
        expected = np.sort(np.concatenate([tops - half, tops + half]))
        assert log.direction.tolist() == [1, -1] * 5
        assert np.abs(log.time - expected).max() < 50 * error / np.sqrt(depth)
    else:  # whether the top is reached is for the tolerance to say; each taut has its slack
        assert log.direction.tolist() == [1, -1] * (log.count // 2)


@each_explicit
def test_a_near_miss_is_no_event(method: str) -> None:
    assert swing(method, [0.0, 1.5], 1e-11, -1e-7).log.count == 0


@each
def test_events_that_accumulate_end_with_a_status(method: str) -> None:
    """sin(50 log(1 - t)) changes its sign ever faster, without end before t = 1."""
    watch = Watch(("condition",), (), lambda t, q, v: float(np.sin(50 * np.log(max(1.0 - t, 1e-300)))))
    found = swing(method, [0.0, 2.0], 1e-2 if method == "rk4" else 1e-6, watch=watch)
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
    found = run("rk853", simulator(structure, "rk853"), [0.0, 0.1], 1e-8)
    assert found.status == "ok"
    # Half a swing at the angular frequency sqrt(1e6 / 1e-3) in each cable, 0.05 m of flight between.
    omega = np.sqrt(1e6 / 1e-3)
    period = 2 * np.pi / omega + 2 * 0.05 / (0.05 * omega)
    assert found.log.count == pytest.approx(4 * 0.1 / period, abs=3)


@each_explicit
def test_flight_between_short_pulls_takes_few_steps(method: str) -> None:
    """A light body flies straight for 20 times as long as its cable pulls: steps grow until they tell of
    no event rightly."""
    structure = make_structure([[0, 0, 0], [1, 0, 0]], [cable(0, 1, 1.0, 1e4)], axes="x", mass=1.0)
    mass, velocity = np.array([1e3, 1e-3]), np.zeros((2, 3))
    velocity[1, 0] = -30.0
    model = simulator(structure.with_changes(node_mass=mass, node_velocity=velocity), *EXPLICIT)
    found = run(method, model, [0.0, 1.0], 1e-6)
    pull, flight = np.pi / np.sqrt(1e4 * (1 / mass).sum()), 2.0 / 30.0
    assert found.log.count == 2 * int(1.0 / (flight + pull))
    assert found.n_evaluations < 300 * found.log.count


@pytest.mark.thorough
def test_events_of_nearly_rigid_bars_are_those_of_rigid_ones() -> None:
    mass = [0, 0, 0, 0, 0.3, 0.2]
    rigid = simulator(net(0.0, 0.0, mass=mass), "rk853", formulation="rigid_bar")
    exact = run("rk853", rigid, [0.0, 3.0], 1e-14)
    found = run("radau", load_net(0.0, 8e9), [0.0, 3.0], 1e-9)
    assert found.status == "ok"
    assert found.log.name == exact.log.name
    assert found.log.count > 20
    np.testing.assert_array_equal(found.log.direction, exact.log.direction)
    np.testing.assert_allclose(found.log.time, exact.log.time, atol=1e-7)
    assert np.abs(found.state[-1] - exact.state[-1]).max() < 1e-6


# --- log and calls ---------------------------------------------------------------------------------


@each
def test_the_same_bits_come_out_in_many_calls(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    model = load_net(0.0, 8e7) if method == "radau" else load_net()
    tol = {"rk4": 1e-2, "radau": 1e-6}.get(method, 1e-9)
    time = np.linspace(0.0, 2.0, 21)
    whole = run(method, model, time, tol)
    monkeypatch.setattr(c_run, "FIRST_CHUNK", 1)
    monkeypatch.setattr(c_run, "CHUNK_SECONDS", 0.0)
    pieces = run(method, model, time, tol)
    np.testing.assert_array_equal(whole.state, pieces.state)
    np.testing.assert_array_equal(whole.log.time, pieces.log.time)
    assert (whole.n_evaluations, whole.evidence) == (pieces.n_evaluations, pieces.evidence)
    if method == "radau":
        np.testing.assert_array_equal(whole.tension, pieces.tension)


def test_a_fixed_step_that_is_cut_costs_little_and_steps_stay_on_their_grid() -> None:
    found = run("rk4", load_net(), [0.0, 6.0], 6.0 / 2000)
    assert (found.step, found.time[-1], found.n_steps) == (6.0 / 2000, 6.0, 2000)
    assert 8000 < found.n_evaluations < 8000 + 20 * found.log.count
    assert "59 events" in found.message


def test_events_beyond_the_log_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    assert event_log.MAX_LOGGED >= 100_000
    whole = run("rk853", load_net(), [0.0, 3.0], 1e-8)
    monkeypatch.setattr(event_run, "MAX_LOGGED", 7)
    short = run("rk853", load_net(), [0.0, 3.0], 1e-8)
    assert short.log.count == whole.log.count > 7
    np.testing.assert_array_equal(short.log.time, whole.log.time[:7])
    np.testing.assert_array_equal(short.state, whole.state)


@pytest.mark.parametrize(
    ("method", "tol", "most"), [("rk853", (1e-9, 1e-14), 1e-7), ("radau", (1e-7, 1e-10), 2e-5)]
)
def test_samples_around_events_are_as_good_as_others(
    method: str, tol: tuple[float, float], most: float
) -> None:
    model = load_net(0.0, 8e7) if method == "radau" else load_net()
    found, best = (run(method, model, np.linspace(0.0, 2.0, 2001), one) for one in tol)
    assert found.log.count > 10
    assert np.abs(found.state - best.state).max() < most
    if method == "radau":
        assert np.abs(found.tension - best.tension).max() < 1e-3 * np.abs(best.tension).max()


def test_energy_is_kept_through_events() -> None:
    model = load_net()
    found = run("rk853", model, np.linspace(0.0, 10.0, 21), 1e-13)
    energy = [model.compute("total_energy", coordinate=x[:2], velocity=x[2:]) for x in found.state]
    assert np.ptp(energy) < 1e-12


# --- what is watched -------------------------------------------------------------------------------


def test_a_scene_without_slack_cables_has_no_events() -> None:
    structure = make_structure([[0, 0, 0], [1.2, 0, 0]], [spring(0, 1, 1.0)], anchored={0: "xyz"}, axes="x")
    model = simulator(structure, *EXPLICIT)
    assert [(spec.events, spec.cables) for spec in model.manifest.integrators] == [((), ())] * 2
    assert not model.has("cable_margin")
    with pytest.raises(FormulationError, match="built without these events") as caught:
        run("rk54", model, [0.0, 1.0], 1e-6, Watch(("condition",), (), lambda t, q, v: t - 0.5))
    assert "condition" in caught.value.hint


def test_the_manifest_names_the_cables_that_are_watched() -> None:
    members = [bar(0, 1, 1.0), cable(1, 2, 1.0), spring(2, 0, 1.0), cable(0, 2, 1.0)]
    structure = make_structure([[0, 0, 0], [1, 0, 0], [0, 1, 0]], members)
    spec = simulator(structure, "rk54").manifest.integrators[0]
    assert (spec.events, spec.cables) == (("cable", "condition"), (1, 3))


@each_explicit
def test_contact_of_bars_is_logged_and_may_end_the_run(method: str) -> None:
    model = simulator(crossing_bars(), *EXPLICIT, events=("contact",))
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


@pytest.mark.thorough
def test_contact_of_bars_ends_runs_of_radau() -> None:
    structure = crossing_bars()
    model = simulator(structure, "radau", more=("bar_distance",), events=("contact",))
    logged = run("radau", model, [0.0, 1.0], 1e-9, Watch(("contact",)))
    assert logged.log.direction.tolist() == [-1, 1]
    np.testing.assert_allclose(logged.log.time, [0.45, 0.55], rtol=1e-10)
    for method in ("radau", "auto"):
        found = simulate(model, 1.0, samples=6, method=method, until="contact")
        assert found.status == "ok"
        assert found.events[0].names == ("e0_e1",)
        assert found.events[0].time == found.time[-1] == pytest.approx(0.45, rel=1e-10)
        assert found.events[0].margin == pytest.approx(0.0, abs=1e-10)
    touching = structure.node_position.copy()
    touching[2:, 2] = 0.05
    inside = simulate(model, 1.0, method="radau", coordinate=touching.ravel(), until="contact")
    assert inside.events[0].time == 0.0


ACCURACY = {"rk4": (1e-3, 1e-7), "rk54": (1e-12, 1e-9), "rk853": (1e-12, 1e-9), "radau": (1e-10, 1e-6)}


@each
def test_a_condition_of_ones_own_ends_the_run_with_the_state_where_it_turns(method: str) -> None:
    watch, exact = Watch(("condition",), ("condition",), lambda t, q, v: q[0] - 1.1), np.arccos(-0.5) / 20
    tol, most = ACCURACY[method]
    found = swing(method, [0.0, 0.01, 1.0], tol, watch=watch)
    assert found.status == "ok"
    assert found.time.tolist() == [0.0, 0.01, pytest.approx(exact, rel=most)]
    assert found.state[-1] == pytest.approx([1.1, 4.0 * np.sin(20 * exact)], rel=most)
    assert (found.log.kind, found.log.direction.tolist()) == (("condition",), [1])
    if method == "radau":
        assert found.tension is not None
        assert found.tension[-1] == pytest.approx([4.0], rel=1e-6)


@pytest.mark.parametrize(("method", "bars"), [("rk4", None), *thorough(("auto", 8e9))])
def test_a_simulation_ends_at_a_condition(method: str, bars: float | None) -> None:
    model = load_swinging() if bars is None else load_net(0.0, bars)
    where, step = (1.1, 1e-3) if bars is None else (1.55, None)
    found = simulate(
        model,
        3.0,
        samples=11,
        method=method,
        stepping=Stepping(step=step),
        rtol=1e-5,
        until=lambda t, q, v: q[0] - where,
    )
    assert found.status == "ok"
    assert found.method.startswith("auto (radau" if bars else "rk4")
    assert found.events[0].kind == "condition"
    assert found.coordinate[-1, 0] == pytest.approx(where, abs=2e-5)
    assert found.time[-1] < 3.0


def test_what_a_condition_raises_comes_out() -> None:
    def fail(t: float, q: np.ndarray, v: np.ndarray) -> float:
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        run("rk853", load_net(), [0.0, 1.0], 1e-6, Watch(("condition",), (), fail))


@each
def test_a_condition_that_is_no_number_ends_the_run(method: str) -> None:
    watch = Watch(("condition",), (), lambda t, q, v: float("nan") if t > 0.5 else 1.0)
    with pytest.raises(NonFiniteError, match=r"condition is not a finite number at t = 0\.5"):
        swing(method, np.linspace(0.0, 1.0, 11), 1e-2 if method == "rk4" else 1e-6, watch=watch)


@pytest.mark.parametrize("damping", [0.0, 0.5])
def test_loops_over_tables_find_the_same_events(damping: float) -> None:
    """The emitter table writes the margins in loops: the same bits, so the same events and states."""
    table = simulator(net(damping), "rk54", emitter="table")
    found, other = (
        run("rk54", model, np.linspace(0.0, 4.0, 9), 1e-9) for model in (load_net(damping), table)
    )
    assert found.log.count > 10
    assert other.log.name == found.log.name
    np.testing.assert_array_equal(other.log.time, found.log.time)
    np.testing.assert_array_equal(other.state, found.state)


def build_silent(structure: Structure, **more: Any) -> CompiledModel:
    return simulator(structure, *EXPLICIT, emitter="table", **more)


def test_many_cables_are_watched_only_where_that_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(events, "MAX_WATCHED", 1)
    time = np.linspace(0.0, 1.0, 3)
    other = net(damping=0.01)  # that no other test has built with the limit as it is
    silent, asked = (build_silent(other, **more) for more in ({}, {"events": ("cable",)}))
    count = int(other.tension_only.sum())
    assert [spec.unwatched for spec in silent.manifest.integrators] == [count] * 2
    message = f"events of {count} cables are not monitored (model.events)"
    assert message in run("rk54", silent, time, 1e-6).message
    assert [spec.unwatched for spec in asked.manifest.integrators] == [0] * 2
    assert "not monitored" not in run("rk54", asked, time, 1e-6).message


def test_libraries_without_events_keep_the_plain_loop_and_say_so() -> None:
    model = simulator(net(), "rk4", events=())
    found = run("rk4", model, [0.0, 1.0], 1e-2)
    assert found.log.count == 0
    assert "events of 4 cables are not monitored (model.events)" in found.message
    with pytest.raises(FormulationError, match="built without these events"):
        run("rk4", model, [0.0, 1.0], 1e-2, Watch(("cable",)))
