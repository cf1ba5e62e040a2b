"""Mass matrix of nodes and uniform bars, and its inverse."""

from typing import Any

import casadi as ca
import numpy as np
import pytest

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.inertia import Inertia
from tensegrity_codegen.system.errors import FormulationError
from tests.runtime.build import bar, make_structure, spring

# A chain of two bars 0-1-2 with own mass, and node 3 on a spring.
POSITION = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]]
MEMBERS = [bar(0, 1, 1.0, mass=6.0), bar(2, 1, 1.0, mass=12.0), spring(2, 3, 1.0)]


def chain(**more: Any) -> Structure:
    return make_structure(POSITION, MEMBERS, **({"mass": [0.5, 0.0, 0.0, 2.0]} | more))


def inertia_of(structure: Structure) -> Inertia:
    return Inertia(structure, [ca.SX(float(mass)) for mass in structure.node_mass])


def numbers(expression: Any) -> np.ndarray:
    return np.array(ca.densify(ca.evalf(ca.SX(expression))))


def test_a_bar_gives_a_third_to_each_end_and_a_sixth_between() -> None:
    inertia = inertia_of(chain())
    expected = [[2.5, 1.0, 0.0], [1.0, 6.0, 2.0], [0.0, 2.0, 4.0]]
    np.testing.assert_allclose(numbers(inertia.matrix([0, 1, 2])), expected, rtol=1e-15)
    assert numbers(inertia.matrix([3])) == [[2.0]]


def test_nodes_that_no_bar_with_mass_joins_stay_apart() -> None:
    assert inertia_of(chain()).groups(0) == [[0, 1, 2], [3]]


def test_anchors_split_the_groups_axis_by_axis() -> None:
    inertia = inertia_of(chain(anchored={1: "x", 3: "xyz"}))
    assert inertia.groups(0) == [[0], [2]]
    assert inertia.groups(1) == [[0, 1, 2]]


@pytest.mark.parametrize("nodes", [[0, 1, 2], [0, 2], [3]])
def test_solve_and_inverse_undo_the_matrix(nodes: list[int]) -> None:
    inertia = inertia_of(chain())
    matrix = numbers(inertia.matrix(nodes))
    force = np.arange(1.0, len(nodes) + 1)
    solution = inertia.solve(nodes, [ca.SX(f) for f in force])
    np.testing.assert_allclose(
        numbers(ca.vertcat(*solution))[:, 0], np.linalg.solve(matrix, force), rtol=1e-14
    )
    np.testing.assert_allclose(numbers(inertia.inverse(nodes)) @ matrix, np.eye(len(nodes)), atol=1e-14)


def test_kinetic_energy_is_that_of_the_matrix() -> None:
    inertia = inertia_of(chain())
    velocity = np.arange(12.0).reshape(4, 3) - 4.0
    energy = numbers(inertia.kinetic_energy([[ca.SX(v) for v in row] for row in velocity]))
    matrix = numbers(inertia.matrix([0, 1, 2, 3]))
    assert energy[0, 0] == pytest.approx(0.5 * np.einsum("ia,ij,ja", velocity, matrix, velocity))


def test_a_bar_in_uniform_motion_has_the_energy_of_its_mass() -> None:
    structure = make_structure(POSITION[:2], [bar(0, 1, 1.0, mass=6.0)], mass=0.0)
    velocity = [[ca.SX(2.0), ca.SX(0.0), ca.SX(0.0)]] * 2
    assert numbers(inertia_of(structure).kinetic_energy(velocity))[0, 0] == pytest.approx(0.5 * 6.0 * 4.0)


def test_the_weight_of_a_bar_falls_half_on_each_end() -> None:
    masses = [numbers(mass)[0, 0] for mass in inertia_of(chain()).weight_mass()]
    assert masses == pytest.approx([3.5, 9.0, 6.0, 2.0])


def test_a_free_node_without_mass_is_named() -> None:
    structure = chain(mass=[0.0, 0.0, 0.0, 0.0])
    with pytest.raises(FormulationError) as caught:
        inertia_of(structure).check()
    assert "nodes.n3.mass" in caught.value.where
    assert caught.value.given == "no mass at n3"
    inertia_of(chain(mass=[0.0, 0.0, 0.0, 0.0], anchored={3: "xyz"})).check()


def test_a_run_time_mass_counts_as_mass() -> None:
    structure = chain(mass=[0.0, 0.0, 0.0, 0.0])
    Inertia(structure, [ca.SX(0.0), ca.SX(0.0), ca.SX(0.0), ca.SX.sym("m")]).check()
