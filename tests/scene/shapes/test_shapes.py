"""Shapes: geometry, self-stress and mechanism counts against known values."""

import math
from collections import Counter

import numpy as np
import pytest

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.scene.shapes import expand_shape
from tensegrity_codegen.scene.shapes.prism import PrismShape
from tensegrity_codegen.scene.shapes.selfstress import equilibrium_matrix
from tensegrity_codegen.system.errors import InvalidValueError, StructureError, UnknownKeyError

PRISM = {"kind": "prism", "bottom_radius": 1.0, "height": 2.0}
TOWER = {"kind": "tower", "stages": 3, "radius": 1.0, "height": 2.0}
BALL = {"kind": "icosahedron", "bar_length": 1.0}


def arrays(document):
    index = {name: i for i, name in enumerate(document["nodes"])}
    points = np.array([node["position"] for node in document["nodes"].values()])
    pairs = np.array([[index[n] for n in member["nodes"]] for member in document["members"].values()])
    tension = np.array([member.get("prestress", 0.0) for member in document["members"].values()])
    return points, pairs, tension


def counts(document):
    """Return (self-stress modes, mechanisms) of the free structure by the rank of its equilibrium matrix."""
    points, pairs, _ = arrays(document)
    rank = np.linalg.matrix_rank(equilibrium_matrix(points, pairs), tol=1e-9)
    return len(pairs) - rank, 3 * len(points) - 6 - rank


def lengths(document):
    points, pairs, _ = arrays(document)
    return dict(
        zip(
            document["members"],
            np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1),
            strict=True,
        )
    )


def assert_selfstressed(document, largest):
    points, pairs, tension = arrays(document)
    residual = np.abs(equilibrium_matrix(points, pairs) @ tension).max()
    cables = [document["members"][name]["prestress"] for name in document["groups"]["cables"]]
    assert residual < 1e-11 * largest
    assert min(cables) > 0
    assert max(cables) == pytest.approx(largest)
    assert max(document["members"][name]["prestress"] for name in document["groups"]["bars"]) < 0


@pytest.mark.parametrize("bars", [3, 4, 5, 6, 9])
def test_prism_default_twist_has_one_selfstress(bars):
    document = expand_shape(PRISM | {"bars": bars, "top_radius": 0.6, "prestress": 7.0})
    assert counts(document) == (1, 2 * bars - 5)
    assert_selfstressed(document, 7.0)


def test_prism_geometry():
    document = expand_shape(PRISM | {"twist": 150.0, "anchor_bottom": True, "node_mass": 0.1})
    nodes = document["nodes"]
    assert list(nodes) == ["b1", "b2", "b3", "t1", "t2", "t3"]
    assert nodes["b1"] == {"position": [1.0, 0.0, 0.0], "mass": 0.1, "anchored": True}
    assert nodes["t1"]["position"] == pytest.approx([-math.sqrt(3) / 2, 0.5, 2.0])
    assert "anchored" not in nodes["t1"]
    length = lengths(document)
    assert length["bottom1"] == pytest.approx(math.sqrt(3))
    assert length["bar1"] == pytest.approx(math.sqrt(2 - 2 * math.cos(math.radians(150)) + 4))
    assert length["vertical1"] == pytest.approx(math.sqrt(2 - 2 * math.cos(math.radians(30)) + 4))
    assert document["groups"]["vertical_cables"] == ["vertical1", "vertical2", "vertical3"]


def test_negative_twist_is_the_mirror_image():
    right, left = (arrays(expand_shape(PRISM | {"twist": twist}))[0] for twist in (150.0, -150.0))
    assert np.allclose(right * (1, -1, 1), left, atol=1e-15)


def test_prestress_needs_a_geometry_with_selfstress():
    with pytest.raises(StructureError, match="0 independent self-stresses") as caught:
        expand_shape(PRISM | {"twist": 140.0, "prestress": 1.0})
    assert "equilibrium" in caught.value.hint
    assert caught.value.where == "shape.prestress"


def test_prism_class_names_and_partial_anchor():
    document = expand_shape(PrismShape(bottom_radius=1, height=1, top_class="crown", anchor_bottom="xz"))
    assert document["members"]["top2"]["class"] == "crown"
    assert document["members"]["bottom2"]["class"] == "cable"
    assert document["nodes"]["b3"]["anchored"] == "xz"


def test_icosahedron_is_in_selfstress():
    document = expand_shape(BALL | {"prestress": 10.0})
    assert counts(document) == (1, 1)
    assert_selfstressed(document, 10.0)
    length = lengths(document)
    assert [length[f"bar{i}"] for i in range(1, 7)] == pytest.approx([1.0] * 6)
    assert [length[f"cable{i}"] for i in range(1, 25)] == pytest.approx([math.sqrt(3 / 8)] * 24)
    met = Counter(node for member in document["members"].values() for node in member["nodes"])
    assert set(met.values()) == {5}
    # cables and bars in equilibrium: bar force = sqrt(6) times the cable tension
    assert document["members"]["bar1"]["prestress"] == pytest.approx(-10 * math.sqrt(6))


@pytest.mark.parametrize("stages", [1, 2, 3, 5])
@pytest.mark.parametrize("bars", [3, 4])
def test_tower_is_class_one_and_connected(stages, bars):
    document = expand_shape(TOWER | {"stages": stages, "bars": bars})
    ends = [n for name in document["groups"]["bars"] for n in document["members"][name]["nodes"]]
    assert sorted(ends) == sorted(document["nodes"])  # every node on exactly one bar
    assert len(document["members"]) == 6 * bars * stages - 2 * bars
    pairs = Counter(frozenset(member["nodes"]) for member in document["members"].values())
    assert max(pairs.values()) == 1
    reached, todo = set(), ["b1_1"]
    neighbours = {name: set() for name in document["nodes"]}
    for first, second in (member["nodes"] for member in document["members"].values()):
        neighbours[first].add(second)
        neighbours[second].add(first)
    while todo:
        node = todo.pop()
        reached.add(node)
        todo += neighbours[node] - reached
    assert reached == set(document["nodes"])


def test_tower_counts_at_the_default_parameters():
    assert counts(expand_shape(TOWER | {"stages": 1})) == (1, 1)
    assert counts(expand_shape(TOWER | {"stages": 2})) == (0, 0)
    assert counts(expand_shape(TOWER | {"overlap": 0.0})) == (1, 1)


@pytest.mark.parametrize("stages", [1, 2, 3, 6])
def test_tower_prestress_finds_the_twist(stages):
    document = expand_shape(TOWER | {"stages": stages, "prestress": 5.0})
    assert counts(document) == (1, 1)
    assert_selfstressed(document, 5.0)


def test_two_stage_tower_diagonals_follow_the_overlap():
    # in the two-stage tower the diagonal's force density is overlap / (1 - overlap) of the saddle's
    document = expand_shape(TOWER | {"stages": 2, "overlap": 0.3, "prestress": 5.0})
    length, members = lengths(document), document["members"]
    density = {name: members[name]["prestress"] / length[name] for name in ("saddle1_1", "diagonal1_1")}
    assert density["diagonal1_1"] / density["saddle1_1"] == pytest.approx(0.3 / 0.7)


def test_tower_without_overlap_refuses_prestress():
    with pytest.raises(StructureError, match="no twist was found"):
        expand_shape(TOWER | {"overlap": 0.0, "prestress": 1.0})


def test_tower_of_a_thousand_stages():
    document = expand_shape(TOWER | {"stages": 1000})
    assert len(document["nodes"]) == 6000
    assert len(document["members"]) == 17994


def test_prestress_of_a_huge_shape_is_refused():
    with pytest.raises(StructureError, match="too many members"):
        expand_shape(PRISM | {"bars": 900, "prestress": 1.0})


def test_two_nodes():
    document = expand_shape({"kind": "two_nodes", "length": 2.0, "along": "-z", "node_mass": 1.0})
    assert document["nodes"]["n2"] == {"position": [0.0, 0.0, -2.0], "mass": 1.0}
    assert document["nodes"]["n1"]["anchored"] is True
    assert document["members"] == {"member1": {"class": "cable", "nodes": ["n1", "n2"]}}


@pytest.mark.parametrize(
    ("shape", "error", "text"),
    [
        ({"kind": "prizm"}, InvalidValueError, "prizm"),
        ({}, InvalidValueError, "kind"),
        (PRISM | {"hight": 1.0}, UnknownKeyError, "height"),
        (PRISM | {"height": -1.0}, InvalidValueError, "greater than 0"),
        (PRISM | {"height": math.nan}, InvalidValueError, "shape.height"),
        (PRISM | {"bars": 2}, InvalidValueError, "shape.bars"),
        (PRISM | {"bar_class": "a;b"}, InvalidValueError, "shape.bar_class"),
        (TOWER | {"overlap": 1.0}, InvalidValueError, "less than 1"),
    ],
)
def test_bad_shapes(shape, error, text):
    with pytest.raises(error) as caught:
        expand_shape(shape)
    assert text in str(caught.value)


@pytest.mark.parametrize("shape", [PRISM, TOWER, BALL])
def test_prestressed_shapes_assemble_into_equilibrium(shape):
    scene = {
        "name": "s",
        "classes": {
            "bar": {"kind": "bar", "axial_stiffness": 1e5},
            "cable": {"kind": "cable", "spring_constant": 200.0},
        },
        "shape": shape | {"prestress": 5.0, "node_mass": 0.1},
    }
    structure, _ = assemble(parse_scene(scene))
    length = structure.member_length()
    constant = structure.spring_constant + structure.axial_stiffness / structure.rest_length
    tension = constant * (length - structure.rest_length)
    matrix = equilibrium_matrix(structure.node_position, structure.connectivity)
    assert np.abs(matrix @ tension).max() < 1e-9 * np.abs(tension).max()
    assert tension[~structure.is_bar].max() == pytest.approx(5.0)


OPPOSITE = {
    "kind": "prism",
    "bottom_radius": 0.15,
    "height": 0.3,
    "opposite_class": "cable",
    "prestress": 20.0,
}


@pytest.mark.parametrize("bars", [3, 4, 5, 6])
@pytest.mark.parametrize("side", [-1, 1])
def test_a_prism_with_opposite_cables_has_prestress_between_two_twists(bars: int, side: int) -> None:
    first, last = 90 + 180 / bars, 270 - 180 / bars
    for twist in (first + 0.01, (first + 2 * last) / 3, last - 0.01):
        document = expand_shape({**OPPOSITE, "bars": bars, "twist": side * twist})
        tension = {name: member["prestress"] for name, member in document["members"].items()}
        cables = [value for name, value in tension.items() if not name.startswith("bar")]
        assert (len(cables), max(cables)) == (4 * bars, pytest.approx(20.0))
        assert min(cables) > 0
        check_balance(document)
    for twist in (first - 0.01, first, last, last + 0.01):
        with pytest.raises(StructureError, match="slack or without tension") as caught:
            expand_shape({**OPPOSITE, "bars": bars, "twist": side * twist})
        assert f"between {first:g} and {last:g} deg" in caught.value.hint


def test_opposite_cables_mirror_the_verticals_and_have_a_group() -> None:
    document = expand_shape({**OPPOSITE, "twist": 155, "top_radius": 0.1})
    assert document["members"]["opposite1"]["nodes"] == ["b1", "t2"]
    assert document["members"]["vertical1"]["nodes"] == ["b1", "t3"]
    assert document["groups"]["opposite_cables"] == ["opposite1", "opposite2", "opposite3"]
    mirrored = expand_shape({**OPPOSITE, "twist": 205, "top_radius": 0.1})
    for one, other in (("opposite", "vertical"), ("bar", "bar"), ("top", "top"), ("bottom", "bottom")):
        values = [
            doc["members"][f"{name}1"]["prestress"] for doc, name in ((document, one), (mirrored, other))
        ]
        assert values[0] == pytest.approx(values[1], rel=1e-11)
    check_balance(document)


def test_a_twist_is_required_with_opposite_cables() -> None:
    with pytest.raises(InvalidValueError, match="no default twist") as caught:
        expand_shape(OPPOSITE)
    assert caught.value.where == "shape.twist"


def check_balance(document):
    """Check that the stated tensions balance at every node."""
    position = {name: np.array(node["position"]) for name, node in document["nodes"].items()}
    force = {name: np.zeros(3) for name in position}
    for member in document["members"].values():
        first, second = member["nodes"]
        vector = position[second] - position[first]
        pull = member["prestress"] * vector / np.linalg.norm(vector)
        force[first] += pull
        force[second] -= pull
    np.testing.assert_allclose(list(force.values()), 0.0, atol=1e-10)
