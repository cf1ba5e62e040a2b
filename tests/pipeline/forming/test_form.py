"""Shapes in balance: closed forms of arches, prisms and nets, and what has no shape.

Schek 1974 (force densities); jax_fdm's arch (Pastrana et al. 2023); prisms of Connelly and Terrell 1995:
twist 90 + 180/n degrees, and the density of verticals 2 sin(pi/n) times that of rings.
"""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.pipeline.forming.force_density import static_load
from tensegrity_codegen.pipeline.forming.form import Form, form
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    DuplicateNameError,
    FormulationError,
    InvalidValueError,
    UnknownNameError,
)
from tests.cases import thorough


def arch() -> dict[str, Any]:
    """Ten bars in a row over 5 m, 0.3 N down at each joint."""
    ends = {0: True, 10: True}
    nodes = {
        f"n{k}": {"position": [0.5 * k - 2.5, 0.0, 0.0], "anchored": ends.get(k, "y")} for k in range(11)
    }
    members = {f"m{k}": {"nodes": [f"n{k}", f"n{k + 1}"], "class": "rib"} for k in range(10)}
    loads = [{"node": f"n{k}", "force": [0.0, 0.0, -0.3]} for k in range(1, 10)]
    classes = {"rib": {"kind": "bar", "axial_stiffness": 1e5}}
    return {"name": "arch", "nodes": nodes, "classes": classes, "members": members, "loads": loads}


def prism(n: int, twist: float = 120.0) -> dict[str, Any]:
    """A prism of n bars, not in balance."""
    nodes: dict[str, Any] = {}
    members: dict[str, Any] = {}
    for k in range(n):
        bottom, top = 2.0 * np.pi * k / n, 2.0 * np.pi * k / n + np.radians(twist)
        nodes[f"b{k}"] = {"position": [float(np.cos(bottom)), float(np.sin(bottom)), 0.0]}
        nodes[f"t{k}"] = {"position": [float(np.cos(top)), float(np.sin(top)), 1.0]}
        after = (k + 1) % n
        members[f"rb{k}"] = {"nodes": [f"b{k}", f"b{after}"], "class": "ring"}
        members[f"rt{k}"] = {"nodes": [f"t{k}", f"t{after}"], "class": "ring"}
        members[f"bar{k}"] = {"nodes": [f"b{k}", f"t{k}"], "class": "strut"}
        members[f"v{k}"] = {"nodes": [f"b{after}", f"t{k}"], "class": "vertical"}
    cable = {"kind": "cable", "axial_stiffness": 1e3}
    classes = {"strut": {"kind": "bar", "axial_stiffness": 1e5}, "ring": cable, "vertical": dict(cable)}
    return {"name": "prism", "nodes": nodes, "classes": classes, "members": members}


def net(n: int = 6) -> dict[str, Any]:
    """A square net with its edge on a saddle."""
    nodes = {}
    for i in range(n + 1):
        for j in range(n + 1):
            x, y = 2.0 * i / n - 1.0, 2.0 * j / n - 1.0
            at_edge = i in (0, n) or j in (0, n)
            if i in (0, n) and j in (0, n):
                continue
            nodes[f"n{i}_{j}"] = {"position": [x, y, 0.5 * x * y if at_edge else 0.0], "anchored": at_edge}
    pairs = [((i, j), (i + 1, j)) for i in range(n) for j in range(1, n)]
    pairs += [((i, j), (i, j + 1)) for i in range(1, n) for j in range(n)]
    members = {
        f"m{k}": {"nodes": ["n{}_{}".format(*a), "n{}_{}".format(*b)], "class": "rope"}
        for k, (a, b) in enumerate(pairs)
    }
    classes = {"rope": {"kind": "cable", "axial_stiffness": 1e4}}
    return {"name": "net", "nodes": nodes, "classes": classes, "members": members}


def check_balance(found: Form) -> None:
    """Forces balance at the free nodes, and rest lengths give the tensions, as the scene says when read."""
    structure, _ = load_scene(found.document)
    i, j = structure.connectivity.T
    span = structure.node_position[j] - structure.node_position[i]
    forces = static_load(structure)
    pull = (structure.static_tension() / structure.member_length())[:, None] * span
    np.add.at(forces, i, pull)
    np.add.at(forces, j, -pull)
    largest = np.abs(found.member_tension).max()
    assert np.abs(forces[~structure.node_anchored]).max() < 1e-7 * largest
    np.testing.assert_allclose(structure.static_tension(), found.member_tension, atol=1e-7 * largest)
    np.testing.assert_allclose(found.force_density * found.member_length, found.member_tension)


def test_an_arch_of_equal_force_densities_is_a_parabola() -> None:
    """Crown at 3.75 m, load path sum |t| l = 9.925 N m; as a chain of pinned bars it falls over."""
    found = form(arch(), density={"bars": -1.0})
    assert found.node_position[5] == pytest.approx([0.0, 0.0, 3.75], abs=1e-12)
    assert np.abs(found.member_tension) @ found.member_length == pytest.approx(9.925, abs=1e-12)
    assert found.status == "unstable"
    check_balance(found)


@pytest.mark.parametrize("n", [3, 4, 5, 6])
def test_prisms_of_bars_with_a_length_twist_as_they_must(n: int) -> None:
    found = form(prism(n), density={"ring": 10.0, "vertical": 20.0 * np.sin(np.pi / n)})
    assert found.status == "stable"
    check_balance(found)
    bottom, top = (np.array([found.position(f"{ring}{k}") for k in range(n)]) for ring in ("b", "t"))
    axis = top.mean(axis=0) - bottom.mean(axis=0)
    axis /= np.linalg.norm(axis)
    arms = [ring[0] - ring.mean(axis=0) for ring in (bottom, top)]
    first, second = (arm - axis * (arm @ axis) for arm in arms)
    twist = np.degrees(np.arctan2(axis @ np.cross(first, second), first @ second)) % 360.0
    assert twist == pytest.approx(90.0 + 180.0 / n, abs=1e-6)
    bars = found.structure.is_bar
    np.testing.assert_allclose(found.force_density[bars], -20.0 * np.sin(np.pi / n), rtol=1e-7)
    np.testing.assert_allclose(found.member_length[bars], load_scene(prism(n))[0].member_length()[bars])


@pytest.mark.parametrize("stated", [{"density": {"bars": -100.0}}, {"force": {"bars": -100.0}}])
def test_struts_between_cables_of_a_length_are_as_long_as_these_allow(stated: dict[str, Any]) -> None:
    """A prism with nine cables of 1 m has struts of sqrt(1 + 2 / sqrt(3)) m (Tibert and Pellegrino 2003)."""
    found = form(prism(3), length={"cables": 1.0}, **stated)
    bars = found.structure.is_bar
    np.testing.assert_allclose(found.member_length[bars], np.sqrt(1.0 + 2.0 / np.sqrt(3.0)), rtol=1e-9)
    pushed = found.force_density if "density" in stated else found.member_tension
    np.testing.assert_allclose(pushed[bars], -100.0, rtol=1e-9)
    assert found.status == "stable"
    check_balance(found)


def truncated(group: str, face: float, edge: list[float], strut: list[float]) -> dict[str, Any]:
    """A truncated polyhedron whose rotations take one node to all others: cables along edges, and struts.

    face: angle of its cut corners, about (1, 1, 1) or z; edge, strut: axes of the half turns of their ends.
    """
    corner = [0.0, 0.0, 1.0] if face == 90.0 else [1.0, 1.0, 1.0]
    turns = [
        Rotation.from_rotvec(np.radians(angle) * np.array(axis) / np.linalg.norm(axis)).as_matrix()
        for angle, axis in ((face, corner), (180.0, edge), (180.0, strut))
    ]
    rotations = Rotation.create_group(group).as_matrix()
    first = np.array([0.1, 0.9, 1.3])
    places = rotations @ first
    members: dict[str, Any] = {}
    for kind, turn in zip(("rope", "rope", "rod"), turns, strict=True):
        for k, rotation in enumerate(rotations):
            other = int(np.linalg.norm(places - rotation @ turn @ first, axis=1).argmin())
            i, j = sorted((k, other))
            members[f"{kind}{i}_{j}"] = {"nodes": [f"n{i}", f"n{j}"], "class": kind}
    classes = {
        "rope": {"kind": "cable", "axial_stiffness": 1e4},
        "rod": {"kind": "bar", "axial_stiffness": 1e7},
    }
    nodes = {f"n{k}": {"position": place.tolist()} for k, place in enumerate(places)}
    return {"name": "truncated", "nodes": nodes, "classes": classes, "members": members}


@pytest.mark.parametrize(
    ("shape", "length"),
    [
        (("T", 120.0, [0, 0, 1], [1, 0, 0]), 2.2506704),
        *thorough(
            (("O", 90.0, [1, 0, 1], [0, 1, 1]), 2.5521662),
            (("O", 120.0, [1, 1, 0], [1, 0, 1]), 2.6659413),
        ),
    ],
)
def test_struts_of_truncated_polyhedra(shape: Any, length: float) -> None:
    """Tetrahedron, octahedron and cube with cables of 1 m, as maximised over one node by their symmetry."""
    found = form(truncated(*shape), length={"rope": 1.0}, density={"rod": -1.0})
    np.testing.assert_allclose(found.member_length[found.structure.is_bar], length, atol=6e-8)
    assert found.status == "stable"


def test_bars_that_push_and_that_nothing_holds_are_named() -> None:
    with pytest.raises(ConvergenceError, match="grow without end"):
        form(prism(3), length={"ring": 1.0}, density={"bars": -1.0, "vertical": 0.1})


def test_a_net_has_the_forces_that_are_stated() -> None:
    found = form(net(), force={"cables": 20.0})
    np.testing.assert_allclose(found.member_tension, 20.0)
    assert found.status == "stable"
    check_balance(found)
    mixed = form(net(), force={"cables": 20.0}, density={"m0": 50.0})
    assert mixed.force_density[0] == pytest.approx(50.0)
    np.testing.assert_allclose(mixed.member_tension[1:], 20.0)


def test_cables_can_have_a_length_too() -> None:
    found = form(prism(3), density={"ring": 10.0}, length={"vertical": 1.2})
    verticals = [k for k, name in enumerate(found.member_name) if name.startswith("v")]
    np.testing.assert_allclose(found.member_length[verticals], 1.2)
    check_balance(found)


def test_weights_of_bars_and_nodes_count() -> None:
    """A rope with a mass in its middle: half of its density times the fall is half of the weight."""
    nodes = {
        "a": {"position": [0.0, 0.0, 0.0], "anchored": True},
        "b": {"position": [1.0, 0.0, 0.0], "mass": 0.5},
        "c": {"position": [2.0, 0.0, 0.0], "anchored": True},
    }
    classes = {"rope": {"kind": "cable", "spring_constant": 100.0}}
    members = {"m1": {"nodes": ["a", "b"], "class": "rope"}, "m2": {"nodes": ["b", "c"], "class": "rope"}}
    scene = {"name": "rope", "gravity": [0, 0, -10.0], "nodes": nodes, "classes": classes, "members": members}
    found = form(scene, density={"rope": 10.0})
    assert found.position("b")[2] == pytest.approx(-0.25)
    check_balance(found)
    with pytest.raises(InvalidValueError, match="no rest length"):
        form(scene, density={"rope": 150.0})  # more than its spring constant


@pytest.mark.parametrize(
    ("stated", "error", "word"),
    [
        ({}, InvalidValueError, "analyse SCENE --prestress 100 --scene-out FILE"),
        ({"density": {"cables": -1.0}}, InvalidValueError, "above 0"),
        ({"density": {"cables": float("nan")}}, InvalidValueError, "nan"),
        ({"force": {"cables": 0.0}}, InvalidValueError, "not a force"),
        ({"length": {"bars": -2.0}, "density": {"cables": 1.0}}, InvalidValueError, "above 0"),
        ({"density": {"cables": 1.0}, "force": {"cables": 2.0}}, DuplicateNameError, "two statements"),
        ({"density": {"cable": 1.0}}, UnknownNameError, "did you mean"),
        ({"density": {"cables": 1.0, "bars": -1.0}}, ConvergenceError, "both signs"),
        ({"density": {"cables": 1.0}}, ConvergenceError, "shrunk to points"),
        ({"density": {"ring": 1.0}, "length": {"vertical": 3.0}}, ConvergenceError, "have to push"),
    ],
)
def test_wrong_statements_are_named(stated: Any, error: type[Exception], word: str) -> None:
    with pytest.raises(error) as raised:
        form(prism(3), **stated)
    assert word in str(raised.value)


def test_what_nothing_holds_is_named() -> None:
    scene = net(2)
    scene["nodes"] |= {"x": {"position": [5.0, 0.0, 0.0]}, "y": {"position": [6.0, 0.0, 0.0]}}
    scene["members"]["loose"] = {"nodes": ["x", "y"], "class": "rope"}
    with pytest.raises(ConvergenceError, match="x, y"):
        form(scene, density={"rope": 1.0})


def test_structures_on_the_ground_are_refused() -> None:
    scene = prism(3)
    for node in scene["nodes"].values():
        node["mass"] = 0.1
    with pytest.raises(FormulationError, match="ground"):
        form({**scene, "ground": {"stiffness": 1e4}}, density={"cables": 1.0})


@pytest.mark.parametrize("segments", [1, 3])
def test_masses_by_length_are_those_of_the_shape_found(segments: int) -> None:
    """Cables of 1 kg/m that hang: the weights in balance are those of the lengths found."""
    rope = {"kind": "cable", "axial_stiffness": 1e5, "mass_per_length": 1.0, "segments": segments}
    nodes: dict[str, Any] = {
        name: {"position": [x, 0, 0], "anchored": True} for name, x in (("a", 0), ("b", 2))
    }
    nodes["m"] = {"position": [1, 0, -9]}
    members: dict[str, Any] = {"b": {"class": "rope", "nodes": ["b", "m"]}}
    members["a"] = {"kind": "cable", "axial_stiffness": 1e5, "mass": 3.0, "nodes": ["a", "m"]}
    scene = {"name": "hung", "gravity": [0, 0, -9.81], "nodes": nodes, "classes": {"rope": rope}}
    found = form({**scene, "members": members}, density={"cables": 20.0})
    structure, _ = load_scene(found.document)
    of_rope = [structure.member_name.index(name) for name in structure.member_name if name != "a"]
    assert structure.member_mass[of_rope] == pytest.approx(found.rest_length[of_rope], rel=1e-9)
    assert float(structure.member_mass[structure.member_name.index("a")]) == 3.0
    check_balance(found)


def test_bars_by_density_weigh_as_long_as_they_are_found() -> None:
    scene = arch()
    scene["gravity"] = [0.0, 0.0, -9.81]
    scene["classes"]["rib"] |= {"radius": 0.01, "density": 100.0}
    found = form(scene, density={"bars": -2.0})
    mass = 100.0 * np.pi * 0.01**2 * found.member_length
    assert found.structure.member_mass == pytest.approx(mass, rel=1e-9)
    check_balance(found)


def test_weights_that_grow_faster_than_the_pull_have_no_shape() -> None:
    scene = arch()
    scene["gravity"] = [0.0, 0.0, -9.81]
    scene["classes"]["rib"] = {"kind": "bar", "radius": 0.01, "density": 7850.0}
    with pytest.raises(ConvergenceError, match="no shape carries the weights"):
        form(scene, density={"bars": -2.0})
