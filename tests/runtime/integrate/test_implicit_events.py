"""Radau's steps end where cables go slack or taut, bars touch or a condition turns: order, times, limits."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.integrate import c_run
from tensegrity_codegen.runtime.integrate.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.integrate.event_log import Watch
from tensegrity_codegen.runtime.integrate.implicit import integrate_implicit
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.simulation_quantities import SIMULATION_QUANTITIES
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError, NonFiniteError
from tensegrity_codegen.tables.request import ModelRequest
from tests.runtime.build import bar, cable, make_structure, spring

SPAN = 6.0


def net(mu: float, damping: float = 0.0) -> Structure:
    """A bar in a plane that flies about with one end between four cables."""
    position = [[0, 0, 0], [3, 0, 0], [1.3, 0, 2.5], [1.7, 0, -2.2], [1.45, 0, 0.1], [1.75, 0, 0.5]]
    cables = ((0, 1.5, 40.0), (1, 1.6, 60.0), (2, 2.5, 30.0), (3, 2.4, 50.0))
    members = [cable(k, 4, rest, stiffness, damping=damping) for k, rest, stiffness in cables]
    structure = make_structure(
        position,
        [*members, bar(4, 5, 0.5, mu)],
        anchored=dict.fromkeys(range(4), "xyz"),
        axes="xz",
        mass=[0, 0, 0, 0, 0.3, 0.2],
    )
    velocity = np.zeros((6, 3))
    velocity[4:] = (1.0, 0.0, 0.7)
    return structure.with_changes(node_velocity=velocity)


def build(structure: Structure, *methods: str, wanted: Any = (), **options: Any) -> CompiledModel:
    request = ModelRequest(
        (*SIMULATION_QUANTITIES, *wanted), integrators=methods or ("radau", "rk853"), **options
    )
    return build_library(structure, request).load()


def motion_of(model: CompiledModel, time: Any, watch: Watch | None = None) -> Motion:
    state = np.concatenate([model.nominal("coordinate"), model.nominal("velocity")])
    return Motion(model, state, np.array(time), watch=watch)


def run(model: CompiledModel, time: Any, tol: float, watch: Watch | None = None) -> RawTrajectory:
    return integrate_implicit(motion_of(model, time, watch), RunOptions("radau", tol, tol))


def best_of(model: CompiledModel, time: Any) -> RawTrajectory:
    return integrate_adaptive(motion_of(model, time), RunOptions("rk853", 1e-14, 1e-14))


@pytest.mark.thorough
@pytest.mark.parametrize(("damping", "count"), [(0.0, 50), (0.5, 34)])
def test_order_five_is_kept_through_events(damping: float, count: int) -> None:
    """Over the number of steps; a damped cable is pulled taut with a jump of its force."""
    model, time = build(net(80.0, damping)), [0.0, SPAN]
    best = best_of(model, time)
    found = [run(model, time, tol) for tol in (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)]
    assert [raw.log.count for raw in found] == [best.log.count] * len(found) == [count] * len(found)
    assert found[-1].log.name == best.log.name
    np.testing.assert_allclose(found[-1].log.time, best.log.time, atol=1e-7)
    errors = [np.abs(raw.state[-1] - best.state[-1]).max() for raw in found]
    steps = [raw.n_steps for raw in found]
    assert -np.polyfit(np.log(steps), np.log(errors), 1)[0] > 4.6
    assert errors[-1] < 1e-6
    assert run(model, time, 1e-4, Watch()).log.count == 0


@pytest.mark.thorough
def test_events_of_nearly_rigid_bars_are_those_of_rigid_ones() -> None:
    exact = best_of(build(net(0.0), "rk853", formulation="rigid_bar"), [0.0, 3.0])
    found = run(build(net(8e9)), [0.0, 3.0], 1e-9)
    assert found.status == "ok"
    assert found.log.name == exact.log.name
    assert found.log.count > 20
    np.testing.assert_array_equal(found.log.direction, exact.log.direction)
    np.testing.assert_allclose(found.log.time, exact.log.time, atol=1e-7)
    assert np.abs(found.state[-1] - exact.state[-1]).max() < 1e-6


def test_samples_and_tensions_around_events_are_as_good_as_others() -> None:
    model, time = build(net(8e7)), np.linspace(0.0, 2.0, 2001)
    found, best = (run(model, time, tol) for tol in (1e-7, 1e-10))
    assert found.log.count > 10
    assert np.abs(found.state - best.state).max() < 2e-5
    assert found.tension is not None
    assert best.tension is not None
    assert np.abs(found.tension - best.tension).max() < 1e-3 * np.abs(best.tension).max()


def test_the_same_bits_come_out_in_many_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    model, time = build(net(8e7)), np.linspace(0.0, 2.0, 21)
    whole = run(model, time, 1e-6)
    monkeypatch.setattr(c_run, "FIRST_CHUNK", 1)
    monkeypatch.setattr(c_run, "CHUNK_SECONDS", 0.0)
    pieces = run(model, time, 1e-6)
    np.testing.assert_array_equal(whole.state, pieces.state)
    np.testing.assert_array_equal(whole.tension, pieces.tension)
    np.testing.assert_array_equal(whole.log.time, pieces.log.time)
    assert whole.evidence == pieces.evidence


def swinging(depth: float) -> CompiledModel:
    """x = 0.2 cos(20 t) + 1 on a spring, and a weak cable that is taut for the last `depth` of the way up."""
    members = [spring(0, 1, 1.0, 40.0), cable(0, 1, 1.2 - depth, 1e-9)]
    structure = make_structure([[0, 0, 0], [0.8, 0, 0]], members, anchored={0: "xyz"}, mass=0.1, axes="x")
    return build(structure, "radau")


@pytest.mark.parametrize("depth", [1e-2, 1e-4])
def test_a_graze_within_a_step_is_found(depth: float) -> None:
    tol = 1e-8
    log = run(swinging(depth), [0.0, 0.5 * np.pi], tol).log  # five periods
    middle, half = np.pi / 20, np.arccos(1 - depth / 0.2) / 20
    tops = middle * np.arange(1, 10, 2)
    expected = np.sort(np.concatenate([tops - half, tops + half]))
    assert log.direction.tolist() == [1, -1] * 5
    assert np.abs(log.time - expected).max() < 50 * tol / np.sqrt(depth)


def test_conditions_accumulate_end_and_are_told() -> None:
    model = swinging(-1.0)
    faster = Watch(("condition",), (), lambda t, q, v: float(np.sin(50 * np.log(max(1.0 - t, 1e-300)))))
    found = run(model, [0.0, 2.0], 1e-6, faster)
    assert found.status == "too_many_events"
    assert len(found.time) == 1
    assert found.log.count > 200
    exact = 1.0 - np.exp(-np.pi / 50 * np.arange(1, 31))
    np.testing.assert_allclose(found.log.time[:30], exact, rtol=1e-9)
    broken = Watch(("condition",), (), lambda t, q, v: float("nan") if t > 0.5 else 1.0)
    with pytest.raises(NonFiniteError, match="condition is not a finite number"):
        run(model, [0.0, 1.0], 1e-6, broken)


def test_a_condition_ends_the_run_with_state_and_tension_there() -> None:
    ending = Watch(("condition",), ("condition",), lambda t, q, v: q[0] - 1.1)
    exact = np.arccos(-0.5) / 20
    found = run(swinging(-1.0), [0.0, 0.01, 1.0], 1e-10, ending)
    assert found.status == "ok"
    assert found.time.tolist() == [0.0, 0.01, pytest.approx(exact, rel=1e-7)]
    assert found.state[-1] == pytest.approx([1.1, 4.0 * np.sin(20 * exact)], rel=1e-7)
    assert found.tension is not None
    assert found.tension[-1] == pytest.approx([4.0], rel=1e-6)
    assert (found.log.kind, found.log.direction.tolist()) == (("condition",), [1])


@pytest.mark.thorough
def test_contact_of_bars_is_logged_and_may_end_the_run() -> None:
    """A bar flies through another: their surfaces meet at t = 0.45 s and part at 0.55 s."""
    position = [[0, -0.5, 0], [0, 0.5, 0], [-0.5, 0, 1], [0.5, 0, 1]]
    structure = make_structure(position, [bar(0, 1, 1.0), bar(2, 3, 1.0)])
    velocity = np.array([[0.0] * 3] * 2 + [[0.0, 0.0, -2.0]] * 2)
    structure = structure.with_changes(radius=np.full(2, 0.05), node_velocity=velocity)
    request = ("bar_distance",)
    model = build(structure, "radau", wanted=request, events=("contact",))
    logged = run(model, [0.0, 1.0], 1e-9, Watch(("contact",)))
    assert logged.log.kind == ("contact", "contact")
    assert logged.log.direction.tolist() == [-1, 1]
    np.testing.assert_allclose(logged.log.time, [0.45, 0.55], rtol=1e-10)
    ended = run(model, [0.0, 0.2, 1.0], 1e-9, Watch(("contact",), ("contact",)))
    assert ended.time.tolist() == [0.0, 0.2, pytest.approx(0.45, rel=1e-10)]
    for method in ("radau", "auto"):
        found = simulate(model, 1.0, samples=6, method=method, until="contact")
        assert found.status == "ok"
        assert found.events[0].names == ("e0_e1",)
        assert found.events[0].time == found.time[-1] == pytest.approx(0.45, rel=1e-10)
        assert found.events[0].margin == pytest.approx(0.0, abs=1e-10)
    inside = simulate(model, 1.0, method="radau", coordinate=touching(structure), until="contact")
    assert inside.events[0].time == 0.0
    missing = build(structure, "radau", wanted=request, events=())
    with pytest.raises(FormulationError, match="built without these events"):
        simulate(missing, 1.0, method="radau", until="contact")


def touching(structure: Structure) -> np.ndarray:
    place = structure.node_position.copy()
    place[2:, 2] = 0.05
    return place.ravel()


def test_auto_takes_radau_for_conditions_too() -> None:
    model = build(net(8e9))
    found = simulate(model, 3.0, samples=11, rtol=1e-5, until=lambda t, q, v: q[0] - 1.55)
    assert found.status == "ok"
    assert found.method.startswith("auto (radau")
    assert found.events[0].kind == "condition"
    assert found.coordinate[-1, 0] == pytest.approx(1.55, abs=2e-5)
    assert found.time[-1] < 3.0
