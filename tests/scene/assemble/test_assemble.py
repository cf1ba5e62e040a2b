import time

import numpy as np
import pytest

from tensegrity_codegen.scene.assemble.assemble import DEFAULT_QUANTITIES, MASSLESS_QUANTITIES
from tensegrity_codegen.scene.checks.check import check_structure
from tensegrity_codegen.system.errors import DuplicateNameError, StructureError, UnknownNameError
from tests.scene.samples import ARCH, REMOVE, WHERE, build, changed

PRISM = {
    "name": "prism",
    "classes": {
        "bar": {"kind": "bar", "axial_stiffness": 1e5, "mass": 0.1},
        "cable": {"kind": "cable", "spring_constant": 100},
    },
    "shape": {"kind": "prism", "bottom_radius": 0.2, "height": 0.4, "anchor_bottom": True},
}


def test_the_arch():
    structure, request = build(ARCH)
    assert structure.name == "arch"
    assert structure.axes == (0, 1, 2)
    assert structure.node_name == ("a", "b", "c")
    assert structure.member_name == ("ac", "bc", "ab")
    assert structure.member_class == ("strut", "string", "string")
    assert structure.connectivity.tolist() == [[0, 2], [1, 2], [0, 1]]
    assert structure.gravity.tolist() == [0, 0, -9.81]
    assert structure.groups == {"strings": (1, 2)}
    assert structure.spring_constant.tolist() == [0, 100, 100]
    assert structure.axial_stiffness.tolist() == [2e5, 0, 0]
    assert structure.member_mass.tolist() == [0.1, 0, 0]
    assert structure.coordinate_node_axis.tolist() == [[1, 1], [2, 0], [2, 1], [2, 2]]
    assert request.formulation == "node_position"
    assert request.emitter == "auto"
    check_structure(structure)


def test_the_request():
    model = {"quantities": ["member_tension", "node_force", "member_tension"], "integrators": ["rk4", "rk4"]}
    _, request = build(changed("model", to=model))
    assert request.quantities == ("member_tension", "node_force")
    assert request.integrators == ("rk4",)


def test_default_quantities_ask_for_motion_only_where_there_is_mass():
    massive = changed("nodes", "b", "anchored", to=True)
    assert build(massive)[1].quantities == DEFAULT_QUANTITIES
    massive["nodes"]["c"].pop("mass")
    assert build(massive)[1].quantities == DEFAULT_QUANTITIES  # the strut's mass
    massive["classes"]["strut"].pop("mass")
    assert build(massive)[1].quantities == ("member_tension", *MASSLESS_QUANTITIES)


def test_a_shape_and_additions():
    document = {
        **PRISM,
        "nodes": {"top": {"position": [0, 0, 1], "mass": 1}},
        "members": {f"stay{i}": {"class": "cable", "nodes": [f"t{i}", "top"]} for i in (1, 2, 3)},
        "groups": {"stays": ["stay1", "stay2", "stay3"]},
    }
    structure, _ = build(document)
    assert structure.n_nodes == 7
    assert structure.n_members == 15
    assert structure.node_name[-1] == "top"
    assert structure.groups["stays"] == (12, 13, 14)


@pytest.mark.parametrize(
    ("section", "name", "value"),
    [
        ("nodes", "t1", {"position": [0, 0, 1]}),
        ("members", "bar1", {"class": "bar", "nodes": ["b1", "t2"]}),
        ("groups", "bars", ["bar1"]),
    ],
)
def test_names_that_the_shape_makes_too(section, name, value):
    with pytest.raises(DuplicateNameError) as caught:
        build({**PRISM, section: {name: value}})
    assert caught.value.where == f"{WHERE}: {section}.{name}"
    assert caught.value.given == name


def test_a_shape_whose_class_is_not_defined():
    with pytest.raises(UnknownNameError) as caught:
        build({**PRISM, "classes": {"bar": PRISM["classes"]["bar"]}})
    assert caught.value.given == "cable"


def test_a_planar_scene():
    document = changed("axes", to="xz")
    document["inputs"][1]["direction"] = [3, 4]
    document["loads"][0]["force"] = [1, 2]
    document["gravity"] = [0, -9.81]
    document["nodes"]["c"]["position"] = [1, 1.5]
    structure, _ = build(document)
    assert structure.axes == (0, 2)
    assert structure.node_position.tolist() == [[0, 0, 0], [2, 0, 0], [1, 0, 1.5]]
    assert structure.gravity.tolist() == [0, 0, -9.81]
    assert structure.node_load[2].tolist() == [1, 0, 2]
    np.testing.assert_allclose(structure.inputs[1].direction, [0.6, 0, 0.8])
    assert structure.coordinate_node_axis.tolist() == [[2, 0], [2, 2]]


def test_a_planar_scene_may_lie_anywhere_along_the_dropped_axis():
    document = changed("axes", to="xz")
    document["inputs"].pop()
    for node in document["nodes"].values():
        node["position"][1] = 7
    assert build(document)[0].node_position[:, 1].tolist() == [7, 7, 7]


@pytest.mark.parametrize(
    ("path", "value", "place"),
    [
        (("nodes", "c", "position"), [1, 0.5, 1.5], "nodes.c.position"),
        (("nodes", "c", "velocity"), [0, 1, 0], "nodes.c.velocity"),
        (("loads", 0, "force"), [0, 1, 0], "nodes.c.load"),
        (("gravity",), [0, 1, 0], "gravity"),
        (("inputs", 1, "direction"), [0, 1, 0], "inputs[1].direction"),
    ],
)
def test_what_leaves_the_plane_is_refused(path, value, place):
    base = changed("axes", to="xz")
    base["inputs"][1]["direction"] = [0, 0, 1]
    build(base)
    with pytest.raises(StructureError) as caught:
        build(changed(*path, to=value, base=base))
    assert caught.value.where == f"{WHERE}: {place}"
    assert "y" in caught.value.allowed


def test_velocity_on_an_anchored_axis():
    assert build(changed("nodes", "b", "velocity", to=[0, 1, 0]))[0].node_velocity[1].tolist() == [0, 1, 0]
    with pytest.raises(StructureError) as caught:
        build(changed("nodes", "b", "velocity", to=[0, 1, 2]))
    assert caught.value.where == f"{WHERE}: nodes.b.velocity"
    assert caught.value.given == [0, 1, 2]


def test_a_scene_without_nodes_or_members():
    with pytest.raises(StructureError, match="no nodes"):
        build({"name": "x"})
    with pytest.raises(StructureError, match="no members"):
        build({"name": "x", "nodes": ARCH["nodes"]})


def test_no_free_node():
    document = changed("nodes", "b", "anchored", to=True)
    document["nodes"]["c"]["anchored"] = "xyz"
    with pytest.raises(StructureError, match="free to move") as caught:
        build(document)
    assert caught.value.where == f"{WHERE}: nodes"


def test_no_free_node_on_the_modelled_axes():
    document = changed("axes", to="xz", base=changed("nodes", "c", "anchored", to="xz"))
    document["inputs"].pop()
    with pytest.raises(StructureError, match="free to move"):
        build(document)


@pytest.mark.parametrize("anchored", [True, False])
def test_an_unconnected_node(anchored):
    with pytest.raises(StructureError) as caught:
        build(changed("nodes", "d", to={"position": [5, 5, 5], "anchored": anchored}))
    assert caught.value.where == f"{WHERE}: nodes.d"
    assert "member" in caught.value.allowed


def test_scene_without_extras():
    document = {key: ARCH[key] for key in ("name", "classes", "nodes", "members")}
    structure, request = build(document)
    assert structure.gravity.tolist() == [0, 0, 0]
    assert structure.inputs == ()
    assert dict(structure.groups) == {}
    assert dict(request.parameters) == {}
    assert request.integrators == ()


def test_removing_the_name_is_noticed():
    with pytest.raises(Exception, match="needed key"):
        build(changed("name", to=REMOVE))


@pytest.mark.thorough
def test_a_hundred_thousand_members_are_linear_in_time():
    count = 34_000
    nodes = {f"n{i}": {"position": [0.1 * i, i % 3, i % 7], "mass": 0.1} for i in range(count)}
    members = {
        f"m{i}_{step}": {"class": "string", "nodes": [f"n{i}", f"n{i + step}"]}
        for i in range(count - 3)
        for step in (1, 2, 3)
    }
    document = {
        "name": "row",
        "classes": {"string": {"kind": "cable", "axial_stiffness": 100.0, "prestress": 1.0}},
        "nodes": nodes,
        "members": members,
        "groups": {"every": list(members)},
        "parameters": {"rest_length": ["every"]},
    }
    members["end"] = {"class": "string", "nodes": ["n0", f"n{count - 1}"]}
    members["tail"] = {"class": "string", "nodes": [f"n{count - 2}", f"n{count - 1}"]}
    start = time.process_time()
    structure, request = build(document)
    assert time.process_time() - start < 60
    assert structure.n_members == len(members) > 100_000
    assert len(request.parameters["rest_length"]) == len(members) - 2
