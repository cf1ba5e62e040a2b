"""The Rosenbrock method `rodas`: order, other methods, stiff decay, damping, events, profiles, refusals."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import CompiledModel, ModelRequest, Profile, simulate
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.integrate.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions, Stepping
from tensegrity_codegen.runtime.trajectory.simulation_quantities import simulation_quantities
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.system.errors import FormulationError
from tests.runtime.build import bar, cable, make_structure, prism, spring
from tests.runtime.integrate.nets import net
from tests.runtime.integrate.test_events import equal_steps, run


def build(structure: Structure, *others: str, **options: Any) -> CompiledModel:
    wanted = simulation_quantities(options.get("formulation", "node_position"))
    request = ModelRequest(wanted, integrators=("rodas", *others), **{"events": ("auto",), **options})
    return build_library(structure, request).load()


def damped_prism(damping: float) -> Structure:
    """The prism in motion, its cables with this much damping [N s/m]."""
    structure = prism()
    velocity = np.where(structure.node_anchored, 0.0, np.linspace(-0.3, 0.4, 18).reshape(6, 3))
    some = np.where(structure.tension_only, damping, 0.0)
    return structure.with_changes(damping=some, node_velocity=velocity)


def pendulum(rate: float = 0.0, **more: Any) -> Structure:
    """A mass that swings on a spring with much damping along it."""
    structure = make_structure(
        [[0, 0, 0], [1.1, 0, 0]],
        [spring(0, 1, 1.0, 40.0, damping=rate)],
        anchored={0: "xyz"},
        axes="xz",
        gravity=(0.0, 0.0, -9.81),
        **more,
    )
    return structure.with_changes(node_velocity=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -0.5]]))


@pytest.mark.parametrize("rate", [0.0, 0.7])
def test_equal_steps_converge_with_order_five(rate: float) -> None:
    model = build(pendulum(rate), "rk853")
    best, _ = equal_steps("rk853", model, 1.0, 800, False)
    counts = (20, 40, 80)
    errors = [np.abs(equal_steps("rodas", model, 1.0, count, False)[0] - best).max() for count in counts]
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx(5.0, abs=0.4)


def test_order_is_kept_through_events() -> None:
    model = build(net(), "rk853")
    best, n_events = equal_steps("rk853", model, 2.0, 800, True)
    assert n_events > 5
    counts = (150, 300, 600)
    found = [equal_steps("rodas", model, 2.0, count, True) for count in counts]
    assert [events for _, events in found] == [n_events] * 3
    errors = [np.abs(state - best).max() for state, _ in found]
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] > 4.5


@pytest.fixture(scope="module")
def prism_model() -> CompiledModel:
    return build(damped_prism(2.0), "rk853", "radau")


def test_three_methods_agree_to_a_billionth(prism_model: CompiledModel) -> None:
    runs = [
        simulate(prism_model, 0.25, samples=16, method=name, rtol=1e-10, stepping=Stepping(atol=1e-11))
        for name in ("rodas", "rk853", "radau")
    ]
    assert [run.status for run in runs] == ["ok"] * 3
    for other in runs[1:]:
        assert np.abs(other.node_position - runs[0].node_position).max() < 1e-9


def test_much_damping_costs_no_steps() -> None:
    """Overdamped: the fast decay, c / m, asks an explicit method for steps of m / c."""
    model = build(pendulum(2e5), "rk853")
    runs = [
        simulate(model, 0.5, method=name, rtol=1e-6, stepping=Stepping(atol=1e-6))
        for name in ("rodas", "rk853")
    ]
    assert [run.status for run in runs] == ["ok"] * 2
    assert 20 * runs[0].n_steps < runs[1].n_steps
    assert np.abs(runs[0].node_position - runs[1].node_position).max() < 1e-6


def test_samples_between_steps_are_those_of_steps_that_end_there(prism_model: CompiledModel) -> None:
    coarse = simulate(
        prism_model, 0.2, samples=1000, method="rodas", rtol=1e-6, stepping=Stepping(control="steps")
    )
    tight = simulate(
        prism_model, 0.2, samples=1000, method="rk853", rtol=1e-11, stepping=Stepping(atol=1e-12)
    )
    assert len(coarse.time) > 1.5 * coarse.n_steps
    assert np.abs(coarse.node_position - tight.node_position).max() < 1e-5


@pytest.mark.parametrize("formulation", ["rigid_bar", "node_distance"])
def test_formulations_with_constraints_are_served(formulation: str) -> None:
    structure = prism(140.0)
    structure = structure.with_changes(damping=np.where(structure.tension_only, 0.5, 0.0))
    options = {"options": {"bars": "all"}} if formulation == "rigid_bar" else {}
    model = build(structure, "rk853", formulation=formulation, **options)
    runs = [
        simulate(model, 0.2, samples=11, method=name, rtol=1e-9, stepping=Stepping(atol=1e-10))
        for name in ("rodas", "rk853")
    ]
    assert np.abs(runs[0].node_position - runs[1].node_position).max() < 1e-8


def test_arguments_that_follow_a_profile_keep_the_order() -> None:
    """Without the derivative to time, or with a poor one, the order would be lower."""
    structure = pendulum(0.7, inputs=(ActuatedInput("push", "force", (1,), (1.0, 0.0, 0.0)),))
    model = build(structure, "rk853")
    knots = np.linspace(0.0, 1.0, 5)
    profile = Profile(knots, {"push": 6.0 * np.sin(3.0 * knots)}, "cubic")
    options: dict[str, Any] = {"schedule": profile, "samples": [0.0, 1.0]}
    best = simulate(
        model, 1.0, method="rk853", rtol=1e-13, stepping=Stepping(atol=1e-13, control="steps"), **options
    )
    runs = [
        simulate(
            model, 1.0, method="rodas", rtol=tol, stepping=Stepping(atol=tol, control="steps"), **options
        )
        for tol in (1e-5, 1e-7, 1e-9, 1e-10)
    ]
    errors = [np.abs(run.node_position - best.node_position).max() for run in runs]
    steps = [run.n_steps for run in runs]
    assert errors[-1] < 1e-9
    assert -np.polyfit(np.log(steps), np.log(errors), 1)[0] > 4.5


def test_a_motion_that_is_not_finite_is_told() -> None:
    structure = make_structure([[0, 0, 0], [0, 0, 0], [1, 0, 0]], [bar(0, 1, 0.1), cable(1, 2, 0.5)])
    model = build(structure)
    state = np.concatenate([model.nominal("coordinate"), model.nominal("velocity")])
    found = integrate_adaptive(Motion(model, state, np.array([0.0, 1.0])), RunOptions("rodas"))
    assert (found.status, len(found.time)) == ("unstable", 1)


def test_a_run_with_too_few_steps_is_told() -> None:
    found = simulate(build(pendulum()), 5.0, method="rodas", rtol=1e-9, stepping=Stepping(max_steps=5))
    assert found.status == "not_converged"


def test_single_precision_is_refused() -> None:
    request = ModelRequest(("acceleration",), integrators=("rodas",), precision="single")
    with pytest.raises(FormulationError, match="'rodas' needs double precision"):
        emit(pendulum(), request)


def test_a_loose_cable_pulls_at_the_right_time() -> None:
    """A mass in free fall for g t^2 / 2 = 0.2 m until its cable is taut."""
    structure = make_structure(
        [[0, 0, 0], [0, 0, -0.8]],
        [cable(0, 1, 1.0, 400.0, damping=5.0)],
        anchored={0: "xyz"},
        axes="xz",
        gravity=(0.0, 0.0, -9.81),
    )
    found = run("rodas", build(structure), [0.0, 0.3], 1e-10)
    assert (found.status, found.log.name[0]) == ("ok", "e0")
    assert found.log.time[0] == pytest.approx(np.sqrt(0.4 / 9.81), abs=1e-9)
