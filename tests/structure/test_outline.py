"""Body systems as nodes and members, for tables and pictures."""

import numpy as np
import pytest

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.structure.kinematics import compute_node_position
from tensegrity_codegen.structure.outline import (
    compute_bar_distance,
    compute_segment_distance,
    hide_bodies,
    outline_bodies,
    outline_tendons,
)
from tests.body_scenes import EVERYTHING, assemble_document, example
from tests.models import load
from tests.rigid_scenes import HANGING
from tests.runtime.build import prism
from tests.scene.samples import build
from tests.segments import exact_distance


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


def test_random_segments() -> None:
    rng = np.random.default_rng(5)
    ends = rng.normal(size=(200, 4, 3))
    ends[50:100] = np.round(ends[50:100])  # many parallel, touching and crossing ones
    ends[100:120, 3] = ends[100:120, 2] + (ends[100:120, 1] - ends[100:120, 0])  # parallel
    ends[120:140, 2:] = ends[120:140, :2]  # the same
    found = compute_segment_distance(*np.moveaxis(ends, 1, 0))
    expected = [exact_distance(*(list(map(float, point)) for point in item)) for item in ends]
    np.testing.assert_allclose(found, expected, atol=1e-14)


@pytest.mark.parametrize("axes", ["xyz", "xz"])
def test_bars_of_nodes(axes: str) -> None:
    places = {"a": [0, 0], "b": [1, 0], "c": [0.2, 0.5], "d": [0.9, 0.3]}
    scene = {
        "name": "bars",
        "axes": axes,
        "classes": {"tube": {"kind": "bar", "spring_constant": 1e3, "radius": 0.02}},
        "nodes": {
            name: {"position": [x, 0.0, z], "mass": 1.0, "anchored": name in "ab"}
            for name, (x, z) in places.items()
        },
        "members": {
            "m1": {"class": "tube", "nodes": ["a", "b"]},
            "m2": {"class": "tube", "nodes": ["c", "d"]},
            "m3": {"class": "tube", "nodes": ["a", "c"]},
        },
    }
    pairs, distance = compute_bar_distance(build(scene)[0])
    assert pairs == (("m1", "m2"),)
    np.testing.assert_allclose(distance, [0.3 - 0.04])


def test_bars_that_are_bodies_as_in_the_generated_code() -> None:
    bodies = {
        name: {**body, "radius": 0.01} if body["kind"] == "bar" else body
        for name, body in EVERYTHING["bodies"].items()
    }
    system, _ = assemble_document({**EVERYTHING, "bodies": bodies})
    model = load(system, "bar_distance", formulation="bodies")
    pairs, distance = compute_bar_distance(system)
    assert pairs == model.manifest.bar_pair
    np.testing.assert_allclose(distance, model.compute("bar_distance"), atol=1e-13)


def test_texts_have_neither_corners_nor_edges_of_bodies() -> None:
    structure, _ = assemble(parse_scene({**HANGING, "limits": {"most_tension": 50.0}}))
    shown = hide_bodies(structure)
    assert shown.node_name == ("hook", "rod_top", "rod_foot", "block_eye")
    assert shown.member_name == ("line", "tie")
    np.testing.assert_array_equal(shown.connectivity, structure.connectivity[:2])
    np.testing.assert_array_equal(shown.limits.most_tension, [50.0, 50.0])
    assert structure.node_label[4:] == ("rod",) * 4 + ("block",) * 4
