"""Model-predictive control in C: against a reference in NumPy and LQR, with delays, limits and statuses."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.control.embedded.build_controller import build_controller
from tensegrity_codegen.control.embedded.closed_loop import simulate_control_batch
from tensegrity_codegen.control.embedded.loaded import LoadedController
from tensegrity_codegen.control.embedded.parts import ControllerCode
from tensegrity_codegen.control.feedback.design.linear_samples import build_rest
from tensegrity_codegen.control.feedback.kalman import design_kalman
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorLimits, find_bounds
from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance, Gust
from tensegrity_codegen.control.feedback.loop.tension_distribution import design_distribution
from tensegrity_codegen.control.feedback.lqr import design_lqr
from tensegrity_codegen.control.feedback.mpc import Mpc, design_mpc
from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.structure.actuators import Sensor
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError
from tests.cases import thorough
from tests.codegen.build_c import STRICT, require_cpp, run
from tests.codegen.compilers import require_compiler
from tests.control.embedded.mpc_reference import ReferenceMpc
from tests.control.feedback.pinned_prism import Array, draw_errors

WEIGHT = np.concatenate([np.full(6, 100.0), np.full(6, 0.1), np.full(6, 10.0)])
EFFORT = np.full(9, 1e6)
SAMPLE = 0.005  # [s]
LIFT = """
axes = "z"
name = "lift"

[classes.cord]
kind = "cable"
spring_constant = 100
damping = 2

[nodes]
top = { position = [0, 0, 1], anchored = true }
bottom = { position = [0, 0, -1], anchored = true }
weight = { position = [0, 0, 0], mass = 1.0 }

[members]
upper = { class = "cord", nodes = ["top", "weight"], rest_length = 0.5 }
lower = { class = "cord", nodes = ["weight", "bottom"], rest_length = 0.5 }

[[actuators]]
name = "winch"
members = "upper"
rate = 5.0
range = [0.1, 0.9]
"""  # a linear system while both cables are taut

Build = Callable[..., LoadedController]


@pytest.fixture(scope="module")
def mpc(model: CompiledModel, motion: Motion) -> Mpc:
    names = model.manifest.coordinate_name
    return design_mpc(model, motion, WEIGHT, EFFORT, integral_action=names)


@pytest.fixture
def build(model: CompiledModel, motion: Motion, tmp_path: Path) -> Build:
    """Return a function that builds and starts a controller."""

    def make(mpc: Mpc, folder: str = "controller", **options: Any) -> LoadedController:
        controller = build_controller(model, motion, mpc, out=tmp_path / folder, **options).load()
        controller.init()
        return controller

    return make


@pytest.fixture(scope="module")
def lift(tmp_path_factory: pytest.TempPathFactory) -> tuple[CompiledModel, Motion]:
    path = tmp_path_factory.mktemp("lift") / "lift.toml"
    path.write_text(LIFT, encoding="utf-8")
    model = compile_scene(path, for_=("equilibrium", "control"))
    return model, build_rest(model, find_equilibrium(model), 1.0)


def state_at(motion: Motion, time: float, off: Array) -> Array:
    point = motion.at(time)
    return np.concatenate([point.coordinate + off, point.velocity])


def read_command(controller: LoadedController) -> Array:
    return np.array(list(controller._memory.command))


@pytest.mark.parametrize(
    ("rate", "delay"), [(0.1, 0.0), (0.15, [0.0, 0.005, 0.0075] * 3)], ids=["rate", "delays"]
)
def test_steps_are_those_of_the_reference(
    model: CompiledModel, motion: Motion, build: Build, rate: float, delay: Any
) -> None:
    """Commands over twelve samples with active rates, least tensions and a range of a coordinate."""
    name = model.manifest.coordinate_name[0]
    most = float(motion.coordinate[0, 0]) + 0.01
    limits = ActuatorLimits(rate=rate, delay=delay)
    mpc = design_mpc(
        model, motion, WEIGHT, EFFORT, integral_action=model.manifest.coordinate_name,
        coordinate_range={name: (-1.0, most)},
    )  # fmt: skip
    controller = build(mpc, limits=limits)
    reference = ReferenceMpc(model, motion, mpc, find_bounds(model, motion, limits))
    off = np.radians(1.2) * np.random.default_rng(0).choice([-1.0, 1.0], 6)
    seen = set()
    for k in range(12):
        state = state_at(motion, k * SAMPLE, off * 0.95**k)
        status, _ = controller.step_state(k * SAMPLE, state)
        command, excess = reference.step(k * SAMPLE, state)
        np.testing.assert_allclose(read_command(controller), command, atol=1e-11)
        assert controller._memory.mpc.soft_excess == pytest.approx(excess, abs=1e-11)
        if status == "ok":
            reference.sums += mpc.gains.integral_action @ (state - state_at(motion, k * SAMPLE, 0.0 * off))
        seen.add(status)
    assert "least_tension" in seen


@pytest.mark.parametrize("delay", [0.0, 0.02, 0.04], ids=["now", "one sample", "two samples"])
def test_without_active_limits_a_linear_system_gets_the_command_of_lqr(
    lift: tuple[CompiledModel, Motion], delay: float, tmp_path: Path
) -> None:
    model, rest = lift
    limits = ActuatorLimits(delay=delay)
    options: dict[str, Any] = {"sample": 0.02, "integral_action": ["weight.z"]}
    mpc = design_mpc(model, rest, [100.0, 1.0, 10.0], [50.0], horizon=8, blocks=[1] * 8, **options)
    gains = design_lqr(model, rest, [100.0, 1.0, 10.0], [50.0], delay=delay, **options)
    ahead = build_controller(model, rest, mpc, out=tmp_path / "ahead", limits=limits).load()
    stored = build_controller(model, rest, gains, out=tmp_path / "stored", limits=limits).load()
    ahead.init()
    stored.init()
    for k in range(10):
        state = [rest.coordinate[0, 0] + 1e-4 * np.cos(k), 1e-3 * np.sin(2 * k)]
        assert ahead.step_state(0.02 * k, state)[0] == stored.step_state(0.02 * k, state)[0] == "ok"
        # Runge-Kutta steps of order four are not the matrix exponential of the regulator.
        np.testing.assert_allclose(
            read_command(ahead) - rest.input[0], read_command(stored) - rest.input[0], rtol=2e-4, atol=1e-9
        )


@pytest.mark.parametrize("count", [1, *thorough(2)])
def test_loops_hold_the_errors_of_the_regulator(
    model: CompiledModel, motion: Motion, mpc: Mpc, count: int
) -> None:
    """Draws of the acceptance table of feedback: 1.2 deg, stiffness by 5 %, gusts of 5 N, noise of 0.5 mm."""
    draws = [draw_errors(model, seed, seed) for seed in range(count)]
    estimator = design_kalman(model, motion, sample=SAMPLE)
    for seen, most in ((None, 0.012), (estimator, 0.1)):
        runs = simulate_control_batch(model, motion, mpc, draws=draws, estimator=seen, t_end=3.0)
        last = [np.degrees(np.abs(run.coordinate[-100:] - motion.at(3.0).coordinate).max()) for run in runs]
        assert [run.status for run in runs] == ["ok"] * count
        assert max(last) < most


@pytest.fixture(scope="module")
def ends_without_delay(model: CompiledModel, motion: Motion, mpc: Mpc) -> Array:
    return find_ends(model, motion, mpc, 0.0)


def find_ends(model: CompiledModel, motion: Motion, mpc: Mpc, delay: float) -> Array:
    limits, draws = ActuatorLimits(delay=delay), [draw_errors(model, 0)]
    runs = simulate_control_batch(model, motion, mpc, draws=draws, t_end=3.0, limits=limits)
    return np.array([run.worst_error(last=0.5) for run in runs])


@pytest.mark.parametrize("delay", [*thorough(0.005, 0.01), 0.02])
def test_delays_are_predicted(
    model: CompiledModel, motion: Motion, mpc: Mpc, ends_without_delay: Array, delay: float
) -> None:
    """End errors within twice those without delay."""
    assert (find_ends(model, motion, mpc, delay) < 2.0 * ends_without_delay).all()


def test_disturbance_forces_are_predicted_where_nothing_is_summed(
    lift: tuple[CompiledModel, Motion],
) -> None:
    """A load of 1 N that the controller does not know: without sums and prediction it stays 4.4 mm off."""
    model, rest = lift
    estimator = design_kalman(model, rest, [Sensor("member_length", (0, 1), 1e-5)], sample=0.02)
    mpc = design_mpc(model, rest, [1e4, 1.0], [1.0], sample=0.02)
    load = Disturbance(gust=Gust("weight", (0.0, 0.0, -1.0), 0.0, 100.0))
    ends = [
        simulate_control_batch(model, rest, mpc, draws=[load], estimator=seen, t_end=6.0)[0].worst_error(0.2)
        for seen in (None, estimator)
    ]
    assert ends[0] > 1e-4
    assert ends[1] < 0.2 * ends[0]


def test_least_tensions_are_kept_where_lqr_lets_cables_go_slack(
    lift: tuple[CompiledModel, Motion],
) -> None:
    model, rest = lift
    push = Disturbance(velocity_error=[6.5])
    mpc = design_mpc(model, rest, [100.0, 1.0], [1.0], sample=0.02, least_tension=15.0)
    free = design_mpc(model, rest, [100.0, 1.0], [1.0], sample=0.02, least_tension=-np.inf)
    least = [
        simulate_control_batch(model, rest, item, draws=[push], t_end=1.0)[0].member_tension[1:, 0].min()
        for item in (mpc, free)
    ]
    assert least[1] < 1.0
    assert least[0] > 5.0


def test_a_program_that_is_not_solved_goes_on_with_the_last_plan(
    motion: Motion, mpc: Mpc, build: Build
) -> None:
    """One iteration is too few where limits are active; the first command without a plan is the motion's."""
    controller = build(mpc, code=ControllerCode(qp_iterations=1))
    calm, off = np.zeros(6), np.radians(3.0) * np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    assert controller.step_state(0.0, state_at(motion, 0.0, calm))[0] == "ok"
    plan = np.array(list(controller._memory.mpc.move)).reshape(-1, 9)
    assert controller.step_state(SAMPLE, state_at(motion, SAMPLE, off))[0] == "not_solved"
    expected = motion.at(1.5 * SAMPLE).input + plan[1]
    np.testing.assert_allclose(read_command(controller), expected, atol=1e-12)
    fresh = build(mpc, "fresh", code=ControllerCode(qp_iterations=1))
    assert fresh.step_state(0.0, state_at(motion, 0.0, off))[0] == "not_solved"
    np.testing.assert_allclose(read_command(fresh), motion.at(0.5 * SAMPLE).input, atol=1e-12)


def test_hostile_sensors_and_states_keep_commands_within_rate_and_range(
    model: CompiledModel, motion: Motion, mpc: Mpc, build: Build
) -> None:
    estimator = design_kalman(model, motion, sample=SAMPLE)
    controller = build(mpc, estimator=estimator)
    bounds = find_bounds(model, motion)
    rng = np.random.default_rng(1)
    good = np.asarray(model.compute("member_length", coordinate=motion.coordinate[0]))[3:]
    last = motion.at(0.0).input
    for k in range(60):
        measured = good + 5e-4 * rng.normal(size=9)
        kind = rng.integers(6)
        if kind == 0:
            measured[rng.integers(9)] = rng.choice([np.nan, np.inf, -1.0, 1e300, 0.0])
        elif kind == 1:
            measured *= 10.0 ** rng.normal()
        time = k * SAMPLE if kind != 2 else float(rng.choice([np.nan, -1.0, 1e9]))
        controller.step(time, measured)
        command = read_command(controller)
        assert np.isfinite(command).all()
        assert (np.abs(command - last) <= bounds.rate * SAMPLE + 1e-9).all()
        assert (command >= bounds.least - 1e-9).all()
        assert (command <= bounds.most + 1e-9).all()
        last = command


def test_extreme_states_end_in_a_status(motion: Motion, mpc: Mpc, build: Build) -> None:
    controller = build(mpc)
    for k, size in enumerate([1e3, 1e10, 1e150, 1e308, 0.0]):
        status, rest = controller.step_state(k * SAMPLE, state_at(motion, 0.0, size * np.ones(6)))
        assert np.isfinite(rest).all()
        assert status in {"not_solved", "least_tension", "rate_limited", "ok", "tension_limited"}
    assert controller._memory.mpc.is_planned or status == "not_solved"


def test_a_target_moves_while_the_controller_runs(lift: tuple[CompiledModel, Motion], tmp_path: Path) -> None:
    """The mass follows a target that rises by 5 cm in a second, known at each sample only."""
    model, rest = lift
    mpc = design_mpc(model, rest, [1e4, 1.0, 1e3], [1.0], sample=0.02, integral_action=["weight.z"])
    controller = build_controller(model, rest, mpc, out=tmp_path / "target").load()
    controller.init()
    state = np.array([rest.coordinate[0, 0], 0.0])
    for k in range(150):
        controller._memory.mpc.target[0] = 0.05 * min(0.02 * k, 1.0)
        assert controller.step_state(0.02 * k, state)[0] in {"ok", "rate_limited"}
        value = read_command(controller)
        for _ in range(20):
            at = {"coordinate": state[:1].copy(), "velocity": state[1:].copy(), "input": value}
            rate = float(np.asarray(model.compute("acceleration", **at))[0])
            state = state + 0.001 * np.array([state[1] + 0.0005 * rate, rate])
    assert state[0] == pytest.approx(rest.coordinate[0, 0] + 0.05, abs=2e-4)


def test_single_precision_gives_the_same_commands(motion: Motion, mpc: Mpc, build: Build) -> None:
    double, single = build(mpc), build(mpc, "single", code=ControllerCode(precision="single"))
    off = np.radians(0.3) * np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    for k in range(10):
        state = state_at(motion, k * SAMPLE, off * 0.9**k)
        double.step_state(k * SAMPLE, state)
        single.step_state(k * SAMPLE, state)
        np.testing.assert_allclose(read_command(single), read_command(double), atol=2e-5)


@pytest.mark.parametrize("family", ["gcc", "clang"])
@pytest.mark.parametrize("precision", [*thorough("double"), "single"])
def test_the_files_compile_without_a_warning_and_allocate_nothing(
    model: CompiledModel, motion: Motion, mpc: Mpc, precision: str, family: str, tmp_path: Path
) -> None:
    folder = tmp_path / precision
    code = ControllerCode(precision=precision, library=False, name="ahead")
    build_controller(model, motion, mpc, out=folder, code=code)
    text = (folder / "ahead_control.c").read_text() + (folder / "ahead_control_daqp.h").read_text()
    assert "malloc(" not in text
    assert "calloc(" not in text
    command = [*require_compiler(family).command, "-std=c99", "-O2", *STRICT, "-Wshadow"]
    command += ["-Wdouble-promotion"] if precision == "single" else []
    run([*command, "-c", "ahead_control.c", "-o", "ahead.o"], folder)
    run(
        [*require_cpp("g++"), "-std=c++11", *STRICT, "-x", "c++", "-c", "ahead_control.h", "-o", "h.o"],
        folder,
    )
    sources = ("example.c", "ahead_control.c", "ahead_control_model.c")
    run([*require_compiler(family).command, "-O1", "-std=c99", "-o", "example", *sources, "-lm"], folder)
    assert "step 9: " in run([str(folder / "example")], folder).stdout


# Wrong designs.


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"horizon": 0}, "horizon"),
        ({"horizon": 201}, "horizon"),
        ({"horizon": 4, "blocks": [1, 2]}, "blocks"),
        ({"horizon": 3, "blocks": [1, 0, 2]}, r"blocks\[1\]"),
        ({"soft_weight": 0.0}, "soft_weight"),
        ({"coordinate_range": {"weight.z": (1.0, 0.0)}}, "coordinate_range.weight.z"),
        ({"least_tension": [1.0, 2.0, 3.0]}, "least_tension"),
    ],
)
def test_wrong_designs_are_refused(
    lift: tuple[CompiledModel, Motion], options: dict[str, Any], message: str
) -> None:
    model, rest = lift
    with pytest.raises(InvalidValueError, match=message):
        design_mpc(model, rest, [1.0, 1.0], [1.0], sample=0.02, **options)


def test_unknown_coordinates_and_a_distribution_are_refused(
    lift: tuple[CompiledModel, Motion], model: CompiledModel, motion: Motion, mpc: Mpc, tmp_path: Path
) -> None:
    with pytest.raises(UnknownNameError, match=r"weight\.z"):
        design_mpc(*lift, [1.0, 1.0], [1.0], sample=0.02, coordinate_range={"weight": (0.0, 1.0)})
    tensions = design_distribution(model, motion)
    with pytest.raises(InvalidValueError, match="least tensions itself"):
        build_controller(model, motion, mpc, distribution=tensions, out=tmp_path / "both")
