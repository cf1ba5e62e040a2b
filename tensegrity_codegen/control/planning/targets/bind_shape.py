"""Shape parameters of targets, bound to the nodes of a model."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.control.planning.targets import shape_parameters
from tensegrity_codegen.control.planning.targets.node_sets import find_nodes, find_rings
from tensegrity_codegen.control.planning.targets.shape_parameters import Shape
from tensegrity_codegen.control.planning.targets.target_text import SHAPES, ShapeCall
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError

FLAT = 1e-6  # second extent of a set of nodes, next to the first, below which it counts as a line


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
    """Return a shape parameter bound to the nodes of a model.

    Parameters
    ----------
    call : ShapeCall
        Its name, names of nodes, and component.
    where : str
        The target, for errors.
    model : CompiledModel
        The model.

    Returns
    -------
    BoundShape
        Function of the node positions.

    Raises
    ------
    UnknownNameError, InvalidValueError
        Unknown nodes, or sets of nodes that do not determine the value.
    FormulationError
        The model does not know its masses, or has less than three axes.
    """
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
        top, base = (find_nodes(part, names, where) for part in call.arguments)
    else:
        rings = find_rings(names)
        if rings is None:
            raise InvalidValueError(
                "the structure has no rings of nodes with the names of a prism or tower",
                where=where,
                given=f"nodes {', '.join(names[:6])}",
                allowed=f"{call.name}([top nodes], [base nodes])",
                hint=f'for example {call.name}([t1, t2, t3], [b1, b2, b3]) or {call.name}("t*", "b*")',
            )
        top, base = rings
    for nodes in (base,) if call.name == "height" else (base, top):
        _check_extent(position[nodes], where)
    if call.name == "twist" and len(top) != len(base):
        raise InvalidValueError(
            "the twist is that of pairs of nodes",
            where=where,
            given=f"{len(top)} and {len(base)} nodes",
            allowed="two sets of equal size",
        )
    build = getattr(shape_parameters, f"build_{call.name}")
    return build(top, base, position), np.unique([*top, *base])


def _bind_rotation(
    call: ShapeCall, where: str, model: CompiledModel, position: FloatArray
) -> tuple[Shape, IntArray]:
    if not 1 <= len(call.arguments) <= 2:
        _check_count(call, where, 1, "a set of nodes, and perhaps one that it turns against")
    sets = [find_nodes(part, model.manifest.node_name, where) for part in call.arguments]
    for nodes in sets:
        _check_extent(position[nodes], where)
    base = sets[1] if len(sets) == 2 else None
    return shape_parameters.build_rotation(sets[0], position, base), np.unique(np.concatenate(sets))


def _bind_centre(call: ShapeCall, where: str, model: CompiledModel) -> tuple[Shape, IntArray]:
    _check_count(call, where, 0, "no nodes")
    weight = _find_weights(where, model)
    return lambda position: weight @ position, np.flatnonzero(weight)


def _bind_edge(
    call: ShapeCall, where: str, model: CompiledModel, position: FloatArray
) -> tuple[Shape, IntArray]:
    names = [name for part in call.arguments for name in part]
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
    weight = _find_weights(where, model)
    shape = shape_parameters.build_edge_distance(weight, (int(edge[0]), int(edge[1])), up, position)
    return shape, np.unique([*np.flatnonzero(weight), *edge])


def _find_weights(where: str, model: CompiledModel) -> FloatArray:
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


def _check_count(call: ShapeCall, where: str, count: int, what: str) -> None:
    if len(call.arguments) != count:
        raise InvalidValueError(
            f"{call.name} takes {what}",
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
