"""Conditions as expressions over quantities: what they may say, and where a motion meets them."""

import numpy as np
import pytest

from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.condition import build_condition, find_quantities
from tensegrity_codegen.runtime.simulate.simulate import Until, simulate
from tensegrity_codegen.runtime.trajectory.simulation_quantities import SIMULATION_QUANTITIES
from tensegrity_codegen.system.errors import (
    FormulationError,
    InvalidValueError,
    NonFiniteError,
    UnknownNameError,
)
from tests.models import load
from tests.runtime.build import bar, make_structure, spring

WANTED = (*SIMULATION_QUANTITIES, "member_length", "member_vector", "tangent_stiffness")


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    """x = 1 + 0.2 cos(20 t): a mass on a spring."""
    structure = make_structure(
        [[0, 0, 0], [1.2, 0, 0]], [spring(0, 1, 1.0, 40.0)], anchored={0: "xyz"}, mass=0.1, axes="x"
    )
    return load(structure, *WANTED, integrators=("rk4", "rk54", "rk853"), events=("condition",))


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ('member_length["e0"] - 1', 0.2),
        ("member_length[0] - member_length[-1]", 0.0),
        ("2 * time + 3", 4.0),
        ("-kinetic_energy + total_energy / 2 ** 2", 0.2),
        ('abs(member_vector["e0", "x"]) + sqrt(4)', 3.2),
        ("max(member_tension) - min(0.5, 1e3)", 7.5),
        ("n1.x", 1.2),
        ("n0.z - n1.x", -1.2),
        ('node_position["n1", "x"] * 2', 2.4),
        ("n1.x < 1.3", 0.1),
        ("n1.x >= 1.3", -0.1),
        ("max(node_position) > 1", 0.2),
    ],
)
def test_an_expression_is_worked_out(model: CompiledModel, text: str, value: float) -> None:
    condition = build_condition(text, model)
    q, v = model.nominal("coordinate"), model.nominal("velocity")
    assert condition(0.5, q, v) == pytest.approx(value, abs=1e-14)


@pytest.mark.parametrize("method", ["auto", "rk54", "rk853"])
def test_a_motion_ends_where_the_condition_turns(model: CompiledModel, method: str) -> None:
    found = simulate(
        model, 1.0, samples=11, method=method, rtol=1e-10, stepping=Stepping(atol=1e-12),
        until='member_length["e0"] - 0.9',
    )  # fmt: skip
    expected = np.arccos(-0.5) / 20
    assert found.status == "ok"
    assert found.time.tolist() == [0.0, 0.1, pytest.approx(expected, rel=1e-9)]
    (event,) = found.events
    assert (event.kind, event.time) == ("condition", found.time[-1])
    assert event.coordinate[0] == pytest.approx(0.9, rel=1e-9)


def test_without_an_end_the_log_has_every_turn(model: CompiledModel) -> None:
    found = simulate(
        model,
        1.0,
        method="rk853",
        rtol=1e-10,
        stepping=Stepping(atol=1e-12),
        until=Until(condition=lambda t, q, v: q[0] - 1.0, stops=False),
    )
    turns = (np.arange(6) + 0.5) * np.pi / 20
    np.testing.assert_allclose(found.log.time, turns, rtol=1e-8)
    assert found.log.direction.tolist() == [-1, 1] * 3
    assert found.summary()["n_events"] == 6
    assert found.arrays()["log_kind"].tolist() == ["condition"] * 6
    assert found.events == ()


@pytest.mark.parametrize(
    "text",
    [
        *("__import__('os').system('true')", "(lambda: 1)()", "[1, 2]", "time.real", "time if time else 1"),
        *("kinetic_energy <", "", "1" * 1000, "time and 1", "member_length[0:1]", "member_length[0, 0]"),
        *("member_vector",),
    ],
)
def test_what_is_no_single_number_is_refused(model: CompiledModel, text: str) -> None:
    with pytest.raises((InvalidValueError, UnknownNameError)):
        build_condition(text, model)


@pytest.mark.parametrize("text", ["kinetic_enrgy", 'member_length["x"]', "member_length[7]", "exp(1)"])
def test_unknown_names_are_named(model: CompiledModel, text: str) -> None:
    with pytest.raises(UnknownNameError):
        build_condition(text, model)


@pytest.mark.parametrize("text", ["elastic_energy - 1", "tangent_stiffness"])
def test_quantities_that_the_model_lacks_are_named(model: CompiledModel, text: str) -> None:
    with pytest.raises(FormulationError, match="no such function"):
        build_condition(text, model)


def test_the_quantities_of_an_expression_are_told_before_the_model_is_built() -> None:
    found = find_quantities("max(member_length) * time - node_force[0, 1]")
    assert set(found) == {"member_length", "node_force"}


def test_methods_without_events_refuse_a_condition(model: CompiledModel) -> None:
    with pytest.raises(InvalidValueError, match="does not monitor conditions"):
        simulate(model, 1.0, method="scipy_radau", until=Until(condition="time - 0.5", stops=False))


@pytest.mark.parametrize(
    "text", ["n1.w", "n9.x", "n1.x.y", "n1.x < 1 < 2", "n1.x == 1", "not time", "time if 1 else 2"]
)
def test_what_is_no_place_and_no_comparison_is_refused(model: CompiledModel, text: str) -> None:
    with pytest.raises((UnknownNameError, InvalidValueError)):
        build_condition(text, model)


def test_a_run_ends_where_a_comparison_becomes_true(model: CompiledModel) -> None:
    ended = simulate(model, 1.0, method="rk853", until="n1.x < 1.1", rtol=1e-10)
    assert ended.time[-1] == pytest.approx(np.arccos(0.5) / 20, rel=1e-8)
    assert ended.events[0].names == ("n1.x < 1.1",)
    at_once = simulate(model, 1.0, method="rk853", until="n1.x > 1.1")
    assert (at_once.status, at_once.time.tolist()) == ("ok", [0.0])
    assert "from the start" in at_once.message


@pytest.mark.thorough
@pytest.mark.parametrize("method", ["rk4", "rk853"])
def test_rounding_of_a_condition_keeps_no_run_from_ending(method: str) -> None:
    """The tension of a stiff bar holds the rounding of its length 2e5 times."""
    structure = make_structure(
        [[0, 0, 0], [0.3, 0, 0], [0.1, 0, 0.9]],
        [bar(0, 1, 0.3, 2e5), spring(1, 2, 0.8, 200.0), spring(0, 2, 0.8, 200.0)],
        anchored={2: "xyz"}, mass=0.1, axes="xz", gravity=(0.0, 0.0, -9.81),
    )  # fmt: skip
    model = load(structure, *SIMULATION_QUANTITIES, integrators=("rk4", "rk853"), events=("condition",))
    step = 1e-5 if method == "rk4" else None
    for tension in np.linspace(2.0, 7.0, 3 if method == "rk4" else 10):
        text = f"member_tension[0] > {tension:.17g}"
        found = simulate(model, 0.1, method=method, until=text, stepping=Stepping(step=step))
        assert found.status == "ok", text
        assert found.member_tension[-1, 0] == pytest.approx(tension, abs=1e-4)


def test_several_arguments_count_with_all_their_numbers(model: CompiledModel) -> None:
    q, v = model.nominal("coordinate"), model.nominal("velocity")
    assert build_condition("min(member_length, 1)", model)(0.0, q, v) == pytest.approx(1.0)
    assert build_condition("sum(n1.x, member_length, 1)", model)(0.0, q, v) == pytest.approx(3.4)
    assert build_condition('sum(node_position["n1"])', model)(0.0, q, v) == pytest.approx(1.2)


def test_shapes_that_do_not_fit_are_refused(model: CompiledModel) -> None:
    structure = make_structure(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [spring(0, 1, 1.0, 40.0), spring(1, 2, 1.0, 40.0)],
        anchored={0: "xyz", 2: "xyz"}, mass=0.1, axes="xy",
    )  # fmt: skip
    three = load(structure, "acceleration")
    with pytest.raises(InvalidValueError, match="different shapes"):
        build_condition("sum(node_position + acceleration)", three)
    with pytest.raises(InvalidValueError, match="no such entry"):
        build_condition("member_length[0, 0]", model)


@pytest.mark.parametrize("text", ["1 / kinetic_energy < 5", "sqrt(n1.x - 1) < 0.01"])
def test_a_condition_that_is_not_finite_is_named_not_called_unstable(model: CompiledModel, text: str) -> None:
    with pytest.raises(NonFiniteError, match="condition is not a finite number at t = ") as caught:
        simulate(model, 1.0, method="rk853", until=text)
    assert text in str(caught.value)


def test_a_function_that_is_not_finite_is_named_too(model: CompiledModel) -> None:
    with pytest.raises(NonFiniteError, match="condition is not a finite number"):
        simulate(
            model,
            1.0,
            method="rk4",
            stepping=Stepping(step=1e-3),
            until=Until(condition=lambda t, q, v: float("inf"), stops=False),
        )
