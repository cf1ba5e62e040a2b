"""Keys that name values of the assembled structure: `rest_length.vertical1`, `node_velocity.t1[2]`."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.analyses.cases.quantities import GUST, GUST_TIME, GUST_TIMES
from tensegrity_codegen.scene.names import key_path
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.sweeps.keys import Bounds, Steps
from tensegrity_codegen.system.errors import InvalidValueError, UnknownKeyError, suggest

INPUT = "input"
POSITIVE, NOT_NEGATIVE = Bounds(0.0, lower_is_open=True), Bounds(0.0)
MEMBER_BOUNDS = {
    "rest_length": POSITIVE,
    "spring_constant": POSITIVE,
    "axial_stiffness": POSITIVE,
    "damping": NOT_NEGATIVE,
}
NODE_BOUNDS = {
    "node_mass": POSITIVE,
    "node_load": Bounds(),
    GUST: Bounds(),
    "node_position": Bounds(),
    "anchor_position": Bounds(),
    "node_velocity": Bounds(),
}
COORDINATE_BOUNDS = {"coordinate": Bounds(), "velocity": Bounds()}  # of bodies, by the names of coordinates
ARRAYS = (INPUT, GUST_TIME, *MEMBER_BOUNDS, *NODE_BOUNDS, *COORDINATE_BOUNDS)
VECTORS = ("node_load", GUST, "node_position", "anchor_position", "node_velocity")


@dataclass(frozen=True)
class ArrayKey:
    """Some entries of one array of the structure, which all take the value of the key."""

    text: str  # the key as it was given
    array: str  # field of the structure, or ``"input"``
    rows: tuple[int, ...]  # members, nodes, coordinates or inputs
    axis: int  # column of a vector; -1 of a scalar
    bounds: Bounds  # which numbers are allowed

    @property
    def place(self) -> tuple[object, ...]:
        """The key in its canonical form: equal for two spellings of one number."""
        return ("array", self.array, self.rows, self.axis)

    def write(self, arrays: Mapping[str, NDArray[np.float64]], value: float) -> None:
        """Write the value into arrays of the structure that can be written to."""
        target = arrays[self.array]
        if self.axis < 0:
            target[list(self.rows)] = value
        else:
            target[list(self.rows), self.axis] = value


OF_FREE_NODES = ("node_mass", "node_position", "node_velocity")  # of which points of bodies have none


def find_array_key(text: str, steps: Steps, subject: Subject, where: str) -> ArrayKey:
    """Return the entries that a key names; raises UnknownKeyError or InvalidValueError."""
    array = str(steps[0])
    rows_by_name = _list_names(array, subject)
    if not rows_by_name:
        scene_kind = "a scene of bodies" if isinstance(subject, BodySystem) else "a scene of nodes"
        is_input = array == "input"
        problem = "the scene has no inputs" if is_input else f"{scene_kind} has no such values"
        hint = "state them under [[inputs]] or [[actuators]]" if is_input else ""
        raise InvalidValueError(problem, where=key_path(where, array), given=text, hint=hint)
    if len(steps) < 2 or steps[1] not in rows_by_name:
        name = str(steps[1]) if len(steps) > 1 else ""
        problem = "unknown name" if name else "the name is missing"
        allowed, hint = f"{array}.NAME" + ("[axis]" if array in VECTORS else ""), suggest(name, rows_by_name)
        raise UnknownKeyError(problem, where=key_path(where, *steps), given=text, allowed=allowed, hint=hint)
    rows = rows_by_name[str(steps[1])]
    axis = _find_axis(text, steps, array, where)
    known_bounds = {**MEMBER_BOUNDS, **NODE_BOUNDS, **COORDINATE_BOUNDS, GUST_TIME: NOT_NEGATIVE}
    bounds = known_bounds.get(array, Bounds())
    field = "node_position" if array == "anchor_position" else array
    _check_entries_exist(text, field, rows, axis, subject, where)
    return ArrayKey(text, field, rows, axis, bounds)


def _list_names(array: str, subject: Subject) -> Mapping[str, tuple[int, ...]]:
    """Return the names of an array with their rows; nothing if the structure has no such array."""
    if array == INPUT:
        names = [source.name for source in subject.inputs]
        return {name: (row,) for row, name in enumerate(names)}
    if array == GUST_TIME:
        return {name: (row,) for row, name in enumerate(GUST_TIMES)}
    if array in MEMBER_BOUNDS:
        classes = dict.fromkeys(subject.member_class)
        of_class = {
            name: tuple(e for e, kind in enumerate(subject.member_class) if kind == name) for name in classes
        }
        single = {name: (row,) for row, name in enumerate(subject.member_name)}
        return {**{name: rows for name, rows in of_class.items() if name}, **subject.groups, **single}
    if isinstance(subject, BodySystem) and array in COORDINATE_BOUNDS:
        return {name: (row,) for row, name in enumerate(subject.coordinate_name)}
    arrays = ("node_load", GUST) if isinstance(subject, BodySystem) else NODE_BOUNDS
    return {name: (row,) for row, name in enumerate(subject.node_name)} if array in arrays else {}


def _find_axis(text: str, steps: Steps, array: str, where: str) -> int:
    axis = steps[2] if len(steps) > 2 else None
    if array not in VECTORS and len(steps) == 2:
        return -1
    if array in VECTORS and len(steps) == 3 and axis in (0, 1, 2):
        return int(axis)
    allowed = f"{array}.{steps[1]}" + ("[0], [1] or [2]" if array in VECTORS else "")
    problem = "not the path of a number"
    raise InvalidValueError(problem, where=key_path(where, *steps), given=text, allowed=allowed)


def _check_entries_exist(
    text: str, field: str, rows: tuple[int, ...], axis: int, subject: Subject, where: str
) -> None:
    """Raise InvalidValueError for a stiffness that a member does not have, an axis that a node cannot use."""
    if field in ("spring_constant", "axial_stiffness"):
        lacking = [e for e in rows if not getattr(subject, field)[e] > 0]
        names, problem = subject.member_name, f"the member has no {field}"
    elif field == "rest_length":
        lacking = [e for e in rows if not subject.mu[e] > 0]
        names, problem = subject.member_name, "a rigid bar has no rest length"
    elif field in OF_FREE_NODES and not set(rows).isdisjoint(of_body := _list_nodes_of_bodies(subject)):
        lacking = [k for k in rows if k in of_body]
        names, problem = subject.node_name, "a node of a body moves with it: state a number of bodies.NAME"
    elif isinstance(subject, Structure) and axis >= 0:
        held = subject.node_anchored[:, axis] if field == "node_velocity" else np.zeros(subject.n_nodes, bool)
        lacking = [k for k in rows if axis not in subject.axes or held[k]]
        names, problem = subject.node_name, "the node cannot move or be loaded along this axis"
    else:
        return
    if lacking:
        problem = f"{problem}: {names[lacking[0]]}"
        raise InvalidValueError(problem, where=key_path(where, field), given=text, allowed="one that has it")


def _list_nodes_of_bodies(subject: Subject) -> set[int]:
    """Return the nodes that are corners and points of rigid bodies beside nodes."""
    bodies = subject.bodies if isinstance(subject, Structure) else ()
    return {node for body in bodies for node in (*body.corner, *body.point)}
