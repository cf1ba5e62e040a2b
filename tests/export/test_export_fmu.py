"""Units of FMI 2.0 through a small importer: motions, events, derivatives, stored states, errors."""

import ctypes as c
import itertools
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.codegen.compilation.compile import compile_library
from tensegrity_codegen.codegen.compilation.flags import find_flags
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.export.export_fmu import export_fmu
from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tests.cases import thorough
from tests.cli.conftest import write_example
from tests.export.importer import Unit2
from tests.export.scenes import write_loose

T_END, N_STEPS, RTOL = 0.5, 50, 1e-8
N_STATES, N_MARGINS = 30, 9
Make = Callable[[str], Unit2]


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_loose(tmp_path_factory.mktemp("scene"))


@pytest.fixture(scope="module")
def unit(scene: Path) -> Path:
    out = scene.parent / "loose.fmu"
    export_fmu(scene, out)
    return out


@pytest.fixture(scope="module")
def ours(scene: Path) -> Trajectory:
    model = compile_scene(scene, for_="simulate")
    return simulate(model, T_END, samples=N_STEPS + 1, rtol=RTOL)


@pytest.fixture
def make(unit: Path, tmp_path: Path) -> Iterator[Make]:
    made: list[Unit2] = []

    def new(kind: str) -> Unit2:
        made.append(Unit2(unit, tmp_path / f"unit{len(made)}", kind))
        assert made[-1].instance.value, made[-1].messages
        return made[-1]

    yield new
    for item in made:
        item.free()
        assert item.held == {}


POSITION = [f"node_position.{node}.{axis}" for node, axis in itertools.product(["t1", "t2"], "xyz")]


def run_steps(unit: Unit2, times: np.ndarray) -> np.ndarray:
    """Return positions of t1 and t2 at the times, by communication steps."""
    rows = [unit.get(*POSITION)]
    for first, last in itertools.pairwise(times):
        assert unit.step(first, last - first) == 0, unit.messages
        rows.append(unit.get(*POSITION))
    return np.array(rows)


def positions(trajectory: Trajectory) -> np.ndarray:
    return trajectory.node_position[:, 3:5].reshape(len(trajectory.time), 6)


@pytest.mark.thorough
def test_communication_steps_follow_simulate(make: Make, ours: Trajectory) -> None:
    unit = make("cs")
    unit.start(RTOL)
    found = run_steps(unit, ours.time)
    assert np.abs(found - positions(ours)).max() < 20 * RTOL
    tension = unit.get(*(f"member_tension.{name}" for name in ("bar1", "vertical2")))
    index = [ours.member_name.index(name) for name in ("bar1", "vertical2")]
    assert np.abs(tension - ours.member_tension[-1, index]).max() < 20 * RTOL * 2e4
    assert unit.get("total_energy") == pytest.approx(ours.total_energy[-1], abs=1e-6)


def test_slack_events_are_seen_and_counted(make: Make, ours: Trajectory) -> None:
    assert ours.log.count >= 4
    unit = make("cs")
    unit.start(RTOL)
    run_steps(unit, ours.time)
    assert unit.count() == ours.log.count
    said = [text for status, text in unit.messages if status == 0]
    assert len(said) == ours.log.count
    for text, time, name, direction in zip(
        said, ours.log.time, ours.log.name, ours.log.direction, strict=True
    ):
        word = "goes taut" if direction > 0 else "goes slack"
        assert text.startswith(f"{name} {word} at t = ")
        assert float(text.split()[-2]) == pytest.approx(time, abs=1e-6)
    taut_at_end = ours.log.direction[ours.log.name.index("vertical2") :][-1] > 0
    assert unit.flag("is_slack.vertical2") == (not taut_at_end)


def test_model_exchange_follows_simulate_with_state_events(make: Make, ours: Trajectory) -> None:
    unit = make("me")
    unit.start(RTOL)
    times = unit.integrate(T_END, N_STATES, N_MARGINS, RTOL)
    assert np.abs(unit.get(*POSITION) - positions(ours)[-1]).max() < 1e3 * RTOL
    assert len(times) == ours.log.count == unit.count()
    assert np.abs(np.array(times) - ours.log.time).max() < 1e-5


def test_an_event_exactly_at_zero_changes_the_boolean(make: Make) -> None:
    unit = make("me")
    unit.start(RTOL)
    unit.good("EnterContinuousTimeMode")
    state = (c.c_double * N_STATES)()
    unit.good("GetContinuousStates", state, c.c_size_t(N_STATES))
    indicators = (c.c_double * N_MARGINS)()

    def find(scale: float) -> np.ndarray:
        moved = np.array(state)
        moved[:15] *= scale
        unit.put(0.0, moved)
        unit.good("GetEventIndicators", indicators, c.c_size_t(N_MARGINS))
        return np.array(indicators)

    assert (find(1.0) > 0).all(), "all cables pull"
    low, high = 0.5, 1.0  # somewhere between them the first cable goes slack
    while high - low > 1e-16:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        low, high = (middle, high) if find(middle).min() <= 0 else (low, middle)
    which = int(find(low).argmin())
    name = [key for key in unit.reference if key is not None and key.startswith("is_slack.")][which]
    unit.enter_events()
    assert unit.flag(name) == 1
    assert find(low)[which] < 0, "the next event has a sign to start from"
    count = unit.count()
    find(1.0)
    unit.enter_events()
    assert unit.flag(name) == 0
    assert unit.count() > count


def test_values_that_a_scene_refuses_are_refused(make: Make) -> None:
    unit = make("cs")
    for name, value in (
        ("rest_length.vertical3", -1.0),
        ("rest_length.vertical3", 0.0),
        ("damping.bottom1", -0.1),
    ):
        assert unit.set_all({name: value}) == 3, name
        assert "above zero" in unit.messages[-1][1] or "negative" in unit.messages[-1][1]
        assert unit.get(name)[0] > 0
    least = {
        item.get("name"): item[0].get("min") for item in unit.description.iter("ScalarVariable") if len(item)
    }
    assert least["rest_length.vertical3"] == least["damping.bottom1"] == "0.0"
    assert least["gravity.z"] is None
    assert unit.set_all({"gravity.z": -5.0, "damping.bottom1": 0.0}) == 0


def test_a_margin_that_is_requested_is_an_output(tmp_path: Path) -> None:
    out = tmp_path / "margins.fmu"
    export_fmu(write_example(tmp_path, "two_nodes"), out, outputs=["cable_margin", "total_energy"])
    unit = Unit2(out, tmp_path / "unit", "cs")
    unit.start()
    causality = {item.get("name"): item.get("causality") for item in unit.description.iter("ScalarVariable")}
    assert causality["cable_margin.member1"] == "output"
    assert np.isfinite(unit.get("cable_margin.member1", "total_energy")).all()
    unit.free()


def test_inputs_and_parameters_act_as_in_simulate(make: Make, scene: Path) -> None:
    unit = make("cs")
    assert unit.set_all({"gravity.z": -5.0, "rest_length.vertical3": 0.2, "node_load.t1.x": 1.0}) == 0
    assert unit.set_all({"damping.bottom1": 0.7, "input.push": 0.5}) == 0
    unit.start(RTOL)
    times = np.linspace(0.0, 0.2, 21)
    rows = run_steps(unit, times[:11])
    assert unit.set_all({"input.winch": -0.01}) == 0
    rows = np.vstack([rows, run_steps(unit, times[10:])[1:]])
    model = compile_scene(scene, for_="simulate")
    rest = model.nominal("rest_length")
    rest[2] = 0.2
    trajectory = simulate(
        model,
        0.2,
        samples=21,
        rtol=RTOL,
        arguments={
            "gravity": [0.0, 0.0, -5.0],
            "rest_length": rest,
            "node_load": [[1.0, 0.0, -1.0]],
            "damping": [0.7],
            "push": 0.5,
        },
        schedule=Profile([0.0, 0.1, 0.1, 0.2], {"winch": [0.0, 0.0, -0.01, -0.01]}),
    )
    assert np.abs(rows - positions(trajectory)).max() < 50 * RTOL


def test_the_initial_state_can_be_set(make: Make, scene: Path) -> None:
    unit = make("cs")
    assert unit.set_all({"coordinate.t1_x": 0.15, "velocity.t2_z": 0.3}) == 0
    unit.start(RTOL)
    model = compile_scene(scene, for_="simulate")
    q, v = model.nominal("coordinate"), model.nominal("velocity")
    names = model.manifest.coordinate_name
    q[names.index("t1_x")], v[names.index("t2_z")] = 0.15, 0.3
    trajectory = simulate(model, 0.1, samples=6, rtol=RTOL, coordinate=q, velocity=v)
    assert np.abs(run_steps(unit, trajectory.time) - positions(trajectory)).max() < 50 * RTOL
    assert unit.set_all({"coordinate.t1_x": 0.1}) == 3  # too late


def test_tolerance_decides_the_error(make: Make, ours: Trajectory) -> None:
    errors = []
    for rtol in (1e-3, 1e-6):
        unit = make("cs")
        unit.start(rtol)
        errors.append(np.abs(run_steps(unit, ours.time) - positions(ours)).max())
    assert errors[1] < 0.1 * errors[0]
    assert errors[1] < 1e-5


def test_derivatives_are_those_of_differences(make: Make) -> None:
    unit = make("me")
    unit.start()
    knowns = ["coordinate.t1_x", "coordinate.b2_y", "velocity.t3_z", "input.winch", "rest_length.vertical2"]
    unknowns = [name for name in unit.reference if name.startswith(("der(", "member_tension.", "node_pos"))]
    unknowns += ["total_energy"]
    seed = np.array([0.3, -0.7, 0.4, 0.2, 0.5])
    found = unit.derivative(unknowns, knowns, seed)
    start = unit.get(*knowns)
    other = make("me")
    step = 1e-6
    values = []
    for sign in (1.0, -1.0):
        other.good("Reset")
        assert other.set_all(dict(zip(knowns, start + sign * step * seed, strict=True))) == 0
        other.start()
        values.append(other.get(*unknowns))
    differences = (values[0] - values[1]) / (2.0 * step)
    assert np.abs(found).max() > 1.0
    assert np.abs(found - differences).max() < 1e-5 * np.abs(found).max()


def test_a_stored_state_continues_bit_by_bit(make: Make, ours: Trajectory) -> None:
    unit = make("cs")
    unit.start()
    run_steps(unit, ours.time[:20])
    state = unit.store()
    size = c.c_size_t()
    unit.good("SerializedFMUstateSize", state, c.byref(size))
    data = c.create_string_buffer(size.value)
    unit.good("SerializeFMUstate", state, data, size)
    first = run_steps(unit, ours.time[19:])
    unit.good("SetFMUstate", state)
    assert (run_steps(unit, ours.time[19:]) == first).all()
    other = make("cs")
    other.start()
    again = c.c_void_p()
    other.good("DeSerializeFMUstate", data, size, c.byref(again))
    other.good("SetFMUstate", again)
    assert (run_steps(other, ours.time[19:]) == first).all()
    assert other.count() == unit.count()
    data[0] = b"x"
    assert other.call("DeSerializeFMUstate", data, size, c.byref(again)) == 3
    assert "no state of this unit" in other.messages[-1][1]
    unit.good("FreeFMUstate", c.byref(state))
    other.good("FreeFMUstate", c.byref(again))


def test_reset_goes_back_to_the_start(make: Make, ours: Trajectory) -> None:
    unit = make("cs")
    unit.set_all({"gravity.z": -3.0})
    unit.start()
    run_steps(unit, ours.time[:5])
    unit.good("Reset")
    assert unit.get("gravity.z") == -9.81
    unit.start()
    fresh = make("cs")
    fresh.start()
    assert (run_steps(unit, ours.time) == run_steps(fresh, ours.time)).all()


def test_short_steps_of_any_length_give_the_same_motion(make: Make, scene: Path) -> None:
    """Steps far shorter than those of the integrator, which goes ahead of regular ones only."""
    model = compile_scene(scene, for_="simulate")
    regular = np.linspace(0.0, 0.1, 1001)
    irregular = np.unique(
        np.concatenate([regular[::7], np.random.default_rng(1).uniform(0.0, 0.1, 300), [0.1]])
    )
    ours = simulate(model, 0.1, samples=1001, rtol=RTOL)
    for times in (regular, irregular):
        unit = make("cs")
        unit.start(RTOL)
        found = run_steps(unit, times)
        expected = np.array([np.interp(times, ours.time, column) for column in positions(ours).T]).T
        # Straight lines between samples 1e-4 s apart are off by about 1e-4^2 / 8 of the acceleration.
        allowed = 20 * RTOL if times is regular else 1e-6
        assert np.abs(found - expected).max() < allowed
        assert np.abs(found[-1] - positions(ours)[-1]).max() < 20 * RTOL
        assert unit.count() == ours.log.count


def test_events_ahead_count_when_their_time_has_come(make: Make, scene: Path) -> None:
    model = compile_scene(scene, for_="simulate")
    log = simulate(model, 0.2, samples=3, rtol=RTOL).log
    unit = make("cs")
    unit.start(RTOL)
    times = np.arange(0.0, 0.2, 2e-4)
    for first, last in itertools.pairwise(times):
        assert unit.step(first, last - first) == 0
        if np.abs(log.time - last).min() > 1e-6:
            assert unit.count() == np.count_nonzero(log.time <= last)


def test_an_input_acts_at_once_though_the_integrator_is_ahead(make: Make, scene: Path) -> None:
    model = compile_scene(scene, for_="simulate")
    unit = make("cs")
    unit.start(RTOL)
    times = np.linspace(0.0, 0.04, 401)
    rows = run_steps(unit, times[:203])
    state = unit.store()
    assert unit.set_all({"input.winch": -0.005}) == 0
    rows = np.vstack([rows, run_steps(unit, times[202:])[1:]])
    kink = times[202]
    profile = Profile([0.0, kink, kink, 0.04], {"winch": [0.0, 0.0, -0.005, -0.005]})
    ours = simulate(model, 0.04, samples=401, rtol=RTOL, schedule=profile)
    assert np.abs(rows - positions(ours)).max() < 20 * RTOL
    unit.good("SetFMUstate", state)
    assert unit.get("input.winch") == 0.0
    plain = simulate(model, 0.04, samples=401, rtol=RTOL)
    assert np.abs(run_steps(unit, times[202:]) - positions(plain)[202:]).max() < 20 * RTOL
    unit.good("FreeFMUstate", c.byref(state))


def test_several_instances_do_not_mix(make: Make, ours: Trajectory) -> None:
    one, two, alone = make("cs"), make("cs"), make("cs")
    for unit in (one, two, alone):
        unit.start()
    assert two.set_all({"input.push": 2.0}) == 0
    for first, last in itertools.pairwise(ours.time):
        for unit in (one, two):
            assert unit.step(first, last - first) == 0
    run_steps(alone, ours.time)
    assert (one.get(*POSITION) == alone.get(*POSITION)).all()
    assert (two.get(*POSITION) != one.get(*POSITION)).any()


def test_wrong_calls_are_refused_with_a_message(make: Make, unit: Path, tmp_path: Path) -> None:
    one = make("cs")
    assert one.step(0.0, 0.1) == 3
    assert "not allowed in this mode" in one.messages[-1][1]
    assert one.set_all({"gravity.z": float("nan")}) == 3
    assert "not finite" in one.messages[-1][1]
    assert one.set_all({"member_tension.bar1": 1.0}) == 3
    one.start()
    assert one.step(0.3, 0.1) == 3
    assert "communication point" in one.messages[-1][1]
    assert one.step(0.0, -0.1) == 3
    assert one.call("GetReal", (c.c_uint * 1)(99_999), c.c_size_t(1), (c.c_double * 1)()) == 3
    assert one.call("SetString", (c.c_uint * 1)(1), c.c_size_t(1), (c.c_char_p * 1)(b"x")) == 3
    assert one.step(0.0, 0.1) == 0  # none of this has harmed it
    stranger = Unit2(unit, tmp_path / "stranger", "cs", token="{0}")
    assert not stranger.instance.value
    assert "GUID" in stranger.messages[-1][1]


def test_a_step_that_cannot_be_taken_says_how_far_it_came(make: Make) -> None:
    unit = make("cs")
    unit.set_all({"rest_length.vertical1": 1e200})
    unit.set_all({"input.push": 1e300})
    unit.start()
    assert unit.step(0.0, 1.0) in (2, 3)
    reached = c.c_double()
    unit.good("GetRealStatus", 2, c.byref(reached))
    assert 0.0 <= reached.value < 1.0
    assert "t = " in unit.messages[-1][1]


@pytest.mark.parametrize(("fmi", "is_small"), [("3.0", True), *thorough(("2.0", False), ("3.0", False))])
def test_the_sources_compile_without_a_warning(fmi: str, is_small: bool, scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "unit.fmu"
    export_fmu(write_example(tmp_path, "two_nodes") if is_small else scene, out, fmi=fmi, sources_only=True)
    with zipfile.ZipFile(out) as archive:
        sources = {
            name.removeprefix("sources/"): archive.read(name).decode("utf-8")
            for name in archive.namelist()
            if name.endswith((".c", ".h"))
        }
    compiled = compile_library(sources, name="loose", compiler=find_compiler(), flags=find_flags("reference"))
    assert compiled.log == ""
    text = "\n".join(sources.values())
    assert "Modelica Association" not in text  # no header of the standard
    assert all(len(line) <= 120 for line in text.splitlines())
