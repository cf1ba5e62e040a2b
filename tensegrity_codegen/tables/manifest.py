"""The manifest of a generated library: the one thing that codegen writes and runtime reads."""

import dataclasses
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.system.errors import AbiMismatchError, LibraryError
from tensegrity_codegen.tables.body_places import BodyPlace, join_bodies, list_node_motions
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.quantities import OF_COLUMNS
from tensegrity_codegen.tables.strands import Strands, list_strands

# Versions of the C interface, docs/c_api.md: of the layout of structs, and of the rules within which headers
# only gain declarations; one number for both.
ABI_VERSION = C_API_VERSION = 3

# Status codes of every generated function, by number.
STATUS = (
    *("ok", "non_finite_input", "non_finite_result", "invalid_argument", "null_pointer", "step_too_small"),
    *("unsupported_machine", "too_many_events"),
)

# Further results of a solver, from the number after those on.
SOLVER_STATUS = ("not_converged", "unstable", "branch_lost")

# Further status of a copy of a motion, see templates/integrate_copies.h.j2.
COPY_STATUS = ("too_many_steps",)
ALL_STATUS = (*STATUS, *SOLVER_STATUS, *COPY_STATUS)

# The meaning of each status: texts of the header, and of the C function NAME_status_text.
STATUS_TEXT = {
    "ok": "the results are there",
    "non_finite_input": "an argument holds a NAN or an infinity",
    "non_finite_result": "a result would not be finite, as where the two nodes of a member are at one place",
    "invalid_argument": "a step, a count, an index or a time is out of range",
    "null_pointer": "a pointer that is needed is NULL",
    "step_too_small": "no step that the time can resolve meets the tolerance",
    "unsupported_machine": "this machine lacks instructions that native code needs",
    "too_many_events": "too many events follow each other within a thousandth of a step",
    "not_converged": "no equilibrium within the iterations, or no step lets the energy fall",
    "unstable": "an equilibrium that is no minimum of the energy",
    "branch_lost": "the equilibria of a path end here, as at a limit point",
    "too_many_steps": "a sample takes more steps than it may",
}

CENTRE = re.compile(r"centre\d*_[xyz]")  # names of coordinates of centres of mass

# Kinds of events of integrators, by their bit in `watch` and `stop`.
EVENT_KINDS = {
    "cable": 1,
    "switch": 8,
    "contact": 2,
    "collision": 64,
    "ground": 16,
    "stick": 32,
    "yield": 128,
    "motor": 256,
    "ring": 512,
    "condition": 4,
}

# Those at which a force or its slope jumps: runs watch them by themselves.
JUMP_KINDS = ("cable", "switch", "collision", "ground", "stick", "yield", "motor", "ring")

# Kinds that set internal states, see structure/memory.py, and the word that the names of these end with.
VISCOUS_WORK = "viscous_work"  # internal state: minus the energy that viscous members have taken [J]
SET_STATES = {"stick": "slips", "yield": "yields"}

SLID_END = "_slid"  # of the names of internal states of rings with friction, behind the strand before it
MOTOR_END = "_motor"  # of the names of internal states of actuators with a time constant

# Fields of a manifest that stand in its file only if they hold something.
ONLY_IF_ANY = (
    "internal_name",
    "contact_name",
    "column_name",
    "ring_nodes",
    "adjoint_work",
    "tape_row",
    "body_places",
    "copies",
)


def count_internal(n_coordinates: int, n_internal: int, n_columns: int) -> int:
    """Return the states behind the velocities: internal ones, and n_columns derivatives of each state."""
    return n_internal + (2 * n_coordinates + n_internal) * n_columns


@dataclass(frozen=True, eq=False)
class Pattern:
    """Compressed-column sparsity: row indices (n_nonzeros,) and column starts (n_columns + 1,).

    Any sequences of whole numbers are taken; they are kept as read-only int32 arrays.
    """

    shape: tuple[int, int]
    row: NDArray[np.int32]
    column_start: NDArray[np.int32]

    def __post_init__(self) -> None:
        for name in ("row", "column_start"):
            value = getattr(self, name)
            values = np.array(value if isinstance(value, np.ndarray) else list(value), dtype=np.int32)
            values.flags.writeable = False
            object.__setattr__(self, name, values)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Pattern) and (
            self.shape == other.shape
            and np.array_equal(self.row, other.row)
            and np.array_equal(self.column_start, other.column_start)
        )

    def __hash__(self) -> int:
        return hash((self.shape, self.row.tobytes()))


@dataclass(frozen=True)
class ArgumentSpec:
    """One argument: its shape, unit and meaning, the names it runs over, its value in the scene."""

    name: str
    shape: tuple[int, ...]
    unit: str
    sentence: str
    nominal: tuple[float, ...]
    over: tuple[str, ...] = ()


@dataclass(frozen=True)
class FunctionSpec:
    """One function: C symbol `<scene>_compute_<quantity>`, the arguments that matter, the result."""

    quantity: str
    symbol: str
    arguments: tuple[str, ...]
    shape: tuple[int, ...]
    unit: str
    sentence: str
    operations: int
    pattern: Pattern | None = None


@dataclass(frozen=True)
class IntegratorSpec:
    """One integrator: C symbol `<scene>_integrate_<name>`, the arguments it passes on, its work array.

    events: the kinds of events that it can cut its steps at, see EVENT_KINDS; cables: indices of the members
    whose going slack or taut is one, then of those whose law switches its slope; tensions: of those whose
    tensions it hands out beside the states; unwatched: how many members can go slack or switch without an
    event, which steps with error control pass over;
    batch_work_size: work array of `<symbol>_batch`, which integrates several states side by side; 0: there is
    none; keeps: what it can keep constant from step to step, "energy"; damped: cables in the matrix of
    an implicit one; adjoint_work: work array of `<symbol>_adjoint`, the gradient of a motion backwards over a
    tape with tape_row numbers a step; 0: there is none.
    """

    name: str
    symbol: str
    arguments: tuple[str, ...]
    work_size: int
    events: tuple[str, ...] = ()
    cables: tuple[int, ...] = ()
    tensions: tuple[int, ...] = ()
    unwatched: int = 0
    batch_work_size: int = 0
    keeps: tuple[str, ...] = ()
    damped: tuple[int, ...] = ()
    adjoint_work: int = 0
    tape_row: int = 0


@dataclass(frozen=True)
class SolverSpec:
    """One solver: C symbol `<scene>_find_<name>`, the arguments it passes on, its work array.

    varied: the argument that `<symbol>_path` takes one value after the other of, "" if there is no such
    function.
    """

    name: str
    symbol: str
    arguments: tuple[str, ...]
    varied: str
    work_size: int


@dataclass(frozen=True)
class LeftOut:
    """One thing that the scene does not need: why, and the effort that its omission saved.

    object_bytes: what the compiled library would grow by, None unless it has been `measured`.
    """

    what: str
    why: str
    functions: int
    arguments: int
    operations: int
    object_bytes: int | None = None
    measured: bool = False


@dataclass(frozen=True)
class SourcePart:
    """One part of the C source besides its functions: whether the file has it, and why, or why not."""

    name: str
    is_included: bool
    why: str


@dataclass(frozen=True)
class Manifest:
    """The whole description of one generated library."""

    abi_version: int
    name: str
    scene_hash: str
    formulation: str
    emitter: str
    precision: str
    flags: str  # name of the compile flags that were asked for
    made_by: dict[str, str]
    axes: tuple[int, ...]
    node_name: tuple[str, ...]
    member_name: tuple[str, ...]
    connectivity: tuple[tuple[int, int], ...]
    coordinate_name: tuple[str, ...]
    coordinate_node_axis: tuple[tuple[int, int], ...]
    node_position: tuple[tuple[float, float, float], ...]
    node_velocity: tuple[tuple[float, float, float], ...]
    input_name: tuple[str, ...]
    arguments: tuple[ArgumentSpec, ...]
    functions: tuple[FunctionSpec, ...]
    integrators: tuple[IntegratorSpec, ...]
    left_out: tuple[LeftOut, ...]
    bar_pair: tuple[
        tuple[str, str], ...
    ] = ()  # names of the two bars, where a wanted quantity runs over pairs
    solvers: tuple[SolverSpec, ...] = ()
    instruction_sets: tuple[str, ...] = ()  # of native code, beyond the baseline of its architecture
    batch_width: int = 0
    rigid_bar: tuple[str, ...] = ()  # members that keep constant lengths, in the order of their multipliers
    interfaces: tuple[str, ...] = ()  # ways to call the library besides its C functions: "casadi"
    parts: tuple[SourcePart, ...] = ()
    driven: tuple[
        str, ...
    ] = ()  # arguments that can change with time in integrators, in the order of their places
    target: str = ""  # machine that the library was compiled for, "" if it is the one that compiled it
    declarations: str = ""  # types and functions of the header, as C
    internal_name: tuple[str, ...] = ()  # internal states, which follow the velocities in a state
    contact_name: tuple[str, ...] = ()  # nodes that can touch the ground
    column_name: tuple[str, ...] = ()  # numbers that motions are differentiated to
    checks: str = "finite"  # "none": functions do not look for numbers that are not finite
    ring_nodes: tuple[tuple[int, ...], ...] = ()  # that each member passes between its ends; (): none does
    copies: bool = False  # whether there are functions that advance many copies by a sample
    body_places: tuple[BodyPlace, ...] = ()  # free rigid bodies by their corners, which are nodes

    @cached_property
    def strands(self) -> Strands:
        """The straight pieces of all members: of most members they are the member itself."""
        return list_strands(np.array(self.connectivity, dtype=np.int64).reshape(-1, 2), self.ring_nodes)

    @property
    def joined(self) -> NDArray[np.int64]:
        """Pairs of nodes that a strand or a body joins, (n, 2)."""
        return join_bodies(self.strands.ends, self.body_places)

    @property
    def body_points(self) -> list[int]:
        """Nodes that are points of bodies, which have no coordinates."""
        return [node for body in self.body_places for node in body.point]

    @cached_property
    def stated_position(self) -> NDArray[np.float64]:
        """Node positions in the scene as a read-only array, (n_nodes, 3) [m]."""
        return _read_only(np.array(self.node_position, dtype=np.float64).reshape(-1, 3))

    @cached_property
    def coordinate_place(self) -> NDArray[np.int64]:
        """Node and axis of each coordinate as a read-only array, (n_coordinates, 2), or (0, 2)."""
        return _read_only(np.array(self.coordinate_node_axis, dtype=np.int64).reshape(-1, 2))

    @cached_property
    def node_motions(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        """Entries of the matrix from coordinates to nodes, see `list_node_motions`."""
        return list_node_motions(self.coordinate_place, self.body_places)

    @cached_property
    def vectors(self) -> tuple[NDArray[np.int64], tuple[str, ...]]:
        """Index of the first coordinate of each vector, (n_vectors,), and what to call it.

        A vector is the position of a node; coordinates that are no positions of nodes are each one of its
        own.
        """
        place, names = self.coordinate_place, self.coordinate_name
        if find_formulation(self.formulation).in_nodes and len(place) == len(names):
            first = np.flatnonzero(np.diff(place[:, 0], prepend=-1))
            return _read_only(first), tuple(f"node {self.node_name[node]}" for node in place[first, 0])
        return _read_only(np.arange(len(names))), tuple(f"coordinate {name}" for name in names)

    @cached_property
    def is_centre(self) -> NDArray[np.bool_]:
        """Whether each coordinate is a place of a centre of mass in node distances, (n_coordinates,).

        These grow with the distance from the origin; all others there are differences of positions.
        """
        if not find_formulation(self.formulation).has_centres:
            return _read_only(np.zeros(len(self.coordinate_name), dtype=np.bool_))
        return _read_only(np.array([CENTRE.fullmatch(name) is not None for name in self.coordinate_name]))

    @property
    def bar_pair_name(self) -> tuple[str, ...]:
        """Names of the pairs of bars, in the order of the quantities over them."""
        return name_bar_pairs(self.bar_pair)

    @property
    def n_internal(self) -> int:
        """Number of states behind the velocities: internal ones, then derivatives of the motion."""
        return count_internal(len(self.coordinate_name), len(self.internal_name), len(self.column_name))

    @cached_property
    def column_scale(self) -> tuple[float, ...]:
        """The factors of derivatives of a motion in the library: sizes of parameters; 1 for directions."""
        count = len(self.column_name)
        rows = [argument.nominal for argument in self.arguments if argument.name in OF_COLUMNS]
        largest = np.abs(np.concatenate([np.zeros(count), *rows]).reshape(-1, count)).max(axis=0)
        return tuple(np.where(largest > 0.0, largest, 1.0).tolist())

    @property
    def has_contacts(self) -> bool:
        """Whether nodes touch the ground or bars press each other, with forces."""
        return bool(self.contact_name) or any(
            function.quantity == "collision_margin" for function in self.functions
        )

    @property
    def motor_name(self) -> tuple[str, ...]:
        """Names of the actuators with a time constant, whose internal states follow the input."""
        return tuple(name.removesuffix(MOTOR_END) for name in self.internal_name if name.endswith(MOTOR_END))

    @property
    def ring_name(self) -> tuple[str, ...]:
        """Names of the strands before each ring with friction; the next member is the strand behind it."""
        return tuple(name.removesuffix(SLID_END) for name in self.internal_name if name.endswith(SLID_END))

    @property
    def needs_state_jacobian(self) -> bool:
        """Whether implicit integrators take the Jacobian of the whole state: contacts or memory."""
        return self.has_contacts or bool(self.internal_name)

    @property
    def has_only_bristles(self) -> bool:
        """Whether internal states are those of friction on the ground alone: forces have no jumps by them."""
        bristles = {f"{name}_stick{k}" for name in self.contact_name for k in (1, 2)}
        return bristles.issuperset(self.internal_name)

    def subjects_of(self, kind: str) -> tuple[str, ...]:
        """Return the owner of each internal state that events of this kind set, in their order."""
        end = f"_{SET_STATES[kind]}"
        return tuple(name.removesuffix(end) for name in self.internal_name if name.endswith(end))

    def argument(self, name: str) -> ArgumentSpec:
        """Return the argument of that name."""
        return next(argument for argument in self.arguments if argument.name == name)

    def find_argument(self, name: str) -> ArgumentSpec | None:
        """Return the argument of that name, None if there is none."""
        return next((argument for argument in self.arguments if argument.name == name), None)

    def to_json(self) -> str:
        """Return the manifest as JSON text, the same for the same content: one line a field.

        A list takes one line however long it is: with 100,000 members, a line a number is slow to write.
        """
        return _format(self, 1) + "\n"

    @classmethod
    def from_json(cls, text: str, *, where: str = "manifest") -> "Manifest":
        """Return the manifest that `text` holds; raises LibraryError or AbiMismatchError."""
        try:
            data = json.loads(text)
            version = data["abi_version"]
        except (ValueError, KeyError, TypeError) as error:
            raise LibraryError("the manifest is damaged", where=where, hint="build it again") from error
        if version != ABI_VERSION:
            problem = "the library was made for another version of the C interface"
            hint = "build it again with this version of tensegrity_codegen"
            raise AbiMismatchError(problem, where=where, given=version, allowed=str(ABI_VERSION), hint=hint)
        try:
            return _decode(data)
        except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
            raise LibraryError("the manifest is damaged", where=where, hint="build it again") from error

    @classmethod
    def read(cls, path: Path) -> "Manifest":
        """Read a manifest file; raises as from_json, LibraryError if there is none."""
        try:
            content = path.read_text(encoding="utf-8")
        except OSError as error:
            raise LibraryError("no manifest beside the library", where=str(path)) from error
        except UnicodeDecodeError as error:
            raise LibraryError("the manifest is damaged", where=str(path), hint="build it again") from error
        return cls.from_json(content, where=str(path))


def name_bar_pairs(pairs: Sequence[tuple[str, str]]) -> tuple[str, ...]:
    """Return one name for each pair of bars: "bar1_bar2", numbered where two would be equal."""
    used: set[str] = set()
    names: list[str] = []
    for bar, second in pairs:
        plain = name = f"{bar}_{second}"
        number = 1
        while name in used:
            number += 1
            name = f"{plain}_{number}"
        used.add(name)
        names.append(name)
    return tuple(names)


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    array.flags.writeable = False
    return array


def _format(value: Any, depth: int) -> str:
    """Return JSON text in which tables, and lists of tables, have one line a field."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        value = {name: field for name, field in fields.items() if name not in ONLY_IF_ANY or field}
    lead = "\n" + " " * depth
    if isinstance(value, dict) and value:
        rows = (f"{json.dumps(key)}: {_format(field, depth + 1)}" for key, field in value.items())
        return "{" + lead + f",{lead}".join(rows) + lead[:-1] + "}"
    if isinstance(value, tuple) and value and dataclasses.is_dataclass(value[0]):
        return "[" + lead + f",{lead}".join(_format(field, depth + 1) for field in value) + lead[:-1] + "]"
    return json.dumps(value.tolist() if isinstance(value, np.ndarray) else value, allow_nan=False)


def _decode(data: dict[str, Any]) -> Manifest:
    data = {key: _freeze(value) for key, value in data.items()}
    data["made_by"] = dict(data["made_by"])
    data["arguments"] = tuple(ArgumentSpec(**entry) for entry in data["arguments"])
    data["functions"] = tuple(
        FunctionSpec(**{**entry, "pattern": Pattern(**entry["pattern"]) if entry["pattern"] else None})
        for entry in data["functions"]
    )
    data["integrators"] = tuple(IntegratorSpec(**entry) for entry in data["integrators"])
    data["solvers"] = tuple(SolverSpec(**entry) for entry in data["solvers"])
    data["left_out"] = tuple(LeftOut(**entry) for entry in data["left_out"])
    data["parts"] = tuple(SourcePart(**entry) for entry in data.get("parts", ()))
    data["body_places"] = tuple(BodyPlace(**entry) for entry in data.get("body_places", ()))
    return Manifest(**data)


def _freeze(value: Any) -> Any:
    if isinstance(value, list):
        nested = not {list, dict}.isdisjoint(map(type, value))
        return tuple(map(_freeze, value)) if nested else tuple(value)
    if isinstance(value, dict):
        return {key: _freeze(entry) for key, entry in value.items()}
    return value
