"""Fixed steps that are cut where cables go slack or taut, and go on to their ends."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.integrate import c_run
from tensegrity_codegen.runtime.integrate.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.integrate.event_log import Watch
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions, Stepping
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.integrate.rk4 import integrate_rk4
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.simulation_quantities import SIMULATION_QUANTITIES
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError, NonFiniteError
from tensegrity_codegen.tables.request import ModelRequest
from tests.common_prism import EVENTS, POSITION, common_prism
from tests.runtime.build import cable, make_structure, spring
from tests.runtime.integrate.test_integrator_events import net

SPAN = 6.0
STEPS = (500, 1000, 2000, 4000)


def build(structure: Structure, **options: Any) -> CompiledModel:
    request = ModelRequest(SIMULATION_QUANTITIES, integrators=("rk4", "rk853"), **options)
    return build_library(structure, request).load()


def start(model: CompiledModel) -> np.ndarray:
    return np.concatenate([model.nominal("coordinate"), model.nominal("velocity")])


def run(model: CompiledModel, time: Any, step: float, watch: Watch | None = None) -> RawTrajectory:
    motion = Motion(model, start(model), np.array(time), watch=watch)
    return integrate_rk4(motion, RunOptions("rk4", step=step))


def best_of(model: CompiledModel, time: Any) -> RawTrajectory:
    return integrate_adaptive(Motion(model, start(model), np.array(time)), RunOptions("rk853", 1e-14, 1e-14))


@pytest.mark.parametrize(("damping", "count"), [(0.0, 59), (0.5, 34)])
def test_order_four_is_kept_through_events(damping: float, count: int) -> None:
    """With damped cables the force jumps where they go taut."""
    model, time = build(net(damping)), [0.0, SPAN]
    best = best_of(model, time)
    found = [run(model, time, SPAN / n) for n in STEPS]
    assert [raw.log.count for raw in found] == [count] * len(STEPS)
    assert found[-1].log.name == best.log.name
    np.testing.assert_allclose(found[-1].log.time, best.log.time, atol=1e-7)
    errors = [np.abs(raw.state[-1] - best.state[-1]).max() for raw in found]
    assert -np.polyfit(np.log(STEPS), np.log(errors), 1)[0] == pytest.approx(4.0, abs=0.4)
    plain = run(model, time, SPAN / STEPS[-1], Watch())
    assert plain.log.count == 0
    assert np.abs(plain.state[-1] - best.state[-1]).max() > 1e3 * errors[-1]


def test_a_step_that_is_cut_costs_little_and_steps_stay_on_their_grid() -> None:
    model = build(net())
    found = run(model, [0.0, SPAN], SPAN / 2000)
    assert found.step == SPAN / 2000
    assert found.time[-1] == SPAN
    assert found.n_steps == 2000
    assert 8000 < found.n_evaluations < 8000 + 20 * found.log.count
    assert "59 events" in found.message


def test_the_same_bits_come_out_in_many_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    model, time = build(net()), np.linspace(0.0, 3.0, 31)
    whole = run(model, time, 1e-2)
    monkeypatch.setattr(c_run, "FIRST_CHUNK", 3)
    monkeypatch.setattr(c_run, "CHUNK_SECONDS", 0.0)
    pieces = run(model, time, 1e-2)
    np.testing.assert_array_equal(whole.state, pieces.state)
    np.testing.assert_array_equal(whole.log.time, pieces.log.time)
    best = best_of(model, time)
    assert np.abs(whole.state - best.state).max() < 1e-4


def test_rigid_bars_and_strings_that_switch_in_pairs() -> None:
    """Two strings of the common prism switch at once: one cut; 1 ms steps meet the table to 1e-7 m."""
    model = build(common_prism(), formulation="rigid_bar")
    found = run(model, np.arange(6.0), 1e-3)
    assert found.log.count == EVENTS
    _, counts = np.unique(found.log.time, return_counts=True)
    assert counts.tolist() == [2] * (EVENTS // 2)
    place = found.state[1:, :18].reshape(5, 6, 3)
    assert np.abs(place - POSITION.reshape(5, 6, 3)).max() < 1e-7


def swinging(depth: float) -> CompiledModel:
    """x = 0.2 cos(20 t) + 1 on a spring, and a weak cable that is taut for the last `depth` of the way up."""
    members = [spring(0, 1, 1.0, 40.0), cable(0, 1, 1.2 - depth, 1e-9)]
    structure = make_structure([[0, 0, 0], [0.8, 0, 0]], members, anchored={0: "xyz"}, mass=0.1, axes="x")
    return build(structure)


@pytest.mark.parametrize("depth", [1e-3, 1e-5])
def test_a_graze_within_a_step_is_found(depth: float) -> None:
    log = run(swinging(depth), [0.0, 0.5 * np.pi], np.pi / 20 / 50).log  # five periods
    middle, half = np.pi / 20, np.arccos(1 - depth / 0.2) / 20
    tops = middle * np.arange(1, 10, 2)
    expected = np.sort(np.concatenate([tops - half, tops + half]))
    assert log.direction.tolist() == [1, -1] * 5
    np.testing.assert_allclose(log.time, expected, atol=1e-5 / np.sqrt(depth) * 1e-2)


def test_conditions_accumulate_end_and_are_told() -> None:
    model = swinging(-1.0)
    faster = Watch(("condition",), (), lambda t, q, v: float(np.sin(50 * np.log(max(1.0 - t, 1e-300)))))
    found = run(model, [0.0, 2.0], 1e-2, faster)
    assert found.status == "too_many_events"
    assert len(found.time) == 1
    np.testing.assert_allclose(found.log.time[:30], 1 - np.exp(-np.pi / 50 * np.arange(1, 31)), rtol=1e-9)
    ending = Watch(("condition",), ("condition",), lambda t, q, v: q[0] - 1.1)
    exact = np.arccos(-0.5) / 20
    ended = run(model, [0.0, 0.01, 1.0], 1e-3, ending)
    assert ended.status == "ok"
    assert ended.time.tolist() == [0.0, 0.01, pytest.approx(exact, rel=1e-8)]
    assert ended.state[-1] == pytest.approx([1.1, 4.0 * np.sin(20 * exact)], rel=1e-7)
    broken = Watch(("condition",), (), lambda t, q, v: float("nan") if t > 0.5 else 1.0)
    with pytest.raises(NonFiniteError, match=r"not a finite number at t = 0\.5"):
        run(model, [0.0, 1.0], 1e-2, broken)


def test_a_simulation_ends_at_a_condition_and_is_held_to_another_step() -> None:
    model = swinging(-1.0)
    found = simulate(
        model,
        1.0,
        samples=11,
        method="rk4",
        stepping=Stepping(step=1e-3),
        until=lambda t, q, v: q[0] - 1.1,
    )
    assert found.status == "ok"
    assert found.events[0].kind == "condition"
    assert found.time[-1] == pytest.approx(np.arccos(-0.5) / 20, rel=1e-8)
    assert found.error_estimate is not None
    assert found.error_estimate < 1e-3


def test_libraries_without_events_keep_the_plain_loop_and_say_so() -> None:
    model = build(net(), events=())
    found = run(model, [0.0, 1.0], 1e-2)
    assert found.log.count == 0
    assert "events of 4 cables are not monitored (model.events)" in found.message
    with pytest.raises(FormulationError, match="built without these events"):
        run(model, [0.0, 1.0], 1e-2, Watch(("cable",)))
