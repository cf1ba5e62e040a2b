"""Simulation against closed forms, against itself at half the step, and against SciPy."""

import itertools
import json
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.integrate import c_run
from tensegrity_codegen.runtime.integrate.methods import METHODS
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.system.errors import (
    FormulationError,
    InvalidValueError,
    NonFiniteError,
    UnknownNameError,
)
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.models import simulator
from tests.runtime.build import cable, make_structure, prism, spring

RATE = float(np.sqrt(200.0))  # of the oscillator: two masses of 1 kg on 100 N/m
SLOW = [name for name in METHODS if name.startswith("scipy_") and name != "scipy_dop853"]


def build(structure: Structure, **parameters: tuple[int, ...]) -> CompiledModel:
    return simulator(structure, "rk4", "rk54", "rk853", parameters=parameters)


def two_nodes(**more: Any) -> Structure:
    return make_structure([[0, 0, 0], [1, 0, 0]], [spring(0, 1, 0.9, **more)])


@pytest.fixture(scope="module")
def oscillator() -> CompiledModel:
    return build(two_nodes())


@pytest.fixture(scope="module")
def damped() -> CompiledModel:
    return build(two_nodes(damping=2.0), damping=(0,))


@pytest.fixture(scope="module")
def tumbling() -> CompiledModel:
    """A triangle of two-sided springs, spinning and shaking: smooth and far from linear."""
    members = [spring(0, 1, 0.7, 80.0), spring(1, 2, 0.8, 50.0), spring(2, 0, 0.9, 60.0)]
    structure = make_structure([[0, 0, 0], [1, 0, 0], [0.3, 0.9, 0]], members, mass=[1.0, 0.7, 1.3])
    velocity = [[0, 1.0, 0.3], [0.2, -1.0, 0], [0.5, 0, -0.6]]
    return build(structure.with_changes(node_velocity=np.array(velocity)), rest_length=(0, 2))


def length(run: Any) -> np.ndarray:
    return np.linalg.norm(run.node_position[:, 0] - run.node_position[:, 1], axis=1)


# --- closed forms ----------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["auto", "scipy_dop853", *thorough(*SLOW)])
def test_two_nodes_swing_as_a_cosine(oscillator: CompiledModel, method: str) -> None:
    control = "samples" if method == "auto" else "steps"  # twenty times as quick
    run = simulate(oscillator, 3.0, method=method, rtol=1e-9, stepping=Stepping(atol=1e-12, control=control))
    assert run.status == "ok"
    np.testing.assert_allclose(length(run), 0.9 + 0.1 * np.cos(RATE * run.time), atol=2e-7)
    np.testing.assert_allclose(run.member_tension[:, 0], 10 * np.cos(RATE * run.time), atol=2e-5)
    np.testing.assert_allclose(run.total_energy, 0.5, atol=1e-6)
    np.testing.assert_allclose(run.kinetic_energy, 0.5 * np.sin(RATE * run.time) ** 2, atol=1e-6)


def test_the_tolerance_is_kept(oscillator: CompiledModel) -> None:
    for rtol in (1e-4, 1e-7, 1e-10):
        run = simulate(oscillator, 3.0, rtol=rtol, stepping=Stepping(atol=rtol))
        error = np.abs(length(run) - 0.9 - 0.1 * np.cos(RATE * run.time)).max()
        assert error < 4 * rtol
        assert run.error_estimate is not None
        assert run.error_estimate <= 1.0


@pytest.mark.parametrize("method", ["scipy_dop853", *thorough(*SLOW)])
def test_errors_of_scipy_add_up_and_are_checked(oscillator: CompiledModel, method: str) -> None:
    """Over seventy radians; one run with the error of each step controlled is wrong but for Radau's."""
    given: dict[str, Any] = {"method": method, "samples": 11, "rtol": 1e-5}

    def error(run: Any) -> float:
        speed = -0.05 * RATE * np.sin(RATE * run.time)
        return float(np.abs(run.node_velocity[:, 1, 0] - speed).max() / 1e-5)

    once = simulate(oscillator, 5.0, stepping=Stepping(atol=1e-7, control="steps"), **given)
    assert (once.status, once.error_estimate) == ("ok", None)
    assert "not estimated" in once.message
    assert error(once) > 5.0 or method == "scipy_radau"
    run = simulate(oscillator, 5.0, stepping=Stepping(atol=1e-7), **given)
    assert run.status == "ok"
    assert run.error_estimate is not None
    assert run.error_estimate <= 1.0
    assert error(run) < 2.0
    assert run.n_steps > once.n_steps > 11
    short = simulate(oscillator, 5.0, stepping=Stepping(atol=1e-7, max_steps=20), **given)
    assert short.status == "not_converged"
    assert "too many steps" in short.message


def test_damping_takes_the_energy_of_a_damped_cosine(damped: CompiledModel) -> None:
    """x'' = -2 (c x' + mu x) for the elongation x of two masses of 1 kg."""
    run = simulate(damped, 2.0, rtol=1e-9, stepping=Stepping(atol=1e-12))
    rate = np.sqrt(200.0 - 2.0**2)
    wave = np.exp(-2.0 * run.time) * (np.cos(rate * run.time) + 2.0 / rate * np.sin(rate * run.time))
    np.testing.assert_allclose(length(run), 0.9 + 0.1 * wave, atol=1e-8)
    assert run.energy_drift is None
    assert (np.diff(run.total_energy) <= 1e-12).all()


def test_a_free_fall_with_a_slack_cable_is_exact() -> None:
    structure = make_structure([[0, 0, 0], [1, 0, 0]], [cable(0, 1, 1.5)], gravity=(0, 0, -10.0))
    run = simulate(build(structure), 1.0, method="rk4", stepping=Stepping(step=0.1), samples=5)
    np.testing.assert_allclose(run.node_position[:, :, 2], np.repeat(-5.0 * run.time[:, None] ** 2, 2, 1))
    assert (run.member_tension == 0.0).all()


# --- order and agreement ---------------------------------------------------------------------------


def test_half_the_step_gives_a_sixteenth_of_the_error(tumbling: CompiledModel) -> None:
    runs = [
        simulate(tumbling, 1.0, method="rk4", stepping=Stepping(step=0.005 / 2**k), samples=8)
        for k in range(4)
    ]
    gaps = [
        np.linalg.norm(coarse.coordinate[-1] - fine.coordinate[-1])
        for coarse, fine in itertools.pairwise(runs)
    ]
    orders = np.log2(np.divide(gaps[:-1], gaps[1:]))
    assert orders == pytest.approx(4.0, abs=0.1)


def test_samples_between_steps_are_as_exact_as_the_steps(tumbling: CompiledModel) -> None:
    exact = simulate(tumbling, 1.0, method="rk4", stepping=Stepping(step=1e-4), samples=38)
    errors = []
    for step in (0.01, 0.005):
        run = simulate(tumbling, 1.0, method="rk4", stepping=Stepping(step=step), samples=38)
        errors.append([np.abs(getattr(run, n) - getattr(exact, n)).max() for n in ("coordinate", "velocity")])
    np.testing.assert_allclose(np.log2(np.divide(errors[0], errors[1])), 4.0, atol=0.3)


@pytest.mark.parametrize(
    ("method", "rtol", "atol"), [("scipy_dop853", 1e-11, 1e-8), *thorough(("scipy_radau", 1e-8, 1e-5))]
)
def test_it_agrees_with_scipy(tumbling: CompiledModel, method: str, rtol: float, atol: float) -> None:
    own = simulate(tumbling, 2.0, rtol=1e-10, stepping=Stepping(atol=1e-10), samples=21)
    other = simulate(
        tumbling, 2.0, method=method, rtol=rtol, stepping=Stepping(atol=rtol, control="steps"), samples=21
    )
    assert own.status == other.status == "ok"
    np.testing.assert_allclose(own.coordinate, other.coordinate, atol=atol)
    np.testing.assert_allclose(own.velocity, other.velocity, atol=10 * atol)


def test_cables_that_go_slack_keep_their_energy() -> None:
    structure = prism(150.0, bar_stiffness=2e3)
    velocity = np.zeros((6, 3))
    velocity[3] = [1.0, -2.0, 1.0]
    run = simulate(build(structure.with_changes(node_velocity=velocity)), 1.0, samples=51)
    assert (run.member_tension == 0.0).any()
    assert run.status == "ok"
    assert run.energy_drift is not None
    assert run.energy_drift < 1e-4


# --- samples, chunks, arguments --------------------------------------------------------------------


@pytest.mark.parametrize(("t_end", "samples", "step"), [(1.0, 2, 0.3), (0.7, 8, 0.01), (1 / 3, 100, 1 / 900)])
def test_the_first_and_last_samples_are_the_ends(
    oscillator: CompiledModel, t_end: float, samples: int, step: float
) -> None:
    run = simulate(oscillator, t_end, samples=samples, method="rk4", stepping=Stepping(step=step))
    assert len(run.time) == samples
    assert (run.time[0], run.time[-1]) == (0.0, t_end)
    assert run.step is not None
    assert run.step <= step * (1 + 1e-9)
    assert run.n_steps * run.step == pytest.approx(t_end, rel=1e-14)
    np.testing.assert_array_equal(run.coordinate[0], oscillator.nominal("coordinate"))
    fewer = simulate(oscillator, t_end, samples=2, method="rk4", stepping=Stepping(step=step))
    np.testing.assert_array_equal(run.coordinate[-1], fewer.coordinate[-1])
    np.testing.assert_array_equal(run.velocity[-1], fewer.velocity[-1])


@pytest.mark.parametrize("seconds", [-1.0, np.inf], ids=["chunks of one size", "chunks that double"])
def test_chunks_do_not_change_a_bit(
    tumbling: CompiledModel, monkeypatch: pytest.MonkeyPatch, seconds: float
) -> None:
    one_run = {"method": "rk4", "stepping": Stepping(step=1e-3, control="steps"), "samples": 77}
    usual = simulate(tumbling, 1.0, **one_run)  # type: ignore[arg-type]
    monkeypatch.setattr(c_run, "CHUNK_SECONDS", seconds)
    seen: list[float] = []
    chunked = simulate(tumbling, 1.0, progress=seen.append, **one_run)  # type: ignore[arg-type]
    np.testing.assert_array_equal(chunked.coordinate, usual.coordinate)
    np.testing.assert_array_equal(chunked.velocity, usual.velocity)
    steps = seen[: seen.index(1.0) + 1]
    assert len(steps) == (16 if seconds < 0 else 5)
    assert steps == sorted(steps)
    assert seen[-1] == 1.0


def test_the_progress_is_that_of_all_runs_together(tumbling: CompiledModel) -> None:
    seen: list[float] = []
    simulate(
        tumbling, 1.0, method="rk4", stepping=Stepping(step=1e-3), samples=77, progress=seen.append
    )  # held to another run
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    assert seen.count(1.0) == 1


def test_a_fixed_step_is_held_to_a_run_with_twice_that(oscillator: CompiledModel) -> None:
    exact = simulate(oscillator, 20.0, samples=5, rtol=1e-10, stepping=Stepping(atol=1e-12))
    for step in (50.0, 1e6):
        assert (
            simulate(oscillator, 20.0, samples=5, method="rk4", stepping=Stepping(step=step)).status != "ok"
        )
    for step in (0.01, 0.1, 0.2, 0.3, 0.4):
        run = simulate(oscillator, 20.0, samples=5, method="rk4", stepping=Stepping(step=step / RATE))
        assert run.error_estimate is not None
        size, speed = 1.0, np.abs(exact.velocity).max()
        lost = max(
            np.abs(run.coordinate - exact.coordinate).max() / (1e-2 * size),
            np.abs(run.velocity - exact.velocity).max() / (1e-2 * speed),
        )
        assert lost < max(1.0, 10.0 * run.error_estimate), step
        if lost > 10.0:
            assert run.status != "ok", step


def test_run_time_parameters_reach_the_integrator(tumbling: CompiledModel) -> None:
    changed = tumbling.nominal("rest_length") * 1.1
    run = simulate(tumbling, 0.5, arguments={"rest_length": changed}, rtol=1e-9)
    other = simulate(tumbling, 0.5, method="scipy_dop853", arguments={"rest_length": changed}, rtol=1e-11)
    np.testing.assert_allclose(run.coordinate, other.coordinate, atol=1e-7)
    assert np.abs(run.coordinate - simulate(tumbling, 0.5).coordinate).max() > 1e-3


def test_an_initial_state_may_be_given(oscillator: CompiledModel) -> None:
    still = np.array([0.0, 0, 0, 0.9, 0, 0])
    drift = np.array([1.0, 2.0, 3.0] * 2)
    run = simulate(oscillator, 1.0, coordinate=still, velocity=drift.tolist())
    np.testing.assert_allclose(run.coordinate[-1], still + drift, atol=1e-12)
    assert (still == [0.0, 0, 0, 0.9, 0, 0]).all()


def test_inputs_are_arguments() -> None:
    push = ActuatedInput("push", "force", (0, 1), (0.0, 0.0, 1.0))
    model = build(two_nodes().with_changes(inputs=(push,)))
    run = simulate(model, 1.0, arguments={"input": [2.0]}, rtol=1e-9)
    np.testing.assert_allclose(run.node_position[-1, :, 2], 1.0, atol=1e-9)


def test_moved_anchors_are_where_they_were_moved_to() -> None:
    structure = make_structure([[0, 0, 0], [1, 0, 0]], [spring(0, 1, 1.0)], anchored={0: "xyz"})
    run = simulate(build(structure, anchor_position=(0,)), 0.1, arguments={"anchor_position": [[0.5, 0, 0]]})
    assert (run.node_position[:, 0] == [0.5, 0, 0]).all()
    assert run.node_position[-1, 1, 0] > 1.0


# --- how a run ends --------------------------------------------------------------------------------


def test_a_step_that_is_too_long_is_unstable(oscillator: CompiledModel) -> None:
    run = simulate(oscillator, 100.0, method="rk4", stepping=Stepping(step=5.0 / RATE))
    assert run.status == "unstable"
    assert "smaller step" in run.message
    assert np.isfinite(run.coordinate).all()


def test_a_run_that_ends_early_keeps_what_it_reached(damped: CompiledModel) -> None:
    run = simulate(damped, 1000.0, method="rk4", stepping=Stepping(step=1.0), arguments={"damping": [200.0]})
    assert run.status == "unstable"
    assert 1 <= len(run.time) < 101
    for values in (run.coordinate, run.member_tension, run.total_energy):
        assert len(values) == len(run.time)
        assert np.isfinite(values).all()


def test_a_long_step_that_eats_energy_is_inaccurate(oscillator: CompiledModel) -> None:
    run = simulate(oscillator, 20.0, method="rk4", stepping=Stepping(step=1.5 / RATE))
    assert run.status == "inaccurate"
    assert run.energy_drift is not None
    assert run.energy_drift > 0.1
    assert run.total_energy[-1] < run.total_energy[0]


def test_a_named_method_keeps_its_samples_within_the_tolerance(oscillator: CompiledModel) -> None:
    """Over 200 s the errors of steps add up, which control of the steps does not tell."""
    exact = simulate(
        oscillator,
        200.0,
        samples=11,
        method="rk853",
        rtol=1e-12,
        stepping=Stepping(atol=1e-14, control="steps"),
    )
    errors = []
    for control in ("samples", "steps"):
        run = simulate(
            oscillator,
            200.0,
            samples=11,
            method="rk54",
            rtol=1e-6,
            stepping=Stepping(atol=1e-8, control=control),
        )
        assert run.status == "ok"
        apart = np.abs(run.coordinate - exact.coordinate) / (1e-8 + 1e-6 * np.abs(exact.coordinate))
        errors.append(float(apart.max()))
    assert errors[0] < 1.0 < 10.0 < errors[1]


def test_damping_that_eats_energy_is_fine(damped: CompiledModel) -> None:
    assert simulate(damped, 2.0, method="rk4", stepping=Stepping(step=0.01)).status == "ok"


def test_a_tolerance_below_rounding_is_not_converged(tumbling: CompiledModel) -> None:
    run = simulate(tumbling, 1.0, rtol=1e-17, stepping=Stepping(atol=1e-19))
    assert run.status == "not_converged"
    assert "loosen" in run.message
    assert run.error_estimate is not None
    assert run.error_estimate > 1.0


def test_a_summary_is_ready_for_json(oscillator: CompiledModel) -> None:
    summary = json.loads(json.dumps(simulate(oscillator, 1.0).summary()))
    assert (summary["status"], summary["t_end"], summary["n_samples"]) == ("ok", 1.0, 101)
    assert 0 <= summary["energy_drift"] < 1e-3


# --- what is refused -------------------------------------------------------------------------------


OPTIONS: list[tuple[dict[str, Any], str]] = [
    ({"stepping": Stepping(control="nothing")}, "control"),
    ({"t_end": 0.0}, "t_end"),
    ({"t_end": -1.0}, "t_end"),
    ({"t_end": np.nan}, "t_end"),
    ({"t_end": np.inf}, "t_end"),
    ({"rtol": 0.0}, "rtol"),
    ({"stepping": Stepping(atol=-1e-3)}, "atol"),
    ({"samples": 1}, "samples"),
    ({"method": "rk4"}, "step"),
    ({"method": "rk4", "stepping": Stepping(step=0.0)}, "step"),
    ({"method": "rk4", "stepping": Stepping(step=np.nan)}, "step"),
    ({"method": "rk4", "stepping": Stepping(step=1e-320)}, "step"),
    ({"stepping": Stepping(step=0.1)}, "step"),
    ({"method": "scipy_rk45", "stepping": Stepping(step=0.1)}, "step"),
    ({"coordinate": np.zeros(5)}, "coordinate"),
    ({"velocity": np.zeros(7)}, "velocity"),
    ({"coordinate": np.zeros(5), "velocity": np.zeros(7)}, "coordinate"),
    ({"coordinate": np.zeros((2, 3))}, "coordinate"),
]


@pytest.mark.parametrize(("options", "where"), OPTIONS, ids=lambda value: str(value).replace("\n", ""))
def test_options_out_of_range_are_named(oscillator: CompiledModel, options: Any, where: str) -> None:
    with pytest.raises(InvalidValueError) as caught:
        simulate(oscillator, **({"t_end": 1.0} | options))
    assert caught.value.where == where
    assert caught.value.allowed or caught.value.hint


@pytest.mark.parametrize("shape", [(1,), (3,), (2, 2)])
@pytest.mark.parametrize(
    "options", [{"method": "rk4", "stepping": Stepping(step=0.01)}, {}], ids=["rk4", "auto"]
)
def test_a_parameter_of_the_wrong_size_never_reaches_the_loop(
    tumbling: CompiledModel, options: dict[str, Any], shape: tuple[int, ...]
) -> None:
    with pytest.raises(InvalidValueError, match="wrong shape"):
        simulate(tumbling, 0.1, arguments={"rest_length": np.ones(shape)}, **options)


def test_a_parameter_that_is_not_finite_is_named(tumbling: CompiledModel) -> None:
    with pytest.raises(NonFiniteError, match="'rest_length' is not finite"):
        simulate(
            tumbling,
            0.1,
            method="rk4",
            stepping=Stepping(step=0.01),
            arguments={"rest_length": [1.0, np.nan]},
        )


@pytest.mark.parametrize("name", ["rest_lengths", "gravity", "coordinate", "velocity"])
def test_an_argument_that_the_model_lacks_is_refused(tumbling: CompiledModel, name: str) -> None:
    with pytest.raises(UnknownNameError) as caught:
        simulate(tumbling, 0.1, arguments={name: [1.0, 1.0]})
    assert caught.value.given == name
    assert "rest_length" in caught.value.allowed


def test_an_unknown_method_suggests_the_closest(oscillator: CompiledModel) -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'scipy_dop853'"):
        simulate(oscillator, 1.0, method="scipy_dop583")


@pytest.mark.parametrize("name", ["coordinate", "velocity"])
@pytest.mark.parametrize("method", ["auto", "scipy_radau"])
def test_an_initial_state_that_is_not_finite_is_refused(
    oscillator: CompiledModel, name: str, method: str
) -> None:
    bad = np.ones(6)
    bad[2] = np.nan
    with pytest.raises(NonFiniteError, match=f"initial {name}"):
        simulate(oscillator, 1.0, method=method, **{name: bad})


def test_a_library_without_the_integrator_says_how_to_get_it() -> None:
    model = simulator(two_nodes())
    for options in ({}, {"method": "rk4", "stepping": Stepping(step=0.01)}):
        with pytest.raises(FormulationError) as caught:
            simulate(model, 1.0, **options)
        assert "integrators" in caught.value.hint
    assert simulate(model, 0.1, method="scipy_rk45").status == "ok"


def test_a_library_without_the_energies_names_them() -> None:
    library = build_library(two_nodes(), ModelRequest(("acceleration", "member_tension")))
    with pytest.raises(FormulationError, match="functions that a simulation needs") as caught:
        simulate(library.load(), 1.0, method="scipy_rk45")
    assert caught.value.given == "kinetic_energy, total_energy"


@pytest.mark.parametrize(
    ("method", "step"),
    [("auto", None), ("rk54", None), ("rk853", None), ("rk4", 0.01), ("scipy_dop853", None)],
)
def test_samples_at_given_times_are_those_of_the_same_motion(tumbling, method, step):
    some = simulate(
        tumbling,
        1.0,
        samples=[0.0, 0.1, 0.25, 0.7, 1.0],
        method=method,
        stepping=Stepping(step=step),
        rtol=1e-9,
    )
    many = simulate(tumbling, 1.0, samples=21, method=method, stepping=Stepping(step=step), rtol=1e-9)
    assert some.time.tolist() == [0.0, 0.1, 0.25, 0.7, 1.0]
    assert some.status == "ok"
    np.testing.assert_allclose(some.node_position, many.node_position[[0, 2, 5, 14, 20]], rtol=0, atol=1e-7)
