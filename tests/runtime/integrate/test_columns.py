"""Derivatives of motions, integrated beside them through contacts, friction and cables pulled taut.

S' = J S + df/dp, nothing at kinks; where the force jumps at an event with the margin g,
S+ = S + (f+ - f-) dg / g' (Aizerman and Gantmacher 1958). Numbers without a closed form are differences of
motions found by another program at tolerances of 1e-11.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError, UnknownNameError
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.codegen.plain_c.alone import compile_alone, options_for
from tests.ground_cases import GRAVITY, make_belt, make_prism, make_rod, make_slope
from tests.models import simulator
from tests.runtime.build import cable, make_structure, spring
from tests.runtime.integrate.test_ground import rotate

STEPS = Stepping(control="steps")


def fall(damping: float = 2.0) -> Structure:
    """1 kg that falls 0.5 m onto a cable of 100 N/m and 1 m, whose force jumps as it is pulled taut."""
    return make_structure(
        [[0, 0, 0], [0, 0, -0.5]],
        [cable(0, 1, 1.0, 100.0, damping=damping)],
        anchored={0: "xyz", 1: "xy"},
        gravity=(0, 0, -GRAVITY),
        mass=1.0,
    )


@pytest.mark.parametrize("method", ["rk54", "rk853", "tsit5"])
def test_a_free_vibration_has_derivatives_in_closed_form(method: str) -> None:
    """x = x0 cos(w t) + v0 / w sin(w t), w^2 = k / m."""
    swing = make_structure(
        [[0, 0, 0], [1.2, 0, 0]],
        [spring(0, 1, 1.0, 40.0)],
        anchored={0: "xyz", 1: "yz"},
        axes="xyz",
        mass=1.0,
    )
    wanted = ("coordinate", "velocity", "rest_length", "spring_constant")
    parameters = {"rest_length": (0,), "spring_constant": (0,)}
    model = simulator(swing, "rk54", "rk853", "tsit5", parameters=parameters, columns=wanted)
    t = 0.7
    motion = simulate(model, t, method=method, rtol=1e-11, stepping=STEPS)
    assert motion.columns is not None
    w, x0 = np.sqrt(40.0), 0.2
    c, s = np.cos(w * t), np.sin(w * t)
    by_w = np.array([-x0 * t * s, -x0 * (s + w * t * c)])
    expected = {
        "coordinate.n1_x": [c, -w * s],
        "velocity.n1_x": [s / w, c],
        "rest_length.e0": [1.0 - c, w * s],
        "spring_constant.e0": by_w / (2.0 * w),
    }
    assert motion.column_name == tuple(expected)
    table = np.transpose(list(expected.values()))
    np.testing.assert_allclose(motion.columns[-1], table, rtol=1e-8, atol=1e-10)
    np.testing.assert_array_equal(motion.columns[0, :, :2], np.eye(2))


def test_forces_that_jump_move_the_time_of_the_event() -> None:
    wanted = ("rest_length", "spring_constant", "damping")
    model = simulator(fall(), "rk853", parameters=dict.fromkeys(wanted, (0,)), columns=wanted)
    motion = simulate(model, 3.0, method="rk853", rtol=1e-11, stepping=STEPS)
    assert motion.columns is not None
    np.testing.assert_allclose(-motion.coordinate[-1, 0], 1.080111479106, rtol=1e-11)
    expected = [0.72649611, 0.00135538, 0.06985699]
    np.testing.assert_allclose(-motion.columns[-1, 0], expected, rtol=0, atol=6e-9)


def test_a_rod_that_slips_and_bounces_has_the_derivatives_of_its_ground() -> None:
    rod = make_rod()
    assert rod.ground is not None
    rod = rod.with_changes(ground=replace(rod.ground, dissipation=0.35))
    parameters = {"ground": (0, 1, 2, 3)}
    model = simulator(rod, "rk853", formulation="rigid_bar", parameters=parameters, columns=("ground",))
    motion = simulate(model, 0.45, method="rk853", rtol=1e-12, stepping=STEPS)
    assert motion.columns is not None
    names = ["ground.stiffness", "ground.friction", "ground.dissipation", "ground.stick_stiffness"]
    chosen = [motion.column_name.index(name) for name in names]
    ends = motion.node_position[-1][:, ::2]
    by = (motion.columns[-1] * model.nominal("ground"))[:4, chosen].reshape(2, 2, 4)
    span, turn = ends[1] - ends[0], by[1] - by[0]
    np.testing.assert_allclose(
        by.mean(axis=0),
        [
            [-0.006422417, 0.0325117061, -0.0072163017, 0.0016391379],
            [0.0020764766, -0.0045470602, -0.0806377153, 0.0003543712],
        ],
        atol=2e-9,
    )
    angle = (span[0] * turn[1] - span[1] * turn[0]) / (span @ span)
    np.testing.assert_allclose(angle, [-0.0152738830, -0.0004291687, -0.1124358328, 0.0070538042], atol=2e-9)


def differ(model: CompiledModel, name: str, place: int, step: float, **given: Any) -> Any:
    """Central differences of the state at the end to one number, exact to fourth order."""
    nominal = model.nominal(name)

    def end(change: float) -> Any:
        changed = nominal.copy()
        changed.reshape(-1)[place] += change
        motion = simulate(model, arguments={name: changed}, **given)
        return np.concatenate([motion.coordinate[-1], motion.velocity[-1]])

    near, far = end(step) - end(-step), end(2.0 * step) - end(-2.0 * step)
    return (8.0 * near - far) / (12.0 * step)


@pytest.mark.parametrize("name", ["rest_length", *thorough("ground", "damping", "gravity", "node_mass")])
def test_a_prism_dropped_on_the_ground_has_the_derivatives_that_differences_have(name: str) -> None:
    prism = make_prism(rotate((0.0, 0.3, 0.2)))
    cables = tuple(int(e) for e in np.flatnonzero(prism.tension_only))
    places = {"ground": (0, 1, 2, 3, 4), "gravity": (), "node_mass": (0, 3)}.get(name, cables[:3])
    model = simulator(prism, "rk853", formulation="rigid_bar", parameters={name: places}, columns=(name,))
    given: dict[str, Any] = {"t_end": 0.6, "samples": [0.0, 0.6], "method": "rk853", "stepping": STEPS}
    motion = simulate(model, rtol=1e-10, **given)
    assert motion.log.count >= 30
    assert motion.columns is not None
    place = 2  # friction, a third cable, the vertical
    place = min(place, motion.columns.shape[2] - 1)
    step = 1e-4 * (abs(model.nominal(name).reshape(-1)[place]) or 1.0)
    expected = differ(model, name, place, step, rtol=1e-12, **given)
    found = motion.columns[-1, : len(expected), place]
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


def test_columns_change_no_motion_and_tell_their_error() -> None:
    prism = make_prism(rotate((0.0, 0.3, 0.2)))
    parameters = {"ground": (0, 2)}
    plain, wide = (
        simulator(prism, "rk853", formulation="rigid_bar", parameters=parameters, columns=columns)
        for columns in ((), ("ground",))
    )
    (first, second) = (simulate(model, 0.5, method="rk853", rtol=1e-7) for model in (plain, wide))
    exact = simulate(wide, 0.5, method="rk853", rtol=1e-12, stepping=STEPS)
    assert first.columns is None
    assert np.abs(first.node_position - second.node_position).max() < 1e-7
    assert second.columns is not None
    assert exact.columns is not None
    size = np.abs(exact.columns).max(axis=(0, 1))
    error = (np.abs(second.columns - exact.columns).max(axis=(0, 1)) / size).max()
    assert error <= second.evidence["column_error"] < 1e-3


def test_profiles_are_differentiated_along() -> None:
    from tensegrity_codegen.runtime.profiles.profile import Profile
    from tensegrity_codegen.structure.structure import ActuatedInput

    winch = ActuatedInput("winch", "rest_length", (0,))
    driven = fall(0.0).with_changes(inputs=(winch,))
    model = simulator(driven, "rk853", parameters={"spring_constant": (0,)}, columns=("spring_constant",))
    given: dict[str, Any] = {
        "t_end": 1.5,
        "samples": [0.0, 1.5],
        "method": "rk853",
        "stepping": STEPS,
        "schedule": Profile(np.array([0.0, 0.5, 1.5]), {"winch": np.array([0.0, -0.1, 0.05])}),
    }
    motion = simulate(model, rtol=1e-11, **given)
    assert motion.columns is not None
    expected = differ(model, "spring_constant", 0, 1e-2, rtol=1e-12, **given)
    np.testing.assert_allclose(motion.columns[-1, :, 0], expected, rtol=1e-7)


@pytest.mark.parametrize("parameter", ["spring_constant", "rest_length"])
def test_a_cable_that_is_wound_in_while_it_is_pulled_taut(parameter: str) -> None:
    """The time of the event depends on how fast the margin closes, the winch included."""
    from tensegrity_codegen.runtime.profiles.profile import Profile
    from tensegrity_codegen.structure.structure import ActuatedInput

    winch = ActuatedInput("winch", "rest_length", (0,))
    driven = fall(2.0).with_changes(inputs=(winch,))
    names = ("spring_constant", "rest_length")
    columns = ("input", *names)
    model = simulator(driven, "rk853", parameters=dict.fromkeys(names, (0,)), columns=columns)
    given: dict[str, Any] = {
        "t_end": 1.5,
        "samples": [0.0, 1.5],
        "method": "rk853",
        "stepping": STEPS,
        "schedule": Profile(np.array([0.0, 0.5, 1.5]), {"winch": np.array([0.0, -0.2, 0.05])}),
    }
    motion = simulate(model, rtol=1e-11, **given)
    assert motion.columns is not None
    step = 1e-4 * float(model.nominal(parameter)[0])
    expected = differ(model, parameter, 0, step, rtol=1e-12, **given)
    column = motion.column_name.index(f"{parameter}.e0")
    np.testing.assert_allclose(motion.columns[-1, :, column], expected, rtol=2e-6)


def test_inputs_shift_what_rest_lengths_do() -> None:
    from tensegrity_codegen.structure.structure import ActuatedInput

    winch = ActuatedInput("winch", "rest_length", (0,))
    driven = fall(2.0).with_changes(inputs=(winch,))
    columns = ("input", "rest_length")
    model = simulator(driven, "rk853", parameters={"rest_length": (0,)}, columns=columns)
    motion = simulate(model, 1.5, samples=[0.0, 1.5], method="rk853", rtol=1e-11, stepping=STEPS)
    assert motion.columns is not None
    assert motion.column_name == ("input.winch", "rest_length.e0")
    np.testing.assert_allclose(motion.columns[-1, :, 0], motion.columns[-1, :, 1], rtol=1e-9)
    assert np.abs(motion.columns[-1]).min() > 0.1


@pytest.mark.parametrize("count", [1, 5, *thorough(2, 3, 9)])
def test_directions_are_sums_of_columns(count: int) -> None:
    """Of any number, in blocks of any width: along random changes of the ground and of the start."""
    slope, _ = make_slope(0.6)
    start = slope.with_changes(node_position=slope.node_position + np.array([0.0, 0.0, 0.1]))
    parameters = {"ground": (0, 1, 2, 3, 4)}
    each = simulator(start, "rk853", parameters=parameters, columns=("coordinate", "velocity", "ground"))
    names = tuple(f"way{k}" for k in range(count))
    along = simulator(start, "rk853", parameters=parameters, directions=names)
    draw = np.random.default_rng(count)
    begin, change = draw.normal(size=(8, count)), draw.normal(size=(5, count))
    begin[6:] = 0.0
    change *= each.nominal("ground")[:, None]
    given: dict[str, Any] = {"t_end": 0.3, "samples": [0.0, 0.3], "method": "rk853", "stepping": STEPS}
    apart = simulate(each, rtol=1e-11, **given)
    motion = simulate(along, rtol=1e-11, arguments={"column": begin, "direction": change}, **given)
    assert motion.column_name == names
    assert apart.columns is not None
    assert motion.columns is not None
    expected = apart.columns[-1] @ np.vstack([begin[:6], change])
    np.testing.assert_allclose(motion.columns[-1], expected, rtol=1e-7, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_array_equal(motion.columns[0], begin)


@pytest.mark.parametrize(
    "wanted",
    [
        {"interfaces": ("casadi",)},
        {"directions": ("one",)},
        {"integrators": ("rk4",)},
        {"integrators": ("rodas",)},
        {"integrators": ("radau",)},
        {"emitter": "table"},
        {"batch_width": 8},
        {"keep": ("energy",)},
        {"precision": "single"},
        {"formulation": "node_distance"},
    ],
    ids=str,
)
def test_what_is_not_differentiated_is_refused(wanted: dict[str, Any]) -> None:
    request = {"integrators": ("rk54",), "parameters": {"rest_length": (0,)}, "columns": ("rest_length",)}
    with pytest.raises(FormulationError, match=r"differentiate|columns"):
        build_library(fall(), ModelRequest(("acceleration",), **{**request, **wanted}))


def test_only_what_can_change_is_differentiated_to() -> None:
    with pytest.raises(UnknownNameError, match="number to differentiate to"):
        build_library(fall(), ModelRequest(("acceleration",), integrators=("rk54",), columns=("damping",)))
    slope, _ = make_slope(0.3, static_friction=0.7)
    request = ModelRequest(("acceleration",), integrators=("rk54",), columns=("coordinate",))
    with pytest.raises(FormulationError, match="static_friction"):
        build_library(slope, request)
    rigid = replace(request, formulation="rigid_bar")
    with pytest.raises(UnknownNameError, match="coordinate"):
        build_library(make_rod(), rigid)


def test_a_belt_has_derivatives_to_its_friction_while_it_slips() -> None:
    """x = (mu N / k) (1 - cos(w t)) while a fast belt pulls with constant friction."""
    belt = make_belt(3.0)
    model = simulator(belt, "rk853", parameters={"ground": (2,)}, columns=("ground",))
    motion = simulate(model, 0.1, method="rk853", rtol=1e-11, stepping=STEPS)
    assert motion.columns is not None
    rise = motion.node_position[-1, 0, 0] - motion.node_position[0, 0, 0]
    assert motion.columns[-1, 0, 0] == pytest.approx(rise / 0.4, rel=2e-3)  # all but the first microseconds


def test_the_c_files_compile_alone_with_columns(tmp_path: Path) -> None:
    options = (*options_for(15, False), "-DWITH_COLUMNS=1", "-DWITH_INTERNAL=1")
    for language in ("c", "c++"):
        compile_alone(["explicit.h"], "gcc" if language == "c" else "g++", language, options, tmp_path)


def test_parameters_that_nothing_depends_on_leave_the_columns_in_place() -> None:
    """The mass of an anchored node is in no function of the library, and stands before loads."""
    swing = make_structure(
        [[0, 0, 0], [1.2, 0, 0]], [spring(0, 1, 1.0, 40.0)], anchored={0: "xyz", 1: "yz"}, mass=1.0
    )
    parameters = {"node_mass": (0,), "node_load": (1,)}
    model = simulator(swing, "rk853", parameters=parameters, columns=("node_load", "node_mass"))
    motion = simulate(model, 0.7, method="rk853", rtol=1e-10, stepping=STEPS)
    assert motion.columns is not None
    expected = dict.fromkeys(("node_mass.n0", "node_load.n1_x", "node_load.n1_y", "node_load.n1_z"), 0.0)
    expected["node_load.n1_x"] = (1.0 - np.cos(np.sqrt(40.0) * 0.7)) / 40.0
    assert dict(zip(motion.column_name, motion.columns[-1, 0], strict=True)) == pytest.approx(expected)


@pytest.mark.parametrize("events", [(), ("condition",)])
@pytest.mark.parametrize("parameter", ["rest_length", "damping"])
def test_jumps_that_no_event_finds_are_refused(events: tuple[str, ...], parameter: str) -> None:
    structure = fall(0.0 if parameter == "damping" else 2.0)
    request = ModelRequest(
        ("acceleration",),
        integrators=("rk54",),
        parameters={parameter: (0,)},
        columns=(parameter,),
        events=events,
    )
    with pytest.raises(FormulationError, match="damped cables become taut"):
        build_library(structure, request)
