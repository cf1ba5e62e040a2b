"""Batches of motions from Python: the same numbers as one by one, a status for each, clear refusals."""

import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.integrate import batch_integration, c_run
from tensegrity_codegen.runtime.integrate.batch_integration import integrate_batch
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions, Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate import motion_input
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.simulate.simulate_batch import simulate_batch
from tensegrity_codegen.runtime.trajectory.simulation_quantities import simulation_quantities
from tensegrity_codegen.system.errors import (
    FormulationError,
    InvalidValueError,
    LibraryError,
    UnknownNameError,
)
from tensegrity_codegen.tables.request import ModelRequest
from tests.runtime.build import bar, cable, make_structure, prism

ONCE = {"control": "steps"}  # of methods that tighten their steps
METHODS: tuple[tuple[str, dict[str, Any]], ...] = (("rk4", {"step": 1e-3}), ("rk54", ONCE), ("rk853", ONCE))
each = pytest.mark.parametrize(("method", "options"), METHODS, ids=[name for name, _ in METHODS])
T_END, SAMPLES = 0.05, 6


def build(structure: Any = None, **changes: Any) -> CompiledModel:
    structure = prism(150.0, anchored={0: "xyz"}) if structure is None else structure
    request = ModelRequest(
        simulation_quantities(changes.get("formulation", "node_position")),
        parameters={"rest_length": (1, 2), "gravity": ()},
        integrators=("rk4", "rk54", "rk853"),
        events=(),
        batch_width=8,
    )
    return build_library(structure, replace(request, **changes)).load()


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    return build()


def starts(model: CompiledModel, n_batch: int, seed: int = 0) -> np.ndarray:
    nominal = model.nominal("coordinate")
    return nominal + 1e-3 * np.random.default_rng(seed).normal(size=(n_batch, *nominal.shape))


# --- results ---------------------------------------------------------------------------------------


@each
def test_every_motion_is_that_of_a_simulation_of_its_own(
    model: CompiledModel, method: str, options: dict[str, Any]
) -> None:
    n_batch = 11  # one group of lanes, and three of the next
    coordinate, velocity = starts(model, n_batch), np.full_like(model.nominal("velocity"), 0.3)
    rest = model.nominal("rest_length") * (1.0 + 0.01 * np.arange(n_batch))[:, None]
    gravity = np.array([0.0, 0.5, -3.0])
    common = {"samples": SAMPLES, "method": method, "velocity": velocity}
    batch = simulate_batch(
        model, T_END, coordinate=coordinate, arguments={"rest_length": rest, "gravity": gravity},
        stepping=Stepping(**options), **common,
    )  # fmt: skip
    assert batch.status == ("ok",) * n_batch
    assert batch.node_position.shape == (n_batch, SAMPLES, 6, 3)
    for k in (0, 7, 8, 10):
        own = {"rest_length": rest[k], "gravity": gravity}
        alone = simulate(
            model,
            T_END,
            coordinate=coordinate[k],
            arguments=own,
            stepping=Stepping(**options),
            **common,
        )
        one = batch[k]
        for name in ("time", "coordinate", "velocity", "node_position", "node_velocity"):
            np.testing.assert_array_equal(getattr(one, name), getattr(alone, name), err_msg=name)
        for name in ("member_tension", "kinetic_energy", "total_energy"):
            np.testing.assert_array_equal(getattr(one, name), getattr(alone, name), err_msg=name)
        assert one.summary() == alone.summary() | {"message": one.message}


@each
def test_neither_companions_nor_threads_change_a_bit(
    model: CompiledModel, method: str, options: dict[str, Any]
) -> None:
    coordinate = starts(model, 21)
    run: dict[str, Any] = {"samples": SAMPLES, "method": method, "stepping": Stepping(**options)}
    together = simulate_batch(model, T_END, coordinate=coordinate, **run)
    threaded = simulate_batch(model, T_END, coordinate=coordinate, threads=4, **run)
    np.testing.assert_array_equal(together.coordinate, threaded.coordinate)
    some = [20, 3, 11]
    few = simulate_batch(model, T_END, coordinate=coordinate[some], **run)
    np.testing.assert_array_equal(together.coordinate[some], few.coordinate)
    np.testing.assert_array_equal(together.n_steps[some], few.n_steps)


@each
def test_short_calls_into_c_change_nothing(
    model: CompiledModel, method: str, options: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    state = np.hstack([starts(model, 9), np.zeros((9, len(model.nominal("velocity"))))])
    time = np.linspace(0.0, T_END, SAMPLES)
    asked = RunOptions(method, **options)
    whole = integrate_batch(Motion(model, state, time), asked)
    monkeypatch.setattr(c_run, "FIRST_CHUNK", 1)
    monkeypatch.setattr(c_run, "CHUNK_SECONDS", 0.0)
    told: list[float] = []
    parts = integrate_batch(Motion(model, state, time, progress=told.append), asked)
    np.testing.assert_array_equal(whole.state, parts.state)
    assert whole.message == parts.message
    assert told == [0.5, 1.0]


def test_a_motion_that_fails_has_its_own_status_and_disturbs_nobody(model: CompiledModel) -> None:
    coordinate = starts(model, 10)
    good = simulate_batch(model, T_END, samples=SAMPLES, coordinate=coordinate)
    assert good.is_ok.all()
    assert good.error_estimate.max() <= 1.0
    bad = coordinate.copy()
    bad[2, 4] = np.nan
    i, j = 3 * model.structure.connectivity[model.structure.is_bar][1] - 3
    bad[5, i : i + 3] = bad[5, j : j + 3]  # the ends of a bar coincide
    found = simulate_batch(model, T_END, samples=SAMPLES, coordinate=bad)
    expected = ["ok"] * 10
    expected[2], expected[5] = "non_finite_input", "unstable"
    assert list(found.status) == expected
    assert found.is_ok.sum() == 8
    np.testing.assert_array_equal(found.node_position[found.is_ok], good.node_position[found.is_ok])
    assert found.n_reached[[2, 5]].tolist() == [0, 1]  # the start is a sample
    for name in ("node_position", "member_tension", "total_energy"):
        assert np.isnan(getattr(found, name)[2]).all(), name
        assert np.isnan(getattr(found, name)[5, 1:]).all(), name
    assert "not finite" in found.message[2]
    assert "not finite" in found.message[5]


def test_a_fixed_step_is_not_compared_where_only_steps_are_controlled(model: CompiledModel) -> None:
    once = simulate_batch(
        model,
        T_END,
        samples=3,
        method="rk4",
        stepping=Stepping(step=1e-3, control="steps"),
        coordinate=starts(model, 2),
    )
    assert once.is_ok.all()
    assert once.error_estimate is not None
    assert np.isnan(once.error_estimate).all()


def test_steps_have_a_limit(model: CompiledModel) -> None:
    batch = simulate_batch(
        model, 1000.0, samples=2, method="rk853", stepping=Stepping(max_steps=50), coordinate=starts(model, 2)
    )
    assert batch.status == ("not_converged",) * 2


def test_energy_is_kept_motion_by_motion() -> None:
    three = make_structure([[0, 0, 0], [1, 0, 0], [1.5, 1, 0]], [bar(0, 1, 0.9), bar(1, 2, 1.0)], axes="xy")
    model = build(three, keep=("energy",), integrators=("rk853",), parameters={})
    coordinate = starts(model, 2)
    batch = simulate_batch(
        model, T_END, samples=3, method="rk853", stepping=Stepping(keep="energy"), coordinate=coordinate
    )
    alone = simulate(
        model, T_END, samples=3, method="rk853", stepping=Stepping(keep="energy"), coordinate=coordinate[1]
    )
    np.testing.assert_array_equal(batch.coordinate[1], alone.coordinate)


def test_a_motion_that_blows_up_keeps_the_samples_it_reached(model: CompiledModel) -> None:
    coordinate = starts(model, 3)
    found = simulate_batch(
        model, 4.0, samples=201, method="rk4", stepping=Stepping(step=0.02), coordinate=coordinate
    )
    assert set(found.status) == {"unstable"}
    reached = found.n_reached
    assert (reached > 0).all()
    assert (reached < 201).all()
    for k in range(3):
        assert np.isfinite(found.node_position[k, : reached[k]]).all()
        assert np.isnan(found.node_position[k, reached[k] :]).all()
        assert len(found[k].time) == reached[k]


@pytest.mark.parametrize("step", [2e-3, 5e-3, 7e-3])
def test_a_fixed_step_is_judged_as_in_a_simulation_of_its_own(model: CompiledModel, step: float) -> None:
    coordinate = starts(model, 3)
    coordinate[1] += 0.02 * np.sin(np.arange(coordinate.shape[1]))
    run: dict[str, Any] = {"samples": 21, "method": "rk4", "stepping": Stepping(step=step)}
    batch = simulate_batch(model, 0.1, coordinate=coordinate, **run)
    for k in range(3):
        alone = simulate(model, 0.1, coordinate=coordinate[k], **run)
        assert batch.status[k] == alone.status
        assert batch.message[k] == alone.message.replace(" (model.events)", "")
        assert batch[k].error_estimate == alone.error_estimate
        assert batch[k].n_evaluations == alone.n_evaluations


def test_a_tolerance_that_no_step_meets_is_told_of_each(
    model: CompiledModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    coordinate = starts(model, 3)
    monkeypatch.setattr(batch_integration, "STEPS_BEFORE_FORECAST", 1)
    monkeypatch.setattr(c_run, "FIRST_CHUNK", 4)
    found = simulate_batch(model, T_END, stepping=Stepping(max_steps=2), coordinate=coordinate)
    assert found.status == ("not_converged",) * 3
    assert "too many steps" in found.message[0]


def test_more_samples_than_memory_holds_are_refused(
    model: CompiledModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(motion_input, "MAX_BYTES", 2**17)
    simulate_batch(model, T_END, coordinate=starts(model, 2), samples=20)
    with pytest.raises(InvalidValueError, match="memory"):
        simulate_batch(model, T_END, coordinate=starts(model, 20), samples=20)


@pytest.mark.thorough
def test_cables_that_go_slack_cost_accuracy_no_more_than_the_tolerance() -> None:
    members = [cable(0, 1, 1.0, 40.0), bar(1, 2, 0.7, 90.0)]
    place = [[0.0, 0.0, 0.0], [1.2, 0.0, 0.0], [1.9, 0.1, 0.0]]
    structure = make_structure(place, members, anchored={0: "xyz"}, mass=0.1, axes="xy")
    model = build(structure, parameters={}, events=("auto",))
    coordinate = model.nominal("coordinate") + 0.05 * np.random.default_rng(1).normal(size=(6, 4))
    options: dict[str, Any] = {
        "method": "rk853",
        "rtol": 1e-11,
        "stepping": Stepping(atol=1e-11, control="steps"),
    }

    def move(rows: np.ndarray) -> list[Any]:
        return [simulate(model, 2.0, samples=9, coordinate=row, **options) for row in rows]

    def apart(found: Any, exact: list[Any]) -> np.ndarray:
        pairs = zip(found, exact, strict=True)
        return np.array([np.abs(one.node_position - other.node_position).max() for one, other in pairs])

    tight = move(coordinate)
    assert max(one.log.count for one in tight) > 4
    # How much a small change of the start grows: these motions are sensitive, some 20 and some 300 times.
    changes = 1e-8 * np.random.default_rng(2).normal(size=(3, *coordinate.shape))
    growth = np.max([apart(move(coordinate + change), tight) for change in changes], axis=0) / 1e-8
    for rtol in (1e-5, 1e-7):
        found = simulate_batch(
            model, 2.0, samples=9, coordinate=coordinate, rtol=rtol, stepping=Stepping(atol=rtol)
        )
        assert found.is_ok.all()
        # No farther off than a start that is off by a few tolerances.
        assert np.all(apart([found[k] for k in range(6)], tight) < 5.0 * growth * rtol)


@pytest.mark.thorough
def test_redundant_coordinates_stay_on_their_constraints() -> None:
    structure = prism(150.0)
    model = build(structure, formulation="node_distance", parameters={})
    velocity = np.zeros((3, len(model.nominal("velocity"))))
    once = Stepping(control="steps")
    batch = simulate_batch(model, T_END, samples=SAMPLES, velocity=velocity, stepping=once)
    alone = simulate(model, T_END, samples=SAMPLES, method="rk853", stepping=once)
    assert batch.is_ok.all()
    for name in ("coordinate", "node_position", "node_velocity", "total_energy"):
        np.testing.assert_array_equal(getattr(batch[2], name), getattr(alone, name), err_msg=name)


def test_methods_without_lanes_go_motion_by_motion() -> None:
    structure = prism(150.0, anchored={0: "xyz"}, bar_stiffness=1e8)
    model = build(structure, parameters={"gravity": ()}, integrators=("radau",), batch_width=0)
    coordinate, gravity = np.tile(model.nominal("coordinate"), (4, 1)), np.zeros((4, 3))
    gravity[:, 2] = -np.arange(4.0)
    coordinate[2, 0] = np.nan
    told: list[float] = []
    run = {"samples": SAMPLES, "method": "radau", "rtol": 1e-4, "stepping": Stepping(atol=1e-4)}
    given = {"coordinate": coordinate, "arguments": {"gravity": gravity}}
    batch = simulate_batch(model, T_END, progress=told.append, **given, **run)  # type: ignore[arg-type]
    assert batch.status == ("ok", "ok", "non_finite_input", "ok")
    assert batch.n_reached.tolist() == [SAMPLES, SAMPLES, 0, SAMPLES]
    assert np.isnan(batch.node_position[2]).all()
    assert told == [0.25, 0.5, 0.75, 1.0]
    alone = simulate(model, T_END, arguments={"gravity": gravity[3]}, **run)  # type: ignore[arg-type]
    for name in ("node_position", "member_tension", "total_energy"):
        np.testing.assert_array_equal(getattr(batch[3], name), getattr(alone, name), err_msg=name)
    again = simulate_batch(model, T_END, threads=3, **given, **run)  # type: ignore[arg-type]
    np.testing.assert_array_equal(batch.node_position, again.node_position)


def test_an_interrupt_does_not_wait_for_the_rest(
    model: CompiledModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    called: list[int] = []
    interrupted = threading.Event()
    call = batch_integration._Batch._call

    def slowly(self: Any, rows: slice, *rest: Any) -> int:
        called.append(rows.start)
        if rows.start > 0:  # the first group ends, the others wait until its end was reported
            interrupted.wait()
            time.sleep(0.05)
        return call(self, rows, *rest)

    def interrupt(_: float) -> None:
        interrupted.set()
        raise KeyboardInterrupt

    monkeypatch.setattr(batch_integration._Batch, "_call", slowly)
    with pytest.raises(KeyboardInterrupt):
        simulate_batch(model, T_END, coordinate=starts(model, 800), threads=2, progress=interrupt)
    assert len(called) < 60


def test_a_file_holds_all_motions(model: CompiledModel, tmp_path: Path) -> None:
    coordinate = starts(model, 3)
    coordinate[1, 0] = np.nan
    once = Stepping(control="steps")
    batch = simulate_batch(model, T_END, samples=SAMPLES, coordinate=coordinate, stepping=once)
    assert batch.headline() == "3 motions, 2 ok; the error of 2 is not estimated"
    batch.write(tmp_path / "motions.npz")
    with np.load(tmp_path / "motions.npz") as data:
        assert data["status"].tolist() == ["ok", "non_finite_input", "ok"]
        assert data["node_position"].shape == (3, SAMPLES, 6, 3)
        np.testing.assert_array_equal(data["member_tension"], batch.member_tension)
    said = batch.summary()
    assert (said["n_motions"], said["n_ok"]) == (3, 2)
    assert said["statuses"] == {"ok": 2, "non_finite_input": 1}
    assert said["largest_error_estimate"] is None


# --- refusals --------------------------------------------------------------------------------------


def test_what_does_not_fit_is_refused(model: CompiledModel) -> None:
    q = starts(model, 3)
    rest = model.nominal("rest_length")
    with pytest.raises(InvalidValueError, match="batch axis"):
        simulate_batch(model, 1.0)
    with pytest.raises(InvalidValueError, match="different batch lengths"):
        simulate_batch(model, 1.0, coordinate=q, arguments={"rest_length": np.tile(rest, (4, 1))})
    with pytest.raises(InvalidValueError, match="different batch lengths"):
        simulate_batch(model, 1.0, coordinate=q[:0])
    with pytest.raises(InvalidValueError, match="wrong shape"):
        simulate_batch(model, 1.0, coordinate=q[:, :-1])
    with pytest.raises(UnknownNameError, match="no such argument"):
        simulate_batch(model, 1.0, coordinate=q, arguments={"rest_lenght": rest})
    with pytest.raises(UnknownNameError, match="unknown method"):
        simulate_batch(model, 1.0, coordinate=q, method="rk5")
    with pytest.raises(FormulationError, match="no integrator 'radau'"):
        simulate_batch(model, 1.0, coordinate=q, method="radau")
    with pytest.raises(InvalidValueError, match="needs a step"):
        simulate_batch(model, 1.0, coordinate=q, method="rk4")
    with pytest.raises(InvalidValueError, match="number of threads"):
        simulate_batch(model, 1.0, coordinate=q, threads=0)


@pytest.mark.parametrize(
    ("changes", "error", "match"),
    [
        ({"batch_width": 0, "integrators": ("rk853",)}, LibraryError, "no batch functions"),
        ({"integrators": ("rk4",)}, FormulationError, "no integrator 'rk853'"),
        ({"precision": "single", "integrators": ("rk853",)}, LibraryError, "double precision"),
        ({"quantities": ("acceleration",)}, FormulationError, "functions that a simulation needs"),
    ],
    ids=["no batches", "no integrator", "single precision", "no energies"],
)
def test_a_library_that_cannot_is_named(changes: dict[str, Any], error: type[Exception], match: str) -> None:
    two = make_structure([[0, 0, 0], [1, 0, 0]], [bar(0, 1, 0.9)], axes="xy")
    model = build(two, parameters={}, **changes)
    start = np.tile(model.nominal("coordinate"), (2, 1))
    with pytest.raises(error, match=match):
        simulate_batch(model, 1.0, coordinate=start)
