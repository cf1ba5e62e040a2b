"""Radau IIA-5 for the mixed form: as exact as asked and as fast at any stiffness of the bars."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.codegen.integrators import implicit as generated
from tensegrity_codegen.runtime.integrate import c_run
from tensegrity_codegen.runtime.integrate.implicit import integrate_implicit
from tensegrity_codegen.runtime.integrate.integration import BoundIntegrator
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions, Stepping
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.cache_root import CACHE_VARIABLE
from tensegrity_codegen.system.errors import NonFiniteError
from tests.cases import thorough
from tests.models import load, simulator, start_of
from tests.runtime.build import bar, cable, make_structure, spring
from tests.runtime.integrate.nets import net
from tests.runtime.stiff_bars import class_two, move_rigidly, pendulums, prism_of_ratio

TIME = np.linspace(0.0, 0.5, 11)


@functools.cache
def model_of(make: Callable[..., Structure], *more: float) -> CompiledModel:
    """One library for all stiffnesses of the bars, which stay changeable."""
    structure = make(1.0, *more)
    bars = tuple(np.flatnonzero(structure.is_bar).tolist())
    return compiled(structure, {"spring_constant": bars, "damping": bars})


@functools.cache
def pendulum() -> CompiledModel:
    return compiled(spring_pendulum())


def compiled(structure: Structure, parameters: dict[str, tuple[int, ...]] | None = None) -> CompiledModel:
    return simulator(structure, "radau", "rk853", parameters=parameters or {})


def stiffness(structure: Structure) -> dict[str, Any]:
    """The values of the bars as run-time arguments."""
    bars = structure.is_bar
    return {"spring_constant": structure.spring_constant[bars], "damping": structure.damping[bars]}


def run(model: CompiledModel, tolerance: float, time: np.ndarray = TIME, **arguments: Any) -> RawTrajectory:
    known = {item.name for item in model.manifest.arguments}
    given = {name: value for name, value in arguments.items() if name in known}
    return integrate_implicit(
        Motion(model, start_of(model), time, given), RunOptions("radau", tolerance, tolerance)
    )


def run_at(
    make: Callable[..., Structure], ratio: float, tolerance: float, *more: float, time: np.ndarray = TIME
) -> RawTrajectory:
    return run(model_of(make, *more), tolerance, time, **stiffness(make(ratio, *more)))


def explicit(make: Callable[..., Structure], ratio: float, span: float, samples: int) -> Trajectory:
    model = model_of(make)
    known = {item.name for item in model.manifest.arguments}
    given = {name: value for name, value in stiffness(make(ratio)).items() if name in known}
    return simulate(
        model,
        span,
        samples=samples,
        method="rk853",
        rtol=1e-12,
        stepping=Stepping(atol=1e-13),
        arguments=given,
    )


def positions(raw: RawTrajectory) -> np.ndarray:
    return raw.state[:, : raw.state.shape[1] // 2]


def spring_pendulum(mu: float = 40.0) -> Structure:
    """A mass that swings on one two-sided spring: smooth, without cables, resolved by every step."""
    structure = make_structure(
        [[0, 0, 0], [1.1, 0, 0]],
        [bar(0, 1, 1.0, mu)],
        anchored={0: "xyz"},
        axes="xz",
        gravity=(0.0, 0.0, -9.81),
    )
    velocity = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -0.5]])
    return structure.with_changes(node_velocity=velocity)


def take_equal_steps(model: CompiledModel, count: int, span: float) -> np.ndarray:
    """State after `count` steps of the same length, each tried with the step set from outside."""
    bound = BoundIntegrator("radau", Motion(model, start_of(model), np.array([0.0, span])))
    ffi, state = bound.ffi, bound.pointer(bound.state)
    time, step = ffi.new("double *", 0.0), ffi.new("double *")
    counts, vibration = ffi.new("long long[]", 6), ffi.new("double[]", 3)
    samples = [bound.pointer(array) for array in (bound.sample_time, bound.samples, bound.tensions)]
    tail = (2, *samples, bound.n_sampled, 0.0, counts, vibration, bound.pointer(bound.work))
    for k in range(count):
        step[0] = span / count
        end = span if k == count - 1 else span * (k + 1) / count
        assert bound.call(end, 1e-5, 1e-5, 1, time, step, state, *bound.arguments(), *tail) == 0
    assert counts[0] == count, "a step was refused: choose shorter ones"
    return bound.state


def test_the_observed_order_is_five_where_steps_resolve_the_springs(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """With Newton's method taken to the end, which the library as it is made leaves within the tolerance."""
    monkeypatch.setattr(generated, "NEWTON_SHARE", 1e-8)
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))  # of libraries that are made otherwise
    model = compiled(spring_pendulum())
    span = 0.3
    exact = simulate(
        model, span, samples=2, method="rk853", rtol=1e-13, stepping=Stepping(atol=1e-14)
    ).coordinate[-1]
    errors = [np.abs(take_equal_steps(model, count, span)[:2] - exact).max() for count in (10, 20)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(5.0, abs=0.35)


def test_what_newtons_method_leaves_is_small_beside_the_tolerance() -> None:
    """Where steps resolve the springs, their own errors are a few hundredths of the tolerance."""
    model, time = pendulum(), np.array([0.0, 0.3])
    exact = simulate(
        model, 0.3, samples=2, method="rk853", rtol=1e-13, stepping=Stepping(atol=1e-14)
    ).coordinate[-1]
    tolerances = (1e-6, 1e-8, 1e-10)
    found = [run(model, tolerance, time) for tolerance in tolerances]
    for tolerance, raw in zip(tolerances, found, strict=True):
        assert np.abs(positions(raw)[-1] - exact).max() < 0.03 * tolerance
    assert found[-1].evidence["iterations"] < 4.5 * found[-1].evidence["accepted"]


def test_the_order_over_tolerances_is_five_down_to_rounding() -> None:
    """What Newton's method leaves shrinks with the steps' own errors, beside the estimate of order 3."""
    model, time = pendulum(), np.array([0.0, 3.0])
    exact = simulate(
        model, 3.0, samples=2, method="rk853", rtol=1e-13, stepping=Stepping(atol=1e-14)
    ).coordinate[-1]
    found = [run(model, tolerance, time) for tolerance in (1e-5, 1e-6, 1e-7, 1e-8, 1e-9)]
    errors = [np.abs(positions(raw)[-1] - exact).max() for raw in found]
    steps = [raw.n_steps for raw in found]
    assert -np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(5.0, abs=0.4)


@pytest.mark.thorough
@pytest.mark.parametrize("ratio", [1e2, *thorough(1e1, 1e3)])
def test_it_agrees_with_an_explicit_method_at_low_stiffness(ratio: float) -> None:
    exact = explicit(prism_of_ratio, ratio, 0.5, 11)
    raw = run_at(prism_of_ratio, ratio, 1e-8)
    assert raw.status == "ok"
    np.testing.assert_allclose(positions(raw), exact.coordinate, atol=1e-7)
    np.testing.assert_allclose(raw.state, np.hstack([exact.coordinate, exact.velocity]), atol=1e-6)
    np.testing.assert_allclose(raw.tension, exact.member_tension[:, raw.tension_member], atol=1e-4 * ratio)


@pytest.mark.thorough
@pytest.mark.parametrize(("make", "more"), [(prism_of_ratio, ()), (class_two, ()), (class_two, (0.3,))])
@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8])
def test_nearly_rigid_bars_move_as_rigid_ones(make: Any, more: Any, tolerance: float) -> None:
    exact, tension = move_rigidly(make(1e12, *more), TIME)
    raw = run_at(make, 1e12, tolerance, *more)
    assert raw.status == "ok"
    assert np.abs(positions(raw) - exact).max() <= 10 * tolerance
    assert raw.tension is not None
    size = np.abs(tension).max()
    assert np.abs(raw.tension[1:] - tension[1:]).max() <= 1e4 * tolerance * size


@pytest.mark.thorough
@pytest.mark.parametrize("make", [prism_of_ratio, class_two, pendulums])
def test_the_distance_to_rigid_bars_falls_with_the_stiffness(make: Any) -> None:
    exact, _ = move_rigidly(make(1e9), TIME)
    distance = [np.abs(positions(run_at(make, ratio, 1e-9)) - exact).max() for ratio in (1e5, 1e6)]
    assert distance[0] / distance[1] == pytest.approx(10.0, rel=0.1)


@pytest.mark.parametrize("make", [pendulums, *thorough(prism_of_ratio, class_two)])
def test_work_does_not_depend_on_the_stiffness(make: Any) -> None:
    work = [run_at(make, ratio, 1e-5).evidence["iterations"] for ratio in (1e5, 1e7, 1e9, 1e12)]
    assert max(work) <= 1.3 * min(work)
    assert max(work) < 1500


def test_vibrations_below_the_tolerance_are_told_and_those_above_are_resolved() -> None:
    quiet, loud = (run_at(prism_of_ratio, 1e4, tolerance) for tolerance in (1e-3, 1e-7))
    amplitude = quiet.evidence["vibration"]
    assert 1e-7 < amplitude < 1e-3
    assert amplitude == loud.evidence["vibration"]
    frequency = quiet.evidence["vibration_speed"] / amplitude
    assert loud.evidence["accepted"] > 4 * frequency / (2 * np.pi) * TIME[-1]
    assert quiet.evidence["accepted"] < 200


def test_slack_cables_and_damping_keep_the_error_within_the_tolerance() -> None:
    time = np.linspace(0.0, 1.0, 21)
    exact = explicit(pendulums, 1e3, 1.0, 21)
    assert np.any(exact.member_tension[:, 2] == 0.0)
    assert np.any(exact.member_tension[:, 2] > 0.0)
    raw = run_at(pendulums, 1e3, 1e-6, time=time)
    assert np.abs(positions(raw) - exact.coordinate).max() < 1e-5
    assert np.abs(raw.state - np.hstack([exact.coordinate, exact.velocity])).max() < 3e-5


def hung(damping: float) -> Structure:
    """Two masses on a stiff bar and on damped cables that go slack, under gravity."""
    place = [[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.7, 0.05, 0.1], [1.0, 0.0, 0.0], [0.5, 0.0, 0.6]]
    ends = ((1, 2, 0.4, 2000.0), (2, 3, 0.3, 1500.0), (1, 4, 0.55, 1000.0), (2, 4, 0.58, 1000.0))
    return make_structure(
        place,
        [bar(0, 1, 0.3), *(cable(i, j, rest, mu, damping=damping) for i, j, rest, mu in ends)],
        anchored=dict.fromkeys((0, 3, 4), "xyz"),
        gravity=(0.0, 0.0, -9.81),
        mass=[0.1, 0.2, 0.05, 0.1, 0.1],
    )


@pytest.mark.parametrize("changes", [False, True], ids=["constant", "run-time parameter"])
@pytest.mark.parametrize("damping", [100.0, *thorough(1e5)])
def test_much_damping_of_cables_costs_no_steps(
    monkeypatch: pytest.MonkeyPatch, damping: float, changes: bool
) -> None:
    """Work memory is not zero at first: what is read before it is written makes the motion NaN."""
    prepare = BoundIntegrator.__init__

    def fill(bound: BoundIntegrator, *told: Any, **more: Any) -> None:
        prepare(bound, *told, **more)
        bound.work.fill(np.nan)

    monkeypatch.setattr(BoundIntegrator, "__init__", fill)
    structure = hung(1.0 if changes else damping)
    model = compiled(structure, {"damping": (1, 2, 3, 4)} if changes else {})
    given = {"damping": np.full(4, damping)} if changes else {}
    raw = run(model, 1e-6, np.linspace(0.0, 0.1, 11), **given)
    assert raw.status == "ok"
    assert raw.evidence["accepted"] + raw.evidence["rejected"] + raw.evidence["newton_failures"] < 3000
    if damping < 1e3:
        exact = simulate(
            model,
            0.1,
            samples=11,
            method="rk853",
            rtol=1e-10,
            arguments=given,
            stepping=Stepping(max_steps=1_000_000),
        )
        assert exact.status == "ok"
        np.testing.assert_allclose(positions(raw), exact.coordinate, rtol=0.0, atol=1e-5)


def test_energy_and_tensions_of_a_trajectory_come_from_the_unknown_tensions() -> None:
    structure = prism_of_ratio(1e9)
    given = {"spring_constant": structure.spring_constant[structure.is_bar]}
    found = simulate(
        model_of(prism_of_ratio),
        0.5,
        samples=11,
        method="radau",
        rtol=1e-8,
        stepping=Stepping(atol=1e-8),
        arguments=given,
    )
    assert found.status == "ok"
    change = np.abs(found.total_energy - found.total_energy[0]).max()
    assert change < 1e-6 * found.kinetic_energy.max()
    _, tension = move_rigidly(structure, TIME)
    np.testing.assert_allclose(found.member_tension[1:, [0, 4, 8]], tension[1:], rtol=1e-4)
    assert found.summary()["evidence"]["newton_failures"] >= 0


def test_tensions_of_rigid_bars_beside_a_soft_spring_are_as_exact_as_the_motion() -> None:
    place = np.array([[0, 0, 0], [0.08, -0.04, -1.07], [-0.04, 0.12, -2.0], [0.19, -0.08, -2.9]])
    first, second, third = np.linalg.norm(np.diff(place, axis=0), axis=1)
    members = [
        spring(0, 1, first, mu=370.0),
        bar(1, 2, second, mu=0.0, mass=0.5),
        cable(2, 3, third, mu=160.0),
    ]
    mass = [1.0, 1.0, 3.4, 0.7]
    structure = make_structure(place, members, anchored={0: "xyz"}, gravity=(0, 0, -9.81), mass=mass)
    model = simulator(structure, "radau", "rk853", formulation="rigid_bar")
    one, other = (
        simulate(model, 0.027, samples=5, method=method, rtol=1e-11, stepping=Stepping(atol=1e-14))
        for method in ("radau", "rk853")
    )
    assert one.status == other.status == "ok"
    np.testing.assert_allclose(one.member_tension, other.member_tension, atol=1e-9)


@pytest.mark.thorough
def test_parameters_and_inputs_change_at_run_time() -> None:
    structure = prism_of_ratio(1e6)
    everything = tuple(range(structure.n_members))
    model = compiled(structure, {"rest_length": everything, "spring_constant": everything, "node_mass": (5,)})
    rest_length = structure.rest_length * np.where(structure.is_bar, 1.0, 0.9)
    mass = np.full(structure.n_nodes, 1.0)
    mass[5] = 2.5
    changed = structure.with_changes(rest_length=rest_length, node_mass=mass)
    raw = run(model, 1e-8, rest_length=rest_length, node_mass=mass[5:])
    np.testing.assert_allclose(raw.state, run(compiled(changed), 1e-8).state, atol=1e-12)


def test_runs_are_bit_identical_however_they_are_cut_into_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = run_at(prism_of_ratio, 1e7, 1e-7)
    monkeypatch.setattr(c_run, "FIRST_CHUNK", 1)
    pieces = run_at(prism_of_ratio, 1e7, 1e-7)
    np.testing.assert_array_equal(whole.state, pieces.state)
    np.testing.assert_array_equal(whole.tension, pieces.tension)
    assert whole.evidence == pieces.evidence


def test_coincident_ends_of_a_bar_are_told() -> None:
    structure = make_structure([[0, 0, 0], [0, 0, 0], [1, 0, 0]], [bar(0, 1, 0.1), cable(1, 2, 0.5)])
    raw = run(compiled(structure), 1e-6)
    assert raw.status == "unstable"
    assert len(raw.time) == 1


def test_states_that_are_not_finite_are_refused() -> None:
    model = model_of(prism_of_ratio)
    state = np.full(2 * len(model.manifest.coordinate_name), np.nan)
    with pytest.raises(NonFiniteError):
        integrate_implicit(Motion(model, state, TIME), RunOptions("radau"))


def test_a_tolerance_below_rounding_is_not_called_met() -> None:
    raw = run_at(prism_of_ratio, 1e6, 1e-18)
    assert raw.status == "not_converged"


def test_without_two_sided_members_it_is_a_method_like_others() -> None:
    model = compiled(net())
    assert model.manifest.integrators[0].tensions == ()
    exact, found = (
        simulate(model, 1.0, samples=11, method=method, rtol=1e-8, stepping=Stepping(atol=1e-8))
        for method in ("rk853", "radau")
    )
    assert found.status == "ok"
    assert found.log.count == exact.log.count > 0
    np.testing.assert_allclose(found.coordinate, exact.coordinate, atol=1e-7)
    np.testing.assert_allclose(found.member_tension, exact.member_tension, atol=1e-4)


def braced(mu: float) -> Structure:
    """A square with both diagonals, one more than hold it, between four cables."""
    position = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [-1, 0.5, 0], [2.1, 0.5, 0]]
    sides = [bar(k, (k + 1) % 4, 1.0, mu) for k in range(4)]
    diagonals = [bar(k, k + 2, np.sqrt(2.0), mu) for k in range(2)]
    cables = [cable(a, b, rest, 50.0) for a, b, rest in ((4, 0, 0.9), (4, 3, 1.0), (5, 1, 1.0), (5, 2, 0.9))]
    structure = make_structure(
        position,
        [*sides, *diagonals, *cables],
        anchored={4: "xyz", 5: "xyz"},
        axes="xy",
        gravity=(0.0, -2.0, 0.0),
    )
    return structure.with_changes(name="braced")


@pytest.mark.thorough
def test_bars_that_repeat_each_other_move_as_their_stiffness_says() -> None:
    """Six bars where five hold the square: rows of the smooth equations repeat each other."""
    exact = simulate(
        compiled(braced(1e4)), 0.5, samples=6, method="rk853", rtol=1e-10, stepping=Stepping(atol=1e-11)
    )
    raw = run(compiled(braced(1e4)), 1e-8, np.linspace(0.0, 0.5, 6))
    assert np.abs(raw.state - np.hstack([exact.coordinate, exact.velocity])).max() < 1e-6
    stiff, stiffer = (run(compiled(braced(mu)), 1e-7, np.linspace(0.0, 0.5, 6)) for mu in (1e10, 1e12))
    assert stiff.status == stiffer.status == "ok"
    assert stiff.evidence["accepted"] < 200
    np.testing.assert_allclose(stiff.state[1:], stiffer.state[1:], atol=1e-6)
    assert stiff.tension is not None
    np.testing.assert_allclose(stiff.tension[1:], stiffer.tension[1:], atol=1e-2)


def test_more_bars_than_coordinates_are_no_trouble() -> None:
    position = [[0, 0, 0], [1, 0, 0], [-0.5, 0.8, 0], [-0.5, -0.8, 0]]
    rest = [float(np.linalg.norm(place)) for place in position[1:]]
    structure = make_structure(
        position,
        [bar(0, k + 1, length, 100.0) for k, length in enumerate(rest)],
        anchored=dict.fromkeys((1, 2, 3), "xyz"),
        axes="xy",
        gravity=(0.0, -2.0, 0.0),
    )
    model, time = compiled(structure), np.linspace(0.0, 1.0, 6)
    exact = simulate(model, 1.0, samples=6, method="rk853", rtol=1e-10, stepping=Stepping(atol=1e-12))
    raw = run(model, 1e-8, time)
    assert np.abs(raw.state - np.hstack([exact.coordinate, exact.velocity])).max() < 1e-7


@pytest.mark.thorough
@pytest.mark.parametrize("make", [prism_of_ratio, class_two])
def test_rigid_bars_are_the_end_of_the_scale(make: Any) -> None:
    """Without any stiffness, in the formulation that keeps lengths: no compliance at all."""
    structure = make(1.0)
    rigid = structure.with_changes(spring_constant=np.where(structure.is_bar, 0.0, structure.spring_constant))
    raw = run(load(rigid, "member_tension", integrators=("radau",), formulation="rigid_bar"), 1e-8)
    exact, tension = move_rigidly(structure, TIME)
    assert raw.status == "ok"
    assert np.abs(positions(raw) - exact).max() <= 1e-7
    assert raw.tension is not None
    np.testing.assert_allclose(raw.tension, tension, atol=1e-4 * np.abs(tension).max())
    stiff = run_at(make, 1e12, 1e-8)
    np.testing.assert_allclose(raw.state[1:], stiff.state[1:], atol=1e-7)


@pytest.mark.thorough
def test_far_from_the_origin_steps_do_not_chase_rounding() -> None:
    structure = class_two(1e9)
    far = structure.with_changes(node_position=structure.node_position + 40.0)
    near_run, far_run = (run(compiled(item), 1e-8) for item in (structure, far))
    assert far_run.status == "ok"
    assert far_run.evidence["accepted"] < 1.5 * near_run.evidence["accepted"]
    np.testing.assert_allclose(positions(far_run) - 40.0, positions(near_run), atol=4e-6)


def first_step(model: CompiledModel, distance: float, rtol: float) -> float:
    """The step that radau proposes for a free prism so far from the origin; all vibrations are quiet."""
    offset = np.tile(distance * np.array([0.6, -0.7, 0.4]), 6)
    state = np.concatenate([model.nominal("coordinate") + offset, model.nominal("velocity")])
    bound = BoundIntegrator("radau", Motion(model, state, np.array([0.0, 1.0]), {}))
    ffi, time, step = bound.ffi, bound.ffi.new("double *"), bound.ffi.new("double *")
    head = (1.0, rtol, 1e-3 * rtol, 0, time, step, bound.pointer(bound.state), *bound.arguments(), 2)
    samples = [bound.pointer(array) for array in (bound.sample_time, bound.samples, bound.tensions)]
    tail = (*samples, bound.n_sampled, 1.0, ffi.new("long long[6]"), ffi.new("double[3]"))
    watched = (ffi.new("integrator_run *"),) if bound.spec.events else ()
    assert bound.call(*head, *tail, *watched, bound.pointer(bound.work)) == 0
    return float(step[0])


def test_the_first_step_is_the_same_wherever_the_origin_lies() -> None:
    model = simulator(prism_of_ratio(1e7), "radau")  # no explicit method beside it
    for rtol in (1e-4, 1e-8, 1e-11):
        near = first_step(model, 0.0, rtol)
        for distance in (1e2, 1e4, 1e6):
            assert first_step(model, distance, rtol) == pytest.approx(near, rel=0.05)
        assert near > 1.2 * first_step(model, 0.0, 0.1 * rtol)
