"""Paths put in time: the points of a plan, rates and durations, what is refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from tensegrity_codegen.control.feedback.closed_loop import simulate_control
from tensegrity_codegen.control.feedback.equilibrium_path import EquilibriumPath
from tensegrity_codegen.control.feedback.kalman import design_kalman
from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance
from tensegrity_codegen.control.feedback.lqr import design_lqr
from tensegrity_codegen.control.feedback.mpc import design_mpc
from tensegrity_codegen.control.feedback.time_motion import record_motion, time_motion
from tensegrity_codegen.control.planning.plan import plan
from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.profiles.read_profile import read_profile
from tensegrity_codegen.runtime.records.plan_result import PlanResult
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.structure.actuators import Sensor
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    FormulationError,
    InvalidValueError,
    NonFiniteError,
    StructureError,
    UnknownNameError,
)
from tests.control.embedded.test_mpc import LIFT
from tests.control.feedback.structures import build_prism, compile_motion, plan_prism
from tests.control.planning.structures import actuate
from tests.models import ROOT
from tests.runtime.build import bar, cable, make_structure

PRISM = build_prism()

SAMPLE = 0.02  # [s]


def find() -> PlanResult:
    return plan_prism(PRISM)


def make(duration: float | None = 2.0, **more: Any) -> Motion:
    """Return the motion by the inputs of the equilibria."""
    return time_motion(compile_motion(PRISM), find(), duration, feedforward="static", **more)


def test_the_points_of_the_plan_are_passed_at_their_progress() -> None:
    motion, found = make(), find()
    for k in range(1, found.n_steps):
        part = brentq(lambda x, k=k: 10 * x**3 - 15 * x**4 + 6 * x**5 - found.progress[k], 0, 1, xtol=1e-15)
        at = motion.at(2.0 * part)
        np.testing.assert_allclose(at.coordinate, found.coordinate[k], atol=1e-8)
        np.testing.assert_allclose(at.input, found.change[k], atol=1e-8)
    for row, k in ((0, 0), (-1, found.n_steps)):
        np.testing.assert_allclose(motion.coordinate[row], found.coordinate[k], atol=1e-12)
        np.testing.assert_allclose(motion.input[row], found.change[k], atol=1e-12)
        np.testing.assert_allclose(motion.rest_length[row], found.rest_length[k], atol=1e-12)
        np.testing.assert_allclose(motion.member_tension[row], found.member_tension[k], atol=1e-6)


def test_velocities_and_accelerations_are_the_derivatives_of_the_coordinates() -> None:
    motion, step = make(), 1e-4
    for time in (0.3, 0.97, 1.612):
        low, at, high = (motion.at(time + shift) for shift in (-step, 0.0, step))
        np.testing.assert_allclose((high.coordinate - low.coordinate) / (2 * step), at.velocity, atol=1e-7)
        np.testing.assert_allclose((high.velocity - low.velocity) / (2 * step), at.acceleration, atol=1e-6)
    assert np.abs(motion.velocity[[0, -1]]).max() < 1e-12
    assert np.abs(motion.acceleration[[0, -1]]).max() < 1e-9


@pytest.mark.parametrize("feedforward", ["static", "dynamic"])
def test_there_and_back_is_the_motion_and_its_mirror_image(feedforward: str) -> None:
    model = compile_motion(PRISM)
    once = time_motion(model, find(), 2.0, feedforward=feedforward, samples=51)
    both = time_motion(model, find(), 4.0, feedforward=feedforward, samples=101, there_and_back=True)
    for name, sign in (("coordinate", 1.0), ("velocity", -1.0), ("acceleration", 1.0)):
        value, part = getattr(both, name), getattr(once, name)
        np.testing.assert_allclose(value[:51], part, atol=1e-10 * (1 + np.abs(part).max()))
        np.testing.assert_allclose(value[:49:-1], sign * part, atol=1e-10 * (1 + np.abs(part).max()))
    np.testing.assert_allclose(both.input[:51], once.input, atol=1e-9)
    if feedforward == "static":
        assert both.shortest_duration == pytest.approx(2 * once.shortest_duration, rel=1e-4)


def test_there_and_back_takes_twice_the_time_of_a_table() -> None:
    table = [[0.0, 0.0], [0.7, 0.2], [1.5, 1.0]]
    motion = make(None, law=table, there_and_back=True, samples=61)
    assert motion.duration == 3.0
    np.testing.assert_allclose(motion.at(1.5).coordinate, find().coordinate[-1], atol=1e-8)
    np.testing.assert_allclose(motion.at(0.7).coordinate, motion.at(2.3).coordinate, atol=1e-9)


def test_there_and_back_faster_than_the_rates_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="too fast"):
        make(0.5, there_and_back=True)


def test_the_motion_between_its_points_is_made_of_equilibria() -> None:
    motion, model = make(), compile_motion(PRISM)
    assert motion.path_error < 1e-8
    for row in (37, 100, 141):
        found = find_equilibrium(
            model, coordinate=motion.coordinate[row], arguments={"input": motion.input[row]}
        )
        np.testing.assert_allclose(found.coordinate, motion.coordinate[row], atol=1e-7)


def test_a_gap_between_points_names_what_makes_them_nearer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tensegrity_codegen.control.feedback.equilibrium_path.MIN_REACH", -1.0)
    with pytest.raises(ConvergenceError, match="between two points") as caught:
        make()
    assert "`plan SCENE --steps 100 --out plan.npz`, then `plan=plan.npz`" in caught.value.hint


def test_peak_rates_are_the_largest_slopes_of_the_profile() -> None:
    motion = make(1.7, samples=31)
    profile, time = motion.profile(), np.linspace(0, 1.7, 40001)
    values = np.array([profile.pieces.at(t) for t in time])
    rate = np.abs(np.diff(values, axis=0) / np.diff(time)[:, None]).max(axis=0)
    np.testing.assert_allclose(motion.peak_rate, rate, rtol=1e-5)


def test_the_shortest_motion_is_as_fast_as_its_fastest_motor() -> None:
    shortest = make(None)
    assert shortest.duration == shortest.shortest_duration
    assert shortest.peak_rate.max() == pytest.approx(0.05, rel=1e-4)
    twice = make(2 * shortest.duration)
    assert twice.shortest_duration == pytest.approx(shortest.duration)


def test_a_duration_below_the_shortest_is_refused_with_cable_time_and_rate() -> None:
    shortest = make(None).duration
    with pytest.raises(InvalidValueError) as caught:
        make(0.5 * shortest)
    text, peak = str(caught.value), make(None).peak_rate
    fastest = [
        name for name, rate in zip(find().actuator_name, peak, strict=True) if rate > 0.999 * peak.max()
    ]
    assert any(f"{name} of {name.removeprefix('pull_')}" in text for name in fastest)
    assert f"{2 * peak.max():.3g}"[:4] in text
    assert " m/s at 0." in text
    assert f"at least {shortest:.6g} s" in text
    assert caught.value.exit_code == 2
    assert make(1.0001 * shortest).duration == 1.0001 * shortest


def test_a_table_has_its_own_duration() -> None:
    table = [[0, 0], [1.0, 0.1], [3.0, 1.0]]
    motion = make(None, law=table)
    assert motion.duration == 3.0
    first = find().change[0] + 0 * motion.input[0]
    np.testing.assert_allclose(motion.input[0], first, atol=1e-12)
    assert make(6.0, law=table).peak_rate == pytest.approx(motion.peak_rate / 2)


def test_twice_the_shortest_duration_ends_at_the_plan_in_the_full_simulation() -> None:
    motion = make(2 * make(None).duration)
    end = motion.duration + 0.5
    run = simulate(
        compile_motion(PRISM), end, schedule=motion.profile(end), coordinate=motion.coordinate[0], samples=11
    )
    assert run.status == "ok", run.message
    assert np.abs(run.node_position[-1] - find().node_position[-1]).max() < 1e-4


def test_inputs_alone_are_followed_from_the_equilibrium_of_the_scene() -> None:
    found, model = find(), compile_motion(PRISM)
    motion = time_motion(model, EquilibriumPath(found.change[[0, -1]]), 3.0, feedforward="static")
    np.testing.assert_allclose(motion.coordinate[-1], found.coordinate[-1], atol=2e-3)  # up to rigid motions
    tension = motion.member_tension[-1]
    np.testing.assert_allclose(tension, found.member_tension[-1], atol=1e-4)
    middle = (found.change[0] + found.change[-1]) / 2
    np.testing.assert_allclose(motion.input[100], middle, atol=1e-12)


BAD: list[tuple[Any, type[Exception], str]] = [
    ([[0.0] * 12], InvalidValueError, "two points"),
    ([[0.0] * 11] * 2, InvalidValueError, "(n_points, 12)"),
    ([[0.0] * 12, [np.nan] * 12], NonFiniteError, "path.change"),
    ([[0.0] * 12, [0.0] * 12], InvalidValueError, "the same"),
    ([[0.0] * 12, [-0.25] * 12], ConvergenceError, "equilibrium"),
]


@pytest.mark.parametrize(("change", "error", "words"), BAD)
def test_wrong_inputs_of_a_path(change: Any, error: type[Exception], words: str) -> None:
    with pytest.raises(error) as caught:
        time_motion(compile_motion(PRISM), EquilibriumPath(change), 1.0)
    assert words in str(caught.value)


@pytest.mark.parametrize("progress", ["x", [0.0, 1.0], np.zeros(21), np.full(21, np.nan)])
def test_wrong_progress_of_a_path(progress: Any) -> None:
    found = find()
    with pytest.raises(InvalidValueError, match=r"path\.progress"):
        time_motion(compile_motion(PRISM), EquilibriumPath(found.change, found.coordinate, progress), 1.0)


@pytest.mark.parametrize("values", [[np.nan] * 12, [0.0] * 3])
def test_wrong_inputs_among_the_arguments(values: Any) -> None:
    with pytest.raises(InvalidValueError, match=r"arguments\.input"):
        time_motion(compile_motion(PRISM), find(), 1.0, arguments={"input": values})


def test_points_that_are_no_equilibria_are_refused() -> None:
    found = find()
    off = found.coordinate + 0.01 * np.sin(np.arange(18))
    with pytest.raises(InvalidValueError, match="point 0 of the path is no equilibrium"):
        time_motion(compile_motion(PRISM), EquilibriumPath(found.change, off), 1.0)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"duration": 0.0}, "duration"),
        ({"duration": float("nan")}, "duration"),
        ({"duration": "long"}, "duration"),
        ({"samples": 2}, "samples"),
        ({"path": "somewhere"}, "path"),
    ],
)
def test_wrong_options(more: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidValueError) as caught:
        time_motion(compile_motion(PRISM), **({"path": find(), "duration": 1.0} | more))
    assert caught.value.where == words


def test_unknown_actuators_and_scenes_without_any_are_refused() -> None:
    path = EquilibriumPath(find().change, actuators=("nobody",))
    with pytest.raises(UnknownNameError, match="nobody"):
        time_motion(compile_motion(PRISM), path, 1.0)
    bare = PRISM.with_changes(actuators=(), inputs=())
    with pytest.raises(StructureError, match="no actuators"):
        time_motion(compile_motion(bare), find(), 1.0)


def test_a_plan_that_ends_at_its_start_has_no_motion() -> None:
    stays = plan(compile_motion(PRISM), "twist=155")
    with pytest.raises(InvalidValueError, match="no motion"):
        time_motion(compile_motion(PRISM), stays, 1.0)


def test_without_rates_a_duration_is_needed() -> None:
    fast = build_prism(rate=float("inf"))
    model = compile_motion(fast)
    with pytest.raises(InvalidValueError, match="no rates"):
        time_motion(model, find())
    assert time_motion(model, find(), 0.01, samples=11).shortest_duration == 0.0


# Free structures: without outer forces their motions have no momentum, and turn as their shapes require.


def follow(model: Any, motion: Motion) -> float:
    """Return the largest difference of coordinates between the simulation and the motion."""
    run = simulate(
        model,
        motion.duration,
        schedule=motion.profile(),
        coordinate=motion.coordinate[0],
        samples=len(motion.time),
    )
    assert run.status == "ok", run.message
    return float(np.abs(run.coordinate - motion.coordinate).max())


@pytest.mark.thorough
def test_a_free_prism_of_unequal_masses_turns_as_it_must() -> None:
    prism = build_prism(rigid=True)
    structure = prism.with_changes(
        member_mass=np.where(prism.is_bar, 0.3, 0.0), node_mass=np.array([0.05, 0.1, 0.02, 0.03, 0.04, 0.2])
    )
    model, found = compile_motion(structure, "rigid_bar"), plan_prism(structure, "rigid_bar")
    motion = time_motion(model, found, 1.4, samples=101)
    assert motion.warnings == ()
    assert follow(model, motion) < 1e-9
    np.testing.assert_allclose(motion.coordinate[0], found.coordinate[0], atol=1e-12)
    assert np.abs(motion.coordinate[-1] - found.coordinate[-1]).max() > 1e-4  # turned as a whole
    np.testing.assert_allclose(_distances(motion.coordinate[-1]), _distances(found.coordinate[-1]), atol=1e-9)


@pytest.mark.thorough
def test_a_free_structure_that_goes_back_ends_where_it_began() -> None:
    structure = build_prism()
    model, found = compile_motion(structure), plan_prism(structure)
    motion = time_motion(model, found, 2.8, samples=201, there_and_back=True)
    np.testing.assert_allclose(motion.coordinate[-1], found.coordinate[0], atol=1e-11)
    assert np.abs(motion.coordinate[100] - motion.coordinate[0]).max() > 1e-3
    assert follow(model, motion) < 1e-5


def _distances(coordinate: np.ndarray) -> np.ndarray:
    place = coordinate.reshape(6, 3)
    return np.linalg.norm(place[:, None] - place, axis=2)


def build_kite() -> Structure:
    """Return a free square of four damped cables with two crossing bars, in the plane."""
    members = [cable(k, (k + 1) % 4, 0.9, 500.0, damping=5.0) for k in range(4)]
    members += [bar(0, 2, 1.45, 1e5, damping=50.0), bar(1, 3, 1.45, 1e5, damping=50.0)]
    corner = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    kite = make_structure(corner, members, axes="xy", mass=np.array([0.1, 0.2, 0.3, 0.5]))
    return actuate(kite, rate=0.1)


@pytest.mark.thorough
def test_a_free_kite_in_the_plane() -> None:
    structure = build_kite()
    model = compile_motion(structure)
    path = EquilibriumPath([[0.0] * 4, [-0.05, 0.02, -0.03, 0.04]])
    motion = time_motion(model, path, 1.0)
    assert motion.warnings == ()
    mass = np.repeat(structure.node_mass, 2)
    momentum = (motion.velocity * mass).reshape(-1, 4, 2).sum(axis=1)
    assert np.abs(momentum).max() < 1e-9
    assert follow(model, motion) < 1e-5


@pytest.fixture(scope="module")
def lift(tmp_path_factory: pytest.TempPathFactory) -> CompiledModel:
    path = tmp_path_factory.mktemp("lift") / "lift.toml"
    path.write_text(LIFT, encoding="utf-8")
    return compile_scene(path, for_=("simulate", "control"))


def test_a_recorded_motion_is_that_of_the_simulation(lift: CompiledModel) -> None:
    pull = Profile([0.0, 1.0, 6.0], {"winch": [0.0, -0.1, -0.1]})
    run = simulate(lift, 6.0, samples=301, schedule=pull)
    motion = record_motion(lift, run)
    for k in (0, 40, 300):
        point = motion.at(float(run.time[k]))
        np.testing.assert_allclose(point.coordinate, run.coordinate[k], atol=1e-12)
        np.testing.assert_allclose(point.velocity, run.velocity[k], atol=1e-10)
        assert point.input[0] == pytest.approx(pull(float(run.time[k]))["winch"])
    assert motion.peak_rate[0] == pytest.approx(0.1)
    # Half of the sample away the quintic through accelerations is the motion too.
    middle = simulate(lift, 6.0, samples=601, schedule=pull).coordinate[81]
    np.testing.assert_allclose(motion.at(0.81).coordinate, middle, atol=1e-6)


def test_wrong_runs_are_refused(lift: CompiledModel) -> None:
    run = simulate(lift, 1.0, samples=11)
    for wrong in ({"status": "unstable"}, {"time": run.time + 1.0}, {"input": None}):
        with pytest.raises(InvalidValueError, match="not a motion from 0 s to its end"):
            record_motion(lift, type(run)(**{**vars(run), **wrong}))


@pytest.mark.thorough
def test_a_roll_through_contacts_is_followed(tmp_path: Path) -> None:
    """Two rolls of the gait, with stiffnesses within 5 % and friction 0.3 to 0.6 where 0.5 is assumed."""
    gallery = ROOT / "docs" / "gallery"
    text = (gallery / "icosahedron_gait.toml").read_text(encoding="utf-8")
    text = text.replace('formulation = "rigid_bar"\n', "")
    text = text.replace('kind = "bar"\n', 'kind = "bar"\nspring_constant = 2e4\ndamping = 5\n')
    path = tmp_path / "icosahedron.toml"
    path.write_text(text, encoding="utf-8")
    model = compile_scene(path, for_=("simulate", "control"))
    inputs = read_profile(gallery / "icosahedron_gait.csv", model.manifest.input_name)
    rolled = simulate(model, 5.0, samples=1001, schedule=inputs)
    motion = record_motion(model, rolled)
    weight = np.concatenate([np.ones(36), np.full(36, 0.0025)])
    gains = design_lqr(model, motion, weight, np.full(24, 10.0), sample=SAMPLE)
    stiffness = model.nominal("spring_constant")
    means = []
    for item in (None, gains):
        ends = []
        for seed in range(4):
            rng = np.random.default_rng(seed)
            wrong = stiffness * rng.uniform(0.95, 1.05, len(stiffness))
            draw = Disturbance(arguments={"spring_constant": wrong, "ground": [rng.uniform(0.3, 0.6)]})
            run = simulate_control(model, motion, item, sample=SAMPLE, disturbance=draw, compare=False)
            assert run.status == "ok"
            assert "lifts" in run.warnings[0]  # the foot behind the edge
            ends.append(float(np.linalg.norm(run.error[-1].reshape(12, 3).mean(axis=0))))
        means.append(np.mean(ends))
    assert means[1] < 0.5 * means[0]  # of the centre of mass
    with pytest.raises(FormulationError, match="needs feet that stick where they stand"):
        design_mpc(model, motion, weight, np.full(24, 10.0), sample=SAMPLE)
    with pytest.raises(FormulationError, match="needs feet that stick where they stand"):
        design_kalman(model, motion, [Sensor("member_length", tuple(range(6, 30)), 1e-4)], sample=SAMPLE)
