"""From coordinates to nodes, for models in node coordinates and in others."""

import numpy as np
import pytest

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import NODE_QUANTITIES, place_nodes, place_velocities
from tensegrity_codegen.runtime.trajectory.simulation_quantities import simulation_quantities
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import UnknownNameError
from tests.models import load
from tests.reference import ReferenceModel
from tests.runtime.build import make_structure, prism, spring


def planar() -> Structure:
    position = [[0, 7, 0], [1, 7, 0], [0.5, 7, 1]]
    members = [spring(0, 1, 0.9), spring(0, 2, 1.0), spring(1, 2, 1.0)]
    structure = make_structure(position, members, anchored={0: "xz"}, axes="xz", mass=[1, 2, 3])
    return structure.with_changes(node_velocity=np.array([[0, 0, 0], [1, 0, 2], [-1, 0, 0.5]], dtype=float))


def build(structure: Structure, *quantities: str, **parameters: tuple[int, ...]) -> CompiledModel:
    return load(structure, *quantities, parameters=parameters, formulation="node_distance")


def test_node_coordinates_are_placed_by_the_manifest() -> None:
    structure = planar()
    model = ReferenceModel(structure)
    found = place_nodes(model, np.array([1.0, 2.0, 3.0, 4.0]))
    np.testing.assert_array_equal(found, [[0, 7, 0], [1, 7, 2], [3, 7, 4]])
    found = place_velocities(model, np.zeros(4), np.array([1.0, 2.0, 3.0, 4.0]))
    np.testing.assert_array_equal(found, [[0, 0, 0], [1, 0, 2], [3, 0, 4]])


def test_other_coordinates_are_placed_by_the_model_and_dropped_axes_stay() -> None:
    structure = planar()
    model = build(structure, *NODE_QUANTITIES)
    q, v = model.nominal("coordinate"), model.nominal("velocity")
    assert q.shape == (6,)
    np.testing.assert_allclose(place_nodes(model, q), structure.node_position, atol=1e-15)
    np.testing.assert_allclose(place_velocities(model, q, v), structure.node_velocity, atol=1e-15)


def test_masses_at_run_time_move_the_nodes_about_their_centre() -> None:
    structure = prism().with_changes(node_anchored=np.zeros((6, 3), dtype=bool))
    model = build(structure, *NODE_QUANTITIES, node_mass=(0,))
    q = model.nominal("coordinate")
    heavier = place_nodes(model, q, arguments={"node_mass": np.array([5.0])})
    shift = heavier - structure.node_position
    np.testing.assert_allclose(shift, np.broadcast_to(shift[0], shift.shape), atol=1e-14)
    mass = np.array([5.0, *structure.node_mass[1:]])
    centre = mass @ heavier / mass.sum()
    np.testing.assert_allclose(centre, q[-3:], atol=1e-14)


def test_a_model_that_cannot_place_its_nodes_says_so() -> None:
    model = build(planar(), "member_length")
    with pytest.raises(UnknownNameError, match="does not compute this quantity"):
        place_nodes(model, model.nominal("coordinate"))


def test_simulations_ask_for_what_places_nodes_where_it_is_needed() -> None:
    assert not set(NODE_QUANTITIES) & set(simulation_quantities("node_position"))
    assert set(NODE_QUANTITIES) <= set(simulation_quantities("node_distance"))
