"""Shape parameters as targets: functions of node positions that describe the shape of a structure.

Positions are (n_nodes, 3) [m]; angles are in degrees. The base of a function is a set of three or more nodes;
its normal is that of the plane of least squares. At the start normals point to the side of the top, and they
keep that side: where the structure bends, the centre line may become perpendicular to them.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from tensegrity_codegen.control.planning.target_text import SHAPES, ShapeCall
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.errors import (
    FormulationError,
    InvalidValueError,
    name_list,
)
from tensegrity_codegen.system.name_patterns import find_matching

RING = re.compile(r"([bt])(?:(\d+)_)?(\d+)")
Shape = Callable[[FloatArray], FloatArray]

SERIES_ANGLE = 1e-9  # angle [rad] below which its series is used
FLAT = 1e-6  # second extent of a set of nodes, next to the first, below which it counts as a line


# Sets of nodes by name: lists, patterns such as "t6_*", and the rings of the shapes prism and tower.


def find_nodes(names: Sequence[str], node_name: Sequence[str], where: str) -> IntArray:
    """Return the indices of nodes."""
    index = {name: k for k, name in enumerate(node_name)}
    allowed = "nodes of the structure"
    indices = [k for name in names for k in find_matching(name, index, where, allowed)]
    twice = [node_name[k] for k in indices if indices.count(k) > 1]
    if twice:
        raise InvalidValueError(
            "a node is named twice", where=where, given=twice[0], allowed="each node once"
        )
    return np.array(indices, dtype=np.int64)


def find_rings(node_name: Sequence[str]) -> tuple[IntArray, IntArray] | None:
    """Return the top and bottom ring of a structure whose nodes have the names of a prism or tower."""
    index_of: dict[tuple[str, int, int], int] = {}
    for index, name in enumerate(node_name):
        match = RING.fullmatch(name)
        if match:
            index_of[match[1], int(match[2] or 0), int(match[3])] = index
    stages = [stage for _, stage, _ in index_of]
    if not stages:
        return None
    rings = [
        [index_of[key] for key in sorted(index_of) if key[:2] == ring]
        for ring in (("t", max(stages)), ("b", min(stages)))
    ]
    if len(rings[0]) != len(rings[1]) or len(rings[0]) < 3:
        return None
    return np.array(rings[0], dtype=np.int64), np.array(rings[1], dtype=np.int64)


def _build_normal(nodes: IntArray, start: FloatArray, towards: FloatArray) -> Shape:
    """Return the function for the unit normal of the plane of least squares of `nodes`.

    It is on the side of a vector at the start, and turns with the nodes since then.
    """

    def compute(position: FloatArray, side: FloatArray) -> FloatArray:
        local = position[nodes] - position[nodes].mean(axis=0)
        normal: FloatArray = np.linalg.svd(local)[2][-1]
        return normal if normal @ side >= 0 else -normal

    initial = compute(start, towards)
    return lambda position: compute(position, _compute_rotation(start[nodes], position[nodes]).apply(initial))


def build_height(top: IntArray, base: IntArray, start: FloatArray) -> Shape:
    """Return the function for the distance of the centre of `top` from the plane of `base`, 0 or more [m]."""
    normal = _build_normal(base, start, _compute_centre_line(top, base, start))
    return lambda position: np.abs([normal(position) @ _compute_centre_line(top, base, position)])


def build_twist(top: IntArray, base: IntArray, start: FloatArray) -> Shape:
    """Return the function for the angle from `base` to `top` about the base's normal [deg], node by node.

    Of each pair of nodes, the angle between their radii about the centres of their sets, in the plane of
    the base; the pairs count by the product of their radii.
    """
    compute_normal = _build_normal(base, start, _compute_centre_line(top, base, start))

    def twist(position: FloatArray) -> FloatArray:
        lower, upper = (position[nodes] - position[nodes].mean(axis=0) for nodes in (base, top))
        normal = compute_normal(position)
        turned = float(np.cross(lower, upper).sum(axis=0) @ normal)
        along = float((lower * upper).sum() - (lower @ normal) @ (upper @ normal))
        return np.array([np.degrees(np.arctan2(turned, along))])

    return twist


def build_tilt(top: IntArray, base: IntArray, start: FloatArray) -> Shape:
    """Return the function for the two angles by which the plane of `top` leans against that of `base` [deg].

    The normal of the top leans by the first angle towards the first node of the base (seen from the base's
    centre), and by the second one a right angle further, anticlockwise about the base's normal.
    """
    line = _compute_centre_line(top, base, start)
    base_normal = _build_normal(base, start, line)
    # Of two sets in one plane the centre line is perpendicular to both normals: these are on the same side.
    top_normal = _build_normal(
        top, start, line + SERIES_ANGLE * float(np.abs(start).max()) * base_normal(start)
    )

    def tilt(position: FloatArray) -> FloatArray:
        normal, leaning = base_normal(position), top_normal(position)
        axis = position[base[0]] - position[base].mean(axis=0)
        axis = axis - normal * (axis @ normal)
        axis /= np.linalg.norm(axis)
        component = np.array([leaning @ axis, leaning @ np.cross(normal, axis)])
        size = float(np.linalg.norm(component))
        angle = float(np.arctan2(size, leaning @ normal))
        return np.degrees(component * (angle / size if size > SERIES_ANGLE else 1.0))

    return tilt


def build_rotation(nodes: IntArray, start: FloatArray, base: IntArray | None = None) -> Shape:
    """Return the function for the rotation vector of `nodes` since the start [deg], in the scene's axes.

    The rotation of least squares (W. Kabsch, "A solution for the best rotation to relate two sets of
    vectors", Acta Crystallographica A 32, 1976); with a base, relative to the rotation of the base.
    """

    def rotation(position: FloatArray) -> FloatArray:
        turned = _compute_rotation(start[nodes], position[nodes])
        if base is not None:
            turned = _compute_rotation(start[base], position[base]).inv() * turned
        return np.asarray(turned.as_rotvec(degrees=True))

    return rotation


def build_edge_distance(
    weight: FloatArray, edge: tuple[int, int], up: FloatArray, start: FloatArray
) -> Shape:
    """Return the function for the horizontal distance of the centre of mass past a line of two nodes [m]."""

    def distance(position: FloatArray) -> FloatArray:
        start, end = position[edge[0]], position[edge[1]]
        outward = np.cross(end - start, up)
        return np.array([(weight @ (position - start)) @ outward / np.linalg.norm(outward)])

    sign = -1.0 if distance(start)[0] > 0 else 1.0
    return lambda position: sign * distance(position)


def _compute_centre_line(top: IntArray, base: IntArray, position: FloatArray) -> FloatArray:
    """Return the vector (3,) from the centre of `base` to that of `top` [m]."""
    line: FloatArray = position[top].mean(axis=0) - position[base].mean(axis=0)
    return line


def _compute_rotation(before: FloatArray, after: FloatArray) -> Rotation:
    """Return the rotation that takes points (n, 3) nearest to others, about their centres."""
    rotation, _ = Rotation.align_vectors(after - after.mean(axis=0), before - before.mean(axis=0))
    return rotation


# Shape parameters of targets, bound to the nodes of a model.


@dataclass(frozen=True)
class BoundShape:
    """A shape parameter of a model: (n_nodes, 3) positions -> one value for each component.

    shape: the function of all values; nodes: those that it depends on; rows, components: the values that are
    asked for; turns: an angle, which may go on beyond half a turn; may_pad: one number stands for itself and
    zeros.
    """

    shape: Shape
    nodes: IntArray
    unit: str
    components: tuple[str, ...]
    rows: slice
    turns: bool
    may_pad: bool

    def evaluate(self, position: FloatArray, reference: FloatArray | None = None) -> FloatArray:
        """Return all values, of angles those nearest to a reference."""
        value = self.shape(position)
        return value if reference is None or not self.turns else turn_near(value, reference)


def turn_near(angle: FloatArray, reference: FloatArray) -> FloatArray:
    """Return an angle (1,), or a vector of angle and direction (n,) [deg], by whole turns near to another."""
    size = float(np.linalg.norm(angle))
    axis = angle / size if size else reference / max(float(np.linalg.norm(reference)), 1e-300)
    return np.asarray(angle + 360.0 * np.round((axis @ reference - size) / 360.0) * axis)


def bind_shape(call: ShapeCall, where: str, model: CompiledModel) -> BoundShape:
    """Return a shape parameter bound to the nodes of a model."""
    if len(model.manifest.axes) < 3:
        raise FormulationError(
            "shape parameters need a scene with three axes",
            where=where,
            given=f"{len(model.manifest.axes)} axes",
            allowed="three axes",
            hint="use an expression, such as node.x",
        )
    position = place_nodes(model, model.nominal("coordinate").ravel())
    kind = SHAPES[call.name]
    bind: dict[str, Callable[[], tuple[Shape, IntArray]]] = {
        "rings": lambda: _bind_rings(call, where, model, position),
        "body": lambda: _bind_rotation(call, where, model, position),
        "nothing": lambda: _bind_centre(call, where, model),
        "edge": lambda: _bind_edge(call, where, model, position),
    }
    shape, nodes = bind[kind.takes]()
    rows, components = slice(None), kind.components
    if call.component:
        row = kind.components.index(call.component)
        rows, components = slice(row, row + 1), ("",)
    return BoundShape(shape, nodes, kind.unit, components, rows, kind.unit == "deg", call.name == "tilt")


def _bind_rings(
    call: ShapeCall, where: str, model: CompiledModel, position: FloatArray
) -> tuple[Shape, IntArray]:
    names = model.manifest.node_name
    if call.arguments:
        _check_count(call, where, 2, "a set of nodes at the top and one at the base")
        top, base = (find_nodes(node_names, names, where) for node_names in call.arguments)
    else:
        rings = find_rings(names)
        if rings is None:
            raise InvalidValueError(
                "the structure has no rings of nodes with the names of a prism or tower",
                where=where,
                given=f"nodes {name_list(names, 6)}",
                allowed=f"{call.name}([top nodes], [base nodes])",
                hint=f'for example {call.name}([t1, t2, t3], [b1, b2, b3]) or {call.name}("t*", "b*")',
            )
        top, base = rings
    # Sets that determine a plane, of pairs for the twist.
    for nodes in (base,) if call.name == "height" else (base, top):
        _check_extent(position[nodes], where)
    if call.name == "twist" and len(top) != len(base):
        raise InvalidValueError(
            "the twist is that of pairs of nodes",
            where=where,
            given=f"{len(top)} and {len(base)} nodes",
            allowed="two sets of equal size",
        )
    build = {"height": build_height, "twist": build_twist, "tilt": build_tilt}[call.name]
    return build(top, base, position), np.unique([*top, *base])


def _bind_rotation(
    call: ShapeCall, where: str, model: CompiledModel, position: FloatArray
) -> tuple[Shape, IntArray]:
    if not 1 <= len(call.arguments) <= 2:
        _check_count(call, where, 1, "a set of nodes, and perhaps one that it turns against")
    sets = [find_nodes(node_names, model.manifest.node_name, where) for node_names in call.arguments]
    for nodes in sets:
        _check_extent(position[nodes], where)
    base = sets[1] if len(sets) == 2 else None
    return build_rotation(sets[0], position, base), np.unique(np.concatenate(sets))


def _bind_centre(call: ShapeCall, where: str, model: CompiledModel) -> tuple[Shape, IntArray]:
    _check_count(call, where, 0, "no nodes")
    weight = _compute_weights(where, model)
    return lambda position: weight @ position, np.flatnonzero(weight)


def _bind_edge(
    call: ShapeCall, where: str, model: CompiledModel, position: FloatArray
) -> tuple[Shape, IntArray]:
    names = [name for node_names in call.arguments for name in node_names]
    edge = find_nodes(names, model.manifest.node_name, where)
    if len(edge) != 2:
        raise InvalidValueError(
            "an edge has two nodes", where=where, given=", ".join(names) or "none", allowed="past_edge(a, b)"
        )
    structure = model.structure
    gravity = np.zeros(3) if structure is None else np.asarray(structure.gravity)
    up = np.array([0.0, 0.0, 1.0]) if not gravity.any() else -gravity / np.linalg.norm(gravity)
    along = position[edge[1]] - position[edge[0]]
    if np.linalg.norm(np.cross(along, up)) < FLAT * np.linalg.norm(along):
        raise InvalidValueError(
            "the edge is vertical", where=where, given=", ".join(names), allowed="another edge"
        )
    weight = _compute_weights(where, model)
    shape = build_edge_distance(weight, (int(edge[0]), int(edge[1])), up, position)
    return shape, np.unique([*np.flatnonzero(weight), *edge])


def _compute_weights(where: str, model: CompiledModel) -> FloatArray:
    """Return the part of the mass at each node, (n_nodes,): a bar's is half at each end."""
    structure = model.structure
    mass = np.zeros(0)
    if isinstance(structure, Structure):
        mass = structure.node_mass.copy()
        for column in structure.connectivity.T:
            np.add.at(mass, column, structure.member_mass / 2)
    if not mass.sum() > 0:
        raise FormulationError(
            "the centre of mass is not known",
            where=where,
            given="a structure without masses" if isinstance(structure, Structure) else "no scene of nodes",
            allowed="a scene of nodes and members with masses",
            hint="give masses to nodes, or densities to bars",
        )
    return mass / float(mass.sum())


def _check_count(call: ShapeCall, where: str, count: int, arguments: str) -> None:
    if len(call.arguments) != count:
        raise InvalidValueError(
            f"{call.name} takes {arguments}",
            where=where,
            given=f"{len(call.arguments)} arguments",
            allowed=f"{call.name}([a, b, c], [d, e, f])" if count == 2 else f"{count} arguments",
        )


def _check_extent(points: FloatArray, where: str) -> None:
    """Raise InvalidValueError for points that lie on a line, whose plane or rotation is not determined."""
    singular = (
        np.linalg.svd(points - points.mean(axis=0), compute_uv=False) if len(points) > 2 else np.zeros(2)
    )
    if singular[1] <= FLAT * singular[0]:
        raise InvalidValueError(
            "the nodes lie on a line, so that neither plane nor rotation is determined",
            where=where,
            given=f"{len(points)} nodes",
            allowed="three nodes or more, not on one line",
        )
