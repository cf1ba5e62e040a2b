"""Structures for the tests of plans: prisms, an icosahedron on a facet, a tower, a spine; all in balance."""

from functools import cache
from typing import Any

import numpy as np

from tensegrity_codegen.pipeline.analyses import want_analyses
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.analysis.prestress import find_prestress
from tensegrity_codegen.runtime.analysis.rank import find_rank
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.scene.shapes.selfstress import equilibrium_matrix
from tensegrity_codegen.scene.subject import assemble_scene
from tensegrity_codegen.structure.actuators import Actuator
from tensegrity_codegen.structure.limits import Limits
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.tables.request import ModelRequest
from tests.codegen.quickly import without_optimisation

CLASSES = {
    "bar": {"kind": "bar", "spring_constant": 1e6, "radius": 0.005},
    "cable": {"kind": "cable", "spring_constant": 1000.0},
}


def assemble(document: dict[str, Any]) -> Structure:
    structure, _ = assemble_scene(parse_scene(document))
    assert isinstance(structure, Structure)
    return structure


def prestress(structure: Structure, largest: float) -> Structure:
    """Return the structure in self-stress, the least cable tension as large as possible, scaled [N]."""
    free = ~structure.node_anchored.ravel()
    matrix = equilibrium_matrix(structure.node_position, structure.connectivity)[free]
    cable = ~structure.is_bar
    tension = find_prestress(find_rank(matrix).selfstress, cable).tension
    tension = tension * (largest / tension[cable].max())
    length = structure.member_length()
    constant, modulus = structure.spring_constant, structure.axial_stiffness
    with np.errstate(divide="ignore", invalid="ignore"):
        rest = np.where(constant > 0, length - tension / constant, length / (1 + tension / modulus))
    return structure.with_changes(rest_length=rest)


@cache
def build_prism(twist: float, *, opposite: bool = True, largest: float = 20.0) -> Structure:
    """Return a free prism of 9 cables, or of 12 with those from b_i to t_(i+1)."""
    shape = {"kind": "prism", "bars": 3, "bottom_radius": 0.15, "height": 0.3, "twist": twist}
    document: dict[str, Any] = {"name": "prism", "classes": CLASSES, "shape": shape}
    if opposite:
        ends = [[f"b{i}", f"t{i % 3 + 1}"] for i in (1, 2, 3)]
        document["members"] = {
            f"opposite{i}": {"class": "cable", "nodes": pair} for i, pair in enumerate(ends, start=1)
        }
    return prestress(assemble(document), largest)


@cache
def build_tower() -> Structure:
    shape = {
        "kind": "tower",
        "stages": 5,
        "radius": 0.2,
        "height": 0.5,
        "overlap": 0.2,
        "prestress": 25.0,
        "anchor_bottom": True,
    }
    classes = {
        "bar": {"kind": "bar", "axial_stiffness": 5e5, "radius": 0.004},
        "cable": {"kind": "cable", "axial_stiffness": 500.0},
    }
    return assemble({"name": "tower", "classes": classes, "shape": shape})


@cache
def build_mast() -> Structure:
    """Return a tower of 3 stages on a fixed base, its cables limited to 1 to 100 N, its bars 2 mm apart."""
    shape = {"kind": "tower", "stages": 3, "radius": 0.15, "height": 0.4, "overlap": 0.2, "prestress": 40.0}
    classes = {
        "bar": {"kind": "bar", "axial_stiffness": 2e6, "radius": 0.004},
        "cable": {"kind": "cable", "axial_stiffness": 2000.0},
    }
    document = {"name": "mast", "classes": classes, "shape": {**shape, "anchor_bottom": True}}
    return limit(actuate(assemble(document)), most=100.0)


@cache
def build_passing_bars() -> Structure:
    """Return a bar that 8 cables hold beside a parallel fixed one, symmetrically above and below."""
    nodes: dict[str, Any] = {
        f"fixed{k}": {"position": [0.0, y, 0.0], "anchored": True} for k, y in ((1, -0.5), (2, 0.5))
    }
    members: dict[str, Any] = {
        name: {"class": "bar", "nodes": [f"{name}1", f"{name}2"]} for name in ("fixed", "moving")
    }
    for k, y in ((1, -0.4), (2, 0.4)):
        nodes[f"moving{k}"] = {"position": [-0.2, y, 0.0]}
        for n, (x, z) in enumerate([(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)]):
            nodes[f"anchor{k}{n}"] = {"position": [x, 2.25 * y, z], "anchored": True}
            members[f"cable{k}{n}"] = {"class": "cable", "nodes": [f"anchor{k}{n}", f"moving{k}"]}
    classes = {**CLASSES, "bar": {**CLASSES["bar"], "radius": 0.02}}
    document = {"name": "passing", "classes": classes, "nodes": nodes, "members": members}
    return limit(actuate(prestress(assemble(document), 20.0)), clearance=0.01)


@cache
def build_icosahedron() -> tuple[Structure, tuple[str, str, str]]:
    """Return an icosahedron of 1 m, 40 N and 2.4 kg that stands on a facet, and the names of its nodes."""
    shape = {"kind": "icosahedron", "bar_length": 1.0, "prestress": 40.0, "node_mass": 0.2}
    structure = assemble({"name": "icosahedron", "classes": CLASSES, "shape": shape})
    pairs = {frozenset(pair) for pair in structure.connectivity[~structure.is_bar].tolist()}
    facet = next(
        (i, j, k)
        for i in range(12)
        for j in range(i)
        for k in range(j)
        if {frozenset(p) for p in ((i, j), (j, k), (k, i))} <= pairs
    )
    position = structure.node_position
    centre = position[list(facet)].mean(axis=0)
    up = -centre / np.linalg.norm(centre)
    along = (position[facet[0]] - centre) / np.linalg.norm(position[facet[0]] - centre)
    turned = (position - centre) @ np.array([along, np.cross(up, along), up]).T
    held = np.zeros((12, 3), dtype=bool)
    held[list(facet)] = True
    names = tuple(structure.node_name[k] for k in facet)
    stood = structure.with_changes(
        node_position=turned, node_anchored=held, gravity=np.array([0.0, 0.0, -9.81])
    )
    return stood, (names[0], names[1], names[2])


def actuate(structure: Structure, start: str = "", *, within: float | None = None, **more: Any) -> Structure:
    """Return the structure with an actuator for each cable whose name begins with `start`."""
    chosen = [
        e
        for e, name in enumerate(structure.member_name)
        if not structure.is_bar[e] and name.startswith(start)
    ]
    actuators, inputs = [], []
    for e in chosen:
        name, rest = structure.member_name[e], float(structure.rest_length[e])
        if within is not None:
            more["range"] = (rest - within, rest + within)
        actuators.append(Actuator(f"pull_{name}", (e,), **more))
        inputs.append(ActuatedInput(f"pull_{name}", "rest_length", (e,)))
    return structure.with_changes(actuators=tuple(actuators), inputs=tuple(inputs))


def gang(structure: Structure, *start: str, **more: Any) -> Structure:
    """Return the structure with one motor for all cables whose names begin so."""
    members = tuple(
        e
        for e, name in enumerate(structure.member_name)
        if name.startswith(start) and not structure.is_bar[e]
    )
    return structure.with_changes(
        actuators=(Actuator("motor", members, **more),),
        inputs=(ActuatedInput("motor", "rest_length", members),),
    )


def limit(
    structure: Structure, least: float = 1.0, clearance: float = 0.002, most: float = np.inf
) -> Structure:
    """Return the structure with these limits of cable tensions [N] and of distances between bars [m]."""
    cable, count = ~structure.is_bar, structure.n_members
    limits = Limits(
        least_tension=np.where(cable, least, -np.inf),
        most_tension=np.where(cable, most, np.inf),
        yield_stress=np.full(count, np.inf),
        buckling=np.zeros(count),
        clearance=clearance,
    )
    return structure.with_changes(limits=limits)


def compile_plan(structure: Any, *quantities: str, **request: Any) -> CompiledModel:
    """Return the model of a structure, for plans; not optimised."""
    with without_optimisation():
        wanted = want_analyses(structure, ModelRequest(quantities=quantities, **request), ("plan",))
        return build_library(structure, wanted).load()


def transform(structure: Structure, turn: np.ndarray, shift: np.ndarray, order: np.ndarray) -> Structure:
    """Return the structure turned and moved, its members in another order and with other names."""
    rank = np.argsort(order)  # new place of each member
    name = tuple(f"renamed_{structure.member_name[e]}" for e in order)
    by_member = (
        *("rest_length", "spring_constant", "axial_stiffness", "damping", "member_mass", "radius"),
        *("is_bar", "tension_only", "connectivity"),
    )
    limits = Limits(
        **{
            key: getattr(structure.limits, key)[order]
            for key in ("least_tension", "most_tension", "yield_stress", "buckling")
        },
        clearance=structure.limits.clearance,
    )
    actuators = [
        Actuator(item.name, tuple(int(rank[e]) for e in item.members), item.rate, item.range)
        for item in structure.actuators[::-1]
    ]
    return structure.with_changes(
        node_position=structure.node_position @ turn.T + shift,
        gravity=turn @ structure.gravity,
        member_name=name,
        member_class=tuple(structure.member_class[e] for e in order),
        groups={},
        limits=limits,
        actuators=tuple(actuators),
        inputs=tuple(ActuatedInput(item.name, "rest_length", item.members) for item in actuators),
        **{key: getattr(structure, key)[order] for key in by_member},
    )
