"""Body systems as nodes and members, for tables and pictures."""

import numpy as np

from tensegrity_codegen.structure.kinematics import compute_node_position
from tensegrity_codegen.structure.outline import outline_bodies, outline_tendons
from tests.body_scenes import EVERYTHING, assemble_document, example
from tests.runtime.build import prism


def test_tendons_stay_and_bodies_come_after_them() -> None:
    tower = example("svd_tower")
    drawn = outline_bodies(tower)
    assert drawn.member_name[:18] == tower.member_name
    assert drawn.member_name[18:24] == tuple(body.name for body in tower.bodies[1:7])
    assert drawn.member_name[24:] == ("top_edge1", "top_edge2", "top_edge3")
    np.testing.assert_allclose(drawn.member_length()[18:24], 1.0)
    np.testing.assert_allclose(drawn.member_length()[24:], 2 / 3)
    assert drawn.is_bar[18:].all()
    np.testing.assert_array_equal(drawn.node_position, compute_node_position(tower))


def test_points_of_fixed_bodies_are_anchored() -> None:
    system, _ = assemble_document(EVERYTHING)
    drawn = outline_tendons(system)
    held = [name for name, row in zip(drawn.node_name, drawn.node_anchored, strict=True) if row.all()]
    assert held == ["ground_a", "ground_b"]


def test_tensions_at_the_start_are_those_of_the_laws() -> None:
    tower = example("svd_tower")
    np.testing.assert_allclose(
        outline_bodies(tower).static_tension()[[0, 6, 12, 20]], [26.109, 1.850, 18.378, 0], atol=6e-4
    )


def test_a_structure_is_its_own_outline() -> None:
    structure = prism()
    assert outline_bodies(structure) is structure
