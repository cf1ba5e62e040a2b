"""The method auto: what it takes, why, and that its error holds from soft bars to nearly rigid ones."""

import functools
from collections.abc import Callable

import numpy as np
import pytest

from tensegrity_codegen.runtime.accuracy.choice import choose_method, integrators_for
from tensegrity_codegen.runtime.integrate.event_log import Watch
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions, Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import Until, simulate
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError
from tests.cases import thorough
from tests.models import simulator, start_of
from tests.runtime.build import bar, cable, make_structure, prism, spring
from tests.runtime.stiff_bars import class_two, move_rigidly, pendulums, prism_of_ratio

SPAN, RTOL, ATOL = 0.3, 1e-6, 1e-9


@functools.cache
def model_of(make: Callable[[float], Structure]) -> CompiledModel:
    """One library for all stiffnesses of the bars."""
    structure = make(1e4)
    bars = tuple(np.flatnonzero(structure.is_bar).tolist())
    return simulator(structure, "rk853", "radau", parameters={"spring_constant": bars, "damping": bars})


def run(
    make: Callable[[float], Structure],
    ratio: float,
    method: str = "auto",
    rtol: float = RTOL,
    control: str = "samples",
    **more: float,
) -> Trajectory:
    model, structure = model_of(make), make(ratio)
    known = {item.name for item in model.manifest.arguments}
    bars = structure.is_bar
    values = {"spring_constant": structure.spring_constant[bars], "damping": structure.damping[bars]}
    given = {name: value for name, value in values.items() if name in known}
    span, atol = more.get("span", SPAN), more.get("atol", 1e-3 * rtol)
    stepping = Stepping(atol=atol, max_steps=10**7, control=control)
    return simulate(model, span, samples=31, method=method, rtol=rtol, arguments=given, stepping=stepping)


def run_exactly(make: Callable[[float], Structure], ratio: float, rtol: float = 1e-13) -> Trajectory:
    """The same by steps so tight that rounding is next; rtol: larger where stiffness rounds more."""
    found = run(make, ratio, "rk853", rtol, control="steps")
    assert found.status == "ok"
    return found


def worst(found: Trajectory, exact: Trajectory) -> tuple[float, float]:
    """Errors of positions and velocities over the tolerance, node by node."""
    pairs = ((found.node_position, exact.node_position), (found.node_velocity, exact.node_velocity))
    norm = functools.partial(np.linalg.norm, axis=2)
    shares = [norm(a - b) / (ATOL + RTOL * norm(b)) for a, b in pairs]
    return float(shares[0].max()), float(shares[1].max())


@pytest.mark.thorough
@pytest.mark.parametrize("make", [class_two, pendulums, *thorough(prism_of_ratio)])
@pytest.mark.parametrize("ratio", [1e1, 1e3, 1e5])
def test_vibrations_that_few_steps_resolve_are_resolved(
    make: Callable[[float], Structure], ratio: float
) -> None:
    found = run(make, ratio)
    exact = run_exactly(make, ratio)
    assert found.status == "ok"
    assert found.method.startswith("auto (rk853")
    assert max(worst(found, exact)) <= found.error_estimate <= 1.0


@pytest.mark.thorough
def test_bars_that_vibrate_alone_are_right_in_positions_velocities_and_tensions() -> None:
    found, exact = run(prism_of_ratio, 1e7), run(prism_of_ratio, 1e7, "rk853", 1e-11)
    assert found.status == "ok"
    assert found.method.startswith("auto (radau")
    assert "steps of radau" in found.why_method
    assert found.n_steps < 3000
    assert found.error_estimate <= 1.0
    assert worst(found, exact)[0] <= 1.0
    off, speed = found.evidence["vibration_speed_error"], np.sqrt(2e9) * 7.8e-8
    assert np.abs(found.velocity - exact.velocity).max() <= off + 1e-6 < 0.03 * speed
    tension = np.abs(found.member_tension - exact.member_tension).max()
    assert tension < 0.02 * np.abs(exact.member_tension).max()


def test_nearly_rigid_bars_move_as_rigid_ones() -> None:
    found = run(prism_of_ratio, 1e12)
    assert (found.status, found.method[:11]) == ("ok", "auto (radau")
    exact, _ = move_rigidly(prism_of_ratio(1e12), found.time)
    assert np.max(np.abs(found.coordinate - exact) / (ATOL + RTOL * np.abs(exact))) <= 1.0


def test_velocities_that_nothing_resolves_are_told() -> None:
    """Bars that share nodes exchange their vibrations, here within the tolerance of positions."""
    found = run(class_two, 1e9)
    assert (found.status, found.method[:11]) == ("ok", "auto (radau")
    assert "bar velocities may be wrong by up to" in found.message
    exact, _ = move_rigidly(class_two(1e9), found.time)
    assert np.abs(found.coordinate - exact).max() < 1e-7
    speed = found.evidence["vibration_speed_error"]
    assert speed > 1e-5


def test_damping_of_bars_sets_no_step() -> None:
    found = run(pendulums, 1e9)
    assert (found.status, found.method[:11]) == ("ok", "auto (radau")
    exact, _ = move_rigidly(pendulums(1e9), found.time)
    assert np.max(np.abs(found.coordinate - exact) / (ATOL + RTOL * np.abs(exact))) <= 10.0


def test_where_radau_misses_the_tolerance_the_explicit_method_has_its_turn() -> None:
    found = run(class_two, 5e6, span=0.1, rtol=1e-7)
    assert found.status == "ok"
    assert found.method.startswith("auto (rk853")
    assert found.error_estimate <= 1.0


@pytest.mark.parametrize(("ratio", "words"), [(1.0, "cables limit the steps, not bars"), (250.0, "explicit")])
def test_the_reason_names_what_limits_explicit_steps(ratio: float, words: str) -> None:
    """Bars 250 times as stiff as cables limit explicit steps, though radau, which cables limit, is slower."""
    model, structure = model_of(prism_of_ratio), prism_of_ratio(ratio)
    given = {"spring_constant": structure.spring_constant[structure.is_bar]}
    motion = Motion(model, start_of(model), np.array([0.0, 500.0]), given)
    found = choose_method(motion, RunOptions(rtol=1e-9))
    assert found.name == "rk853"
    assert words in found.why
    assert ("not bars" in found.why) == (ratio == 1.0)
    assert ("250 times stiffer than cables: estimated" in found.why) == (ratio == 250.0)


def test_events_are_for_explicit_methods() -> None:
    model = model_of(prism_of_ratio)
    given = {"spring_constant": np.full(3, 1e11)}
    watched = simulate(
        model, 1e-3, until=Until(condition="time - 5e-4", stops=False), arguments=given, rtol=1e-4
    )
    assert watched.method.startswith("auto (rk853")
    assert watched.log.kind == ("condition",)
    assert Watch().kinds == ()


def test_what_a_library_shall_hold_follows_from_stiffness_damping_and_tolerance() -> None:
    soft, stiff = prism(bar_stiffness=5e3), prism(bar_stiffness=1e6)
    assert integrators_for("auto", soft, "node_position", 1e-6) == ("rk853",)
    assert integrators_for("auto", stiff, "node_position", 1e-6) == ("rk853", "radau")
    assert integrators_for("auto", stiff, "node_position", 1e-2) == ("rk853", "radau")
    assert integrators_for("auto", stiff, "node_distance", 1e-6) == ("rk853",)
    damped = soft.with_changes(damping=np.where(soft.tension_only, 1.0, 0.0))
    assert integrators_for("auto", damped, "node_position", 1e-6) == ("rk54",)
    assert integrators_for("auto", damped, "node_position", 1e-9) == ("rk853",)
    lone = make_structure([[0, 0, 0], [1, 0, 0]], [spring(0, 1, 1.0)], anchored={0: "xyz"})
    assert integrators_for("auto", lone, "node_position", 1e-6) == ("rk853", "radau")
    assert integrators_for("auto", None, "bodies", 1e-6) == ("rk853",)


def test_a_library_without_error_control_says_how_to_get_it() -> None:
    model = simulator(prism(), "rk4")
    with pytest.raises(FormulationError, match="no integrator with error control"):
        simulate(model, 1.0)


def test_a_structure_far_from_the_origin_is_told_the_cure() -> None:
    structure = prism(140.0, bar_stiffness=1e5)
    far = structure.with_changes(node_position=structure.node_position + 1e11)
    model = simulator(far, "rk853")
    found = simulate(model, 1.0, samples=3, stepping=Stepping(max_steps=20_000))
    assert found.status == "not_converged"
    assert "node_distance" in found.message
    assert "rounding error prevents convergence" in found.message


@pytest.mark.parametrize("step", [1e9, 0.5, 1.0])
def test_a_step_of_the_whole_time_or_more_is_held_to_half_of_it(step: float) -> None:
    assert simulate(
        simulator(prism(), "rk4"), 0.5, samples=2, method="rk4", stepping=Stepping(step=step)
    ).status in (
        "inaccurate",
        "unstable",
    )


def test_steps_without_number_are_refused_or_end_at_the_limit() -> None:
    model = model_of(prism_of_ratio)
    given = {"spring_constant": np.full(3, 1e12)}
    stopped = simulate(
        model, 1.0, samples=2, method="rk853", arguments=given, stepping=Stepping(max_steps=500)
    )
    assert (stopped.status, stopped.n_steps <= 1000) == ("not_converged", True)
    assert "`max_steps`" in stopped.message
    stopped = simulate(
        model, 100.0, samples=2, method="radau", arguments=given, stepping=Stepping(max_steps=50)
    )
    assert (stopped.status, stopped.n_steps <= 200) == ("not_converged", True)
    for count in (0, -1, 2**60):
        with pytest.raises(InvalidValueError, match="max_steps"):
            simulate(model, 1.0, stepping=Stepping(max_steps=count))


def spinning(ratio: float) -> Structure:
    """A prism whose ends turn against each other, with damped cables that go slack and taut with a jump."""
    structure = prism(140.0, bar_stiffness=100.0 * ratio, strain=-0.05)
    place = structure.node_position
    turn = np.column_stack([-place[:, 1], place[:, 0], 0.3 * np.ones(6)])
    velocity = 3.0 * turn * np.array([[1.0]] * 3 + [[-1.0]] * 3)
    for i, j in structure.connectivity[structure.is_bar]:
        along = (place[i] - place[j]) / np.linalg.norm(place[i] - place[j])
        half = 0.5 * along * ((velocity[i] - velocity[j]) @ along)
        velocity[i] -= half
        velocity[j] += half
    return structure.with_changes(node_velocity=velocity, damping=np.where(structure.is_bar, 0.0, 5.0))


@pytest.mark.thorough
@pytest.mark.parametrize("ratio", [1e6])
def test_jumps_of_damped_cables_keep_the_error_within_ten_tolerances(ratio: float) -> None:
    found, exact = run(spinning, ratio), run_exactly(spinning, ratio, 1e-12)
    assert found.status == "ok"
    assert np.any(exact.member_tension == 0.0)
    assert worst(found, exact)[0] <= found.error_estimate
    if "vibration_speed_error" not in found.evidence:
        assert worst(found, exact)[1] <= 10.0


@pytest.mark.thorough
def test_what_damped_cables_excite_counts_in_what_radau_leaves_out() -> None:
    found = run(spinning, 1e9)
    assert (found.status, found.method[:11]) == ("ok", "auto (radau")
    assert found.evidence["vibration_error"] > 1e-11
    exact, _ = move_rigidly(spinning(1e9), found.time)
    assert np.max(np.abs(found.coordinate - exact) / (ATOL + RTOL * np.abs(exact))) <= 10.0


def hung_prism(held_bar: bool, law: str) -> Structure:
    """A prism of 276 N/m cables that hangs on one of 42 N/m, with bars of 1e9 N/m, by `law`.

    held_bar: with a bar and a cable of 5e9 N/m between nodes that are anchored.
    """
    near = prism(140.0, bar_stiffness=1e9, strain=0.25)
    members = []
    for k, ends in enumerate(near.connectivity):
        mu = 1e9 if near.is_bar[k] else 276.0
        rest = float(near.rest_length[k]) if near.rest_length[k] > 0 else 1.0
        stiff = {"mu": 0.0, "axial": mu * rest} if law == "axial_stiffness" else {"mu": mu}
        kind = {"bar": True} if near.is_bar[k] else {"tension_only": True}
        members.append({"ends": tuple(ends), "rest": rest, **stiff, **kind})
    members.append(cable(0, 6, 1.0, 42.0))
    if held_bar:
        members += [bar(6, 7, 1.0, 1e9), bar(7, 8, 1.0, 1e9), cable(6, 8, 1.0, 5e9)]
    place = np.vstack([near.node_position, [[0, 0, 3], [1, 0, 3], [1, 1, 3]]])
    return make_structure(place, members, anchored=dict.fromkeys((6, 7, 8), "xyz"))


@pytest.mark.thorough
@pytest.mark.parametrize("law", ["spring_constant", "axial_stiffness"])
@pytest.mark.parametrize("held_bar", [False, True])
def test_the_words_for_stiff_bars_count_members_that_move(held_bar: bool, law: str) -> None:
    model = simulator(hung_prism(held_bar, law), "rk853", "radau")
    found = simulate(model, 1e-3, samples=2, stepping=Stepping(control="steps"))
    assert "bars are 3,600,000 times stiffer than cables" in found.why_method, found.why_method


def test_a_library_of_cables_alone_may_hold_the_stiff_method() -> None:
    """A weight of 3 kg on a cable of 10 N/m and 500 N s/m: no member vibrates, and radau is best."""
    structure = make_structure(
        [[0, 0, 0], [1, 0, 0]], [cable(0, 1, 0.9, 10.0, damping=500.0)], anchored={0: "xyz"}, mass=3.0
    )
    model = simulator(structure, "rk853", "radau")
    velocity = np.array([0.0, 0.1, 0.0])
    found, exact = (
        simulate(model, 200.0, samples=3, method=method, rtol=rtol, velocity=velocity)
        for method, rtol in (("auto", 2e-4), ("rk853", 1e-9))
    )
    assert found.status == exact.status == "ok"
    assert "radau" in found.method
    assert np.abs(found.coordinate - exact.coordinate).max() < 2e-4
