"""The reference itself, against finite differences and balances that hold for every structure."""

import numpy as np
import pytest
from hypothesis import given

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.tables.quantities import PARAMETERS
from tensegrity_codegen.tables.quantities.members import MEMBER_QUANTITIES
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import draws
from tests.random_structures import structures
from tests.reference import ReferenceModel

few = draws(5)


def differences(model, quantity, argument, step=1e-6):
    """Central differences of `quantity` along every entry of `argument`, one column an entry."""
    at = model.nominal(argument)
    columns = []
    for index in np.ndindex(at.shape):
        more, less = at.copy(), at.copy()
        more[index] += step
        less[index] -= step
        up, down = (np.ravel(model.compute(quantity, **{argument: value})) for value in (more, less))
        columns.append((up - down) / (2 * step))
    return np.array(columns).T


def close(found, expected):
    scale = max(1.0, np.abs(expected).max(initial=0))
    np.testing.assert_allclose(found, expected, atol=2e-6 * scale, rtol=0)


@few
@given(structures(most_nodes=8))
def test_every_quantity_has_the_shape_of_the_table(structure: Structure) -> None:
    model = ReferenceModel(structure)
    for function in model.manifest.functions:
        assert np.shape(model.compute(function.quantity)) == function.shape
        assert model.has(function.quantity)
    of_sections = {quantity.name for quantity in MEMBER_QUANTITIES if quantity.needs_section}
    assert {function.quantity for function in model.manifest.functions} == (
        set(build_model(structure, ModelRequest(())).quantities) - of_sections
    )


@few
@given(structures(most_nodes=8))
def test_force_and_stiffness_are_derivatives_of_the_energy(structure: Structure) -> None:
    model = ReferenceModel(structure)
    close(-differences(model, "potential_energy", "coordinate")[0], model.compute("node_residual"))
    close(-differences(model, "node_residual", "coordinate"), model.compute("tangent_stiffness").toarray())


@pytest.mark.thorough
@few
@given(structures(most_nodes=6))
def test_jacobians_are_derivatives(structure: Structure) -> None:
    model = ReferenceModel(structure)
    to_state = [differences(model, "state_derivative", name) for name in ("coordinate", "velocity")]
    close(np.hstack(to_state), model.compute("state_jacobian").toarray())
    if structure.inputs:
        close(differences(model, "state_derivative", "input"), model.compute("input_jacobian").toarray())
    there = {item.name for item in model.manifest.arguments}
    parameters = [name for name in PARAMETERS if name in there]
    to_parameters = np.hstack([differences(model, "state_derivative", name) for name in parameters])
    close(to_parameters, model.compute("parameter_jacobian").toarray())
    rest_length = differences(model, "state_derivative", "rest_length")
    close(rest_length, model.compute("rest_length_jacobian").toarray())
    damping = -differences(model, "node_force", "velocity")
    close(damping[model.free], model.compute("damping_matrix").toarray())


@few
@given(structures())
def test_equilibrium_matrix_and_reactions_balance_the_forces(structure: Structure) -> None:
    model = ReferenceModel(structure)
    still = {"velocity": np.zeros(int(model.free.sum()))}
    force = model.compute("node_force", **still).ravel()
    close(model.compute("node_residual"), force[model.free])
    close(model.compute("support_reaction"), -force[~model.free])
    slack_free = model.compute(
        "node_force",
        spring_constant=np.zeros(structure.n_members),
        **still,
        axial_stiffness=np.zeros(structure.n_members),
    ).ravel()
    tension = model.compute("member_tension", **still)
    close(slack_free[model.free] - model.compute("equilibrium_matrix") @ tension, force[model.free])


def test_two_node_bar_by_hand() -> None:
    """Bar along x, mass 6 kg, 2 m long, rest 1.9 m, EA = 190 N: tension 10 N, H = [2 1; 1 2] kron I."""
    structure = Structure(
        name="bar",
        axes=(0, 2),
        node_name=("a", "b"),
        node_position=np.array([[0.0, 0, 0], [2.0, 0, 0]]),
        node_velocity=np.zeros((2, 3)),
        node_mass=np.zeros(2),
        node_anchored=np.zeros((2, 3), dtype=bool),
        node_load=np.zeros((2, 3)),
        gravity=np.array([0, 0, -10.0]),
        member_name=("e",),
        member_class=("bar",),
        connectivity=np.array([[0, 1]]),
        is_bar=np.array([True]),
        tension_only=np.array([False]),
        rest_length=np.array([1.9]),
        spring_constant=np.zeros(1),
        axial_stiffness=np.array([190.0]),
        damping=np.array([3.0]),
        member_mass=np.array([6.0]),
        radius=np.zeros(1),
    )
    model = ReferenceModel(structure)
    assert model.compute("member_tension") == pytest.approx([10.0])
    expected = np.kron([[2.0, 1.0], [1.0, 2.0]], np.eye(2))
    np.testing.assert_allclose(model.compute("mass_matrix").toarray(), expected)
    np.testing.assert_allclose(model.compute("node_force"), [[10, -30], [-10, -30]], atol=1e-12)
    np.testing.assert_allclose(model.compute("acceleration"), [10, -10, -10, -10], atol=1e-12)
    moving = model.compute("member_tension", velocity=[0.0, 0, 2.0, 0])
    assert moving == pytest.approx([16.0])
