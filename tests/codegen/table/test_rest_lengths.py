"""Derivatives to rest lengths that need no mass: by Taylor, in closed form, in all formulations."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegrity_codegen.codegen.emitter import prune
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest
from tests.body_scenes import EVERYTHING, BodyEvaluator, assemble_document, random_state
from tests.cases import draws
from tests.comparison import dense, largest_terms, run_in_casadi
from tests.random_structures import structures
from tests.runtime.build import cable, make_structure, prism, spring
from tests.symbolic.taylor import check_second_order
from tests.symbolic.test_node_position import Evaluator, all_parameters, draw_direction, offered_by
from tests.tables.laws.test_bilinear import with_law

SLOW = draws(3)
NEW = ("residual_rest_length_jacobian", "tension_rest_length_derivative", "tension_jacobian")
TAYLOR = [
    ("residual_rest_length_jacobian", "node_residual", "rest_length"),
    ("tension_rest_length_derivative", "member_tension", "rest_length"),
    ("tension_jacobian", "member_tension", "coordinate"),
]


def product(derivative: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Return the derivative times the direction, of a diagonal one entry by entry."""
    return derivative * direction if derivative.ndim == 1 else derivative @ direction


@pytest.mark.parametrize(("derivative", "value", "argument"), TAYLOR)
@given(structure=structures(most_nodes=8), seed=st.integers(0, 2**32 - 1))
@SLOW
def test_they_leave_a_remainder_of_second_order(
    derivative: str, value: str, argument: str, structure: Structure, seed: int
) -> None:
    evaluator = Evaluator(structure, all_parameters(structure))
    if not offered_by(evaluator.model, derivative):
        return
    direction = draw_direction(evaluator, (argument,), seed)
    slope = product(evaluator(derivative), direction[argument])
    check_second_order(evaluator.along(value, direction), slope, largest_terms(structure), derivative)


@given(structures(most_nodes=8))
@SLOW
def test_constants_give_what_arguments_give(structure: Structure) -> None:
    baked, changeable = Evaluator(structure), Evaluator(structure, all_parameters(structure))
    for name in NEW:
        if offered_by(baked.model, name):
            scale = largest_terms(structure)
            np.testing.assert_allclose(baked(name), changeable(name), rtol=1e-14, atol=1e-14 * scale)


def test_no_mass_is_needed() -> None:
    structure = prism(anchored={0: "xyz"})
    bare = structure.with_changes(node_mass=0 * structure.node_mass, member_mass=0 * structure.member_mass)
    model = build_model(bare, ModelRequest(()))
    assert len(prune(model, NEW)) == 3
    with pytest.raises(FormulationError):
        model.expression("rest_length_jacobian")


@pytest.mark.parametrize("stiffness", ["spring_constant", "axial_stiffness"])
@pytest.mark.parametrize("change", [0.0, 0.07])
def test_one_member_in_closed_form_at_its_present_rest_length(stiffness: str, change: float) -> None:
    """dt/drho is -k, or -EA l / (rho0 + u)^2: inputs change the rest length that it is taken at."""
    values = {"mu": 50.0} if stiffness == "spring_constant" else {"mu": 0.0, "axial": 40.0}
    structure = make_structure([[0, 0, 0], [1.2, 0, 0]], [spring(0, 1, 0.8, **values)])
    structure = structure.with_changes(inputs=(ActuatedInput("motor", "rest_length", (0,), (0.0, 0.0, 0.0)),))
    rest = 0.8 + change
    slope = -50.0 if stiffness == "spring_constant" else -40.0 * 1.2 / rest**2
    along = 50.0 if stiffness == "spring_constant" else 40.0 / rest
    evaluator, u = Evaluator(structure), np.array([change])
    assert evaluator(NEW[1], input=u) == pytest.approx([slope], rel=1e-15)
    column = evaluator(NEW[0], input=u)[:, 0]
    assert column == pytest.approx([slope, 0, 0, -slope, 0, 0], rel=1e-15)
    assert evaluator(NEW[2], input=u)[0] == pytest.approx([-along, 0, 0, along, 0, 0], rel=1e-15)


def test_slack_cables_have_zeros() -> None:
    place = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]
    evaluator = Evaluator(make_structure(place, [spring(0, 1, 0.9), cable(1, 2, 1.1, damping=2.0)]))
    residual, tension, rows = (evaluator(name) for name in NEW)
    for values in (residual.T, tension[:, None], rows):
        assert values[0].any()
        assert not values[1].any()


@pytest.mark.parametrize("ratio", [0.3, 2.5])
@pytest.mark.parametrize("stiffness", ["spring_constant", "axial_stiffness"])
def test_bilinear_members_on_both_sides_of_their_switch(stiffness: str, ratio: float) -> None:
    structure = prism()
    switch = np.where(np.arange(structure.n_members) % 2, 0.5, 2.0) * (
        structure.member_length() - structure.rest_length
    )
    structure = with_law(structure, switch, ratio)
    if stiffness == "axial_stiffness":
        mu, rest = structure.spring_constant, structure.rest_length
        structure = structure.with_changes(spring_constant=0 * mu, axial_stiffness=mu * rest)
    evaluator = Evaluator(structure, {"rest_length": tuple(range(structure.n_members))})
    for derivative, value, argument in TAYLOR:
        direction = draw_direction(evaluator, (argument,), 5)
        slope = product(evaluator(derivative), direction[argument])
        along = evaluator.along(value, {argument: 0.01 * direction[argument]})
        check_second_order(along, 0.01 * slope, 1e3 * largest_terms(structure), derivative)


def test_tensions_of_node_distances_by_their_own_coordinates() -> None:
    structure = prism()
    structure = structure.with_changes(damping=np.full(structure.n_members, 3.0))
    model = build_model(structure, ModelRequest((), formulation="node_distance"))
    tension, jacobian = prune(model, ("member_tension", "tension_jacobian"))
    rng = np.random.default_rng(3)
    at = {name: item.nominal for name, item in model.arguments.items()}
    at["velocity"] = rng.uniform(-1, 1, at["velocity"].shape)
    direction = rng.uniform(-1, 1, at["coordinate"].shape)

    def along(h: float) -> np.ndarray:
        moved = {**at, "coordinate": at["coordinate"] + h * direction}
        return run_in_casadi(tension, {name: moved[name] for name in tension.arguments})

    slope = run_in_casadi(jacobian, {name: at[name] for name in jacobian.arguments}) @ direction
    check_second_order(along, slope, largest_terms(structure), "tension_jacobian")


@pytest.mark.parametrize(
    ("derivative", "value", "argument"), [(TAYLOR[0][0], "coordinate_force", "rest_length"), *TAYLOR[1:]]
)
def test_tendons_of_bodies(derivative: str, value: str, argument: str) -> None:
    system, _ = assemble_document(EVERYTHING)
    evaluate = BodyEvaluator(system, {"rest_length": tuple(range(system.n_members))})
    state = {**random_state(system, 13), "rest_length": system.rest_length}
    direction = np.random.default_rng(7).uniform(-1, 1, state[argument].shape)
    if value == "coordinate_force":
        state["velocity"] = 0 * state["velocity"]

    def along(h: float) -> np.ndarray:
        return evaluate(value, **{**state, argument: state[argument] + h * direction}).ravel()

    slope = product(evaluate(derivative, **state), direction)
    check_second_order(along, slope, np.abs(slope).max(), derivative)


@pytest.mark.thorough
def test_rigid_bars_have_zeros_and_all_emitters_give_the_same_bits() -> None:
    structure = prism(gravity=(0, 0, -9.81), anchored={0: "xyz"})
    rigid = structure.with_changes(spring_constant=np.where(structure.is_bar, 0.0, structure.spring_constant))
    for subject, formulation, emitters in (
        (rigid, "rigid_bar", ("unrolled", "table")),
        (structure, "node_position", ("unrolled", "table")),
    ):
        wanted = ModelRequest(NEW, formulation=formulation)
        models = [build_library(subject, replace(wanted, emitter=name)).load() for name in emitters]
        results = [[dense(model.compute(name)) for name in NEW] for model in models]
        for found in results[1:]:
            assert all(np.array_equal(a, b) for a, b in zip(found, results[0], strict=True))
        residual, tension, rows = results[0]
        is_zero = subject.is_bar if formulation == "rigid_bar" else np.zeros(subject.n_members, dtype=bool)
        assert np.array_equal(tension == 0, is_zero)
        assert np.array_equal(~residual.any(axis=0), is_zero)
        assert np.array_equal(~rows.any(axis=1), is_zero)
