"""Run-time arguments are symbols, all else folds into numbers."""

from typing import Any

import casadi as ca
import numpy as np
import pytest

from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.symbolic.arguments import SymbolicArguments
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.quantities import ARGUMENTS
from tests.runtime.build import make_structure, spring

INPUTS = (ActuatedInput("pull", "rest_length", (0, 1)), ActuatedInput("push", "force", (1,), (0.0, 0.6, 0.8)))


def planar(**more: Any) -> Structure:
    position = [[0, 5, 0], [1, 5, 0], [2, 5, 1]]
    return make_structure(
        position, [spring(0, 1, 0.9), spring(1, 2, 1.1)], axes="xz", anchored={0: "xz", 2: "x"}, **more
    )


def arguments_of(structure: Structure, **parameters: tuple[int, ...]) -> SymbolicArguments:
    return SymbolicArguments(structure, parameters)


def test_without_parameters_only_the_state_is_symbolic() -> None:
    found = arguments_of(planar(load={1: (1, 0, 2)}, gravity=(0, 0, -9.8)))
    assert {name: item.symbol.shape for name, item in found.ordered().items()} == {
        "coordinate": (3, 1),
        "velocity": (3, 1),
        "input": (0, 1),
    }
    assert [float(g) for g in found.gravity] == [0.0, -9.8]
    assert [float(f) for f in found.node_load[1]] == [1.0, 2.0]
    assert [float(rho) for rho in found.rest_length] == [0.9, 1.1]
    assert found.parameter_symbols().shape == (0, 1)


def test_anchored_coordinates_are_numbers_and_free_ones_symbols() -> None:
    found = arguments_of(planar())
    free = [[component.is_constant() for component in row] for row in found.position]
    assert free == [[True, True], [False, False], [True, False]]
    assert float(found.position[2][0]) == 2.0
    assert float(found.velocity[2][0]) == 0.0
    coordinate = found.ordered()["coordinate"]
    assert coordinate.nominal.tolist() == [1.0, 0.0, 1.0]
    assert ca.is_equal(found.position[2][1], coordinate.symbol[2])


def test_chosen_values_become_symbols_in_the_given_order() -> None:
    found = arguments_of(planar(), rest_length=(1,), node_mass=(2, 0))
    assert [rho.is_constant() for rho in found.rest_length] == [True, False]
    assert ca.is_equal(found.node_mass[0], found.symbols["node_mass"][1])
    ordered = found.ordered()
    assert ordered["node_mass"].over == ("n2", "n0")
    assert ordered["rest_length"].nominal.tolist() == [1.1]


def test_vectors_have_one_row_a_node_in_c_order() -> None:
    found = arguments_of(planar(load={1: (1, 0, 2), 2: (3, 0, 4)}), node_load=(1, 2), anchor_position=(0,))
    load = found.ordered()["node_load"]
    assert load.nominal.tolist() == [[1.0, 2.0], [3.0, 4.0]]
    assert load.symbol.shape == (2, 2)
    assert ca.is_equal(found.node_load[2][0], ca.vec(load.symbol)[2])
    assert ca.is_equal(found.position[0][1], found.symbols["anchor_position"][1])


def test_a_moved_anchor_leaves_the_free_axis_to_the_coordinate() -> None:
    found = arguments_of(planar(), anchor_position=(2,))
    assert ca.is_equal(found.position[2][0], found.symbols["anchor_position"][0])
    assert ca.is_equal(found.position[2][1], found.symbols["coordinate"][2])


def test_arguments_come_in_the_order_of_the_table() -> None:
    found = arguments_of(planar(), gravity=(), damping=(0,), rest_length=(0,), node_load=(1,))
    assert list(found.ordered()) == [name for name in ARGUMENTS if name in found.ordered()]
    stacked = found.parameter_symbols()
    names = ["rest_length", "damping", "node_load", "gravity"]
    assert ca.is_equal(stacked, ca.vertcat(*[ca.vec(found.symbols[name]) for name in names]), 1)


def test_inputs_act_on_rest_lengths_and_loads() -> None:
    found = arguments_of(planar(inputs=INPUTS))
    u = found.symbols["input"]
    values = ca.Function("f", [u], [*found.rest_length, *found.node_load[1]])([0.1, 10.0])
    np.testing.assert_allclose([float(v) for v in values], [1.0, 1.2, 0.0, 8.0])
    assert found.ordered()["input"].over == ("pull", "push")


@pytest.mark.parametrize("name", ["rest_lenght", "coordinate", "input"])
def test_an_unknown_parameter_is_refused(name: str) -> None:
    with pytest.raises(FormulationError) as caught:
        arguments_of(planar(), **{name: (0,)})
    assert caught.value.given == name
    assert caught.value.hint
