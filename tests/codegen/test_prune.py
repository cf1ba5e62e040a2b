"""Only what matters to a quantity is an argument of its function."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.codegen.emitter import PrunedFunction, prune
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.system.errors import FormulationError, UnknownNameError
from tensegrity_codegen.tables.request import ModelRequest
from tests.runtime.build import bar, cable, make_structure, prism, spring


def pruned(structure: Structure, quantity: str, **parameters: tuple[int, ...]) -> PrunedFunction:
    model = build_model(structure, ModelRequest((), parameters=parameters))
    return prune(model, (quantity,))[0]


def pair(**more: Any) -> Structure:
    return make_structure([[0, 0, 0], [1, 0, 0]], [spring(0, 1, 0.9, **more)])


def test_without_damping_the_acceleration_has_no_velocity() -> None:
    assert pruned(pair(), "acceleration").arguments == ("coordinate",)


def test_damping_brings_the_velocity_in() -> None:
    assert pruned(pair(damping=0.1), "acceleration").arguments == ("coordinate", "velocity")
    assert pruned(pair(), "acceleration", damping=(0,)).arguments == ("coordinate", "velocity", "damping")


def test_static_quantities_never_have_a_velocity() -> None:
    for quantity in ("node_residual", "tangent_stiffness", "potential_energy"):
        assert pruned(pair(damping=0.1), quantity).arguments == ("coordinate",)


def test_baked_in_gravity_is_no_argument_and_changeable_gravity_is_one() -> None:
    structure = prism(gravity=(0, 0, -9.81))
    assert pruned(structure, "acceleration").arguments == ("coordinate",)
    assert pruned(structure, "acceleration", gravity=()).arguments == ("coordinate", "gravity")
    assert pruned(structure, "member_tension", gravity=()).arguments == ("coordinate",)


def test_absent_gravity_costs_nothing() -> None:
    without, with_it = prism(), prism(gravity=(0, 0, -9.81))
    saved = pruned(with_it, "acceleration").operations - pruned(without, "acceleration").operations
    assert saved >= 6  # one addition a node, along z
    changeable = pruned(without, "acceleration", gravity=())
    assert changeable.operations > pruned(without, "acceleration").operations


def test_anchored_coordinates_are_not_in_the_state() -> None:
    free, held = prism(), prism(anchored={0: "xyz", 1: "z"})
    assert pruned(free, "acceleration").function.size1_in(0) == 18
    found = pruned(held, "acceleration")
    assert found.function.size1_in(0) == 14
    assert found.sparsity.shape == (14, 1)
    assert found.operations < pruned(free, "acceleration").operations


def test_a_planar_structure_has_two_axes() -> None:
    members = [spring(0, 1, 0.9)]
    planar = make_structure([[0, 0, 0], [1, 0, 0]], members, axes="xz")
    assert pruned(planar, "member_vector").sparsity.shape == (2, 1)
    assert pruned(planar, "member_length").operations < pruned(pair(), "member_length").operations


def test_two_sided_springs_have_no_branch() -> None:
    two_sided = pruned(pair(), "member_tension")
    members = [cable(0, 1, 0.9)]
    one_sided = pruned(make_structure([[0, 0, 0], [1, 0, 0]], members), "member_tension")
    assert one_sided.operations == two_sided.operations + 3  # a comparison, a choice, and a length above 0


def test_a_constant_matrix_has_no_argument() -> None:
    found = pruned(pair(), "mass_matrix")
    assert found.arguments == ()
    assert found.operations == 0
    np.testing.assert_array_equal(np.array(found.function()["mass_matrix"]), np.eye(6))


def test_an_input_is_an_argument_only_where_it_acts() -> None:
    structure = pair().with_changes(inputs=(ActuatedInput("push", "force", (1,), (1.0, 0.0, 0.0)),))
    assert pruned(structure, "acceleration").arguments == ("coordinate", "input")
    assert pruned(structure, "member_tension").arguments == ("coordinate",)


def test_a_result_is_dense_unless_its_table_says_sparse() -> None:
    structure = make_structure(
        [[0, 0, 0], [1, 0, 0], [2, 0, 0]], [bar(0, 1, 1.0, mass=1.0), spring(1, 2, 1.0)]
    )
    assert pruned(structure, "acceleration").sparsity.is_dense()
    assert not pruned(structure, "mass_matrix").sparsity.is_dense()


@pytest.mark.parametrize("quantity", ["damping_matrix", "input_jacobian", "support_reaction"])
def test_an_empty_quantity_is_refused(quantity: str) -> None:
    with pytest.raises(FormulationError) as caught:
        pruned(pair(), quantity)
    assert caught.value.given == quantity
    assert "empty" in caught.value.problem
    assert "small" in caught.value.where


def test_a_jacobian_to_no_parameters_says_how_to_get_some() -> None:
    with pytest.raises(FormulationError) as caught:
        pruned(pair(), "parameter_jacobian")
    assert "[parameters]" in caught.value.hint


def test_an_unknown_quantity_suggests_the_closest() -> None:
    with pytest.raises(UnknownNameError) as caught:
        pruned(pair(), "member_tensions")
    assert "'member_tension'" in caught.value.hint
