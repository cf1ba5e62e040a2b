"""Rigid bodies, tendons between their points, and what acts on them: frozen, free of files and formulations.

Bodies are fixed (points at rest), bars (thin, axially symmetric, without a spin of their own) or rigid. A bar
is free, or held with one end at a point of another body. Coordinates are minimal, body by body:

    bar     polar angle, azimuth   of its direction u from A to B; after X, Y, Z of its centre if it is free
    rigid   psi, phi, theta        3-1-2 Euler angles, then X, Y, Z of its centre of mass

Sign conventions are those of `structure.py`: tensions are positive, the member vector is first minus second.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.actuators import Actuator, RestLengthGains, Sensor
from tensegrity_codegen.structure.frozen import freeze_fields
from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.structure.limits import Limits
from tensegrity_codegen.structure.member_laws import WithMemberLaws
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.pickling import reduce_fields
from tensegrity_codegen.system.summaries import Fact, Summarised, count_names
from tensegrity_codegen.tables.strands import Strands, list_strands

Vector3: TypeAlias = tuple[float, float, float]
Frame: TypeAlias = Literal["inertial", "body"]


@dataclass(frozen=True)
class Chart:
    """Two angles of a bar's direction about the polar axis e3 = axis, with e1, e2 next in cyclic order.

    declination: u = sin(de) cos(a) e1 + sin(de) sin(a) e2 + cos(de) e3 (SCS)
    elevation:   u = cos(be) cos(a) e1 + cos(be) sin(a) e2 + sin(be) e3 (LIN)
    with a = azimuth + offset [rad]. Both are singular where u is parallel to e3.
    """

    axis: int = 2
    polar: Literal["declination", "elevation"] = "declination"
    offset: float = 0.0

    @property
    def axes(self) -> tuple[int, int, int]:
        """Indices of e1, e2, e3 among the inertial axes."""
        return ((self.axis + 1) % 3, (self.axis + 2) % 3, self.axis)


@dataclass(frozen=True)
class FixedBody:
    """A body at rest, made of points."""

    name: str


@dataclass(frozen=True)
class Bar:
    """A thin bar from end A to end B; its centre of mass is in the middle.

    inertia [kg m2]: transversal, about the middle. held: the end that sits at the node `anchor`, or "" for a
    free bar. spin: its angular velocity is w = azimuth' e3 + declination' n ("azimuth", SCS 3) or u x u'
    ("none", the same in every chart); the two differ along the bar only.
    """

    name: str
    length: float
    mass: float
    inertia: float
    chart: Chart = field(default_factory=Chart)
    held: Literal["A", "B", ""] = ""
    anchor: int = -1
    spin: Literal["azimuth", "none"] = "azimuth"
    radius: float = 0.0


@dataclass(frozen=True)
class RigidBody:
    """A rigid body; its frame has its origin in the centre of mass; inertia (3, 3) [kg m2], row by row."""

    name: str
    mass: float
    inertia: tuple[Vector3, Vector3, Vector3]


Body: TypeAlias = FixedBody | Bar | RigidBody


@dataclass(frozen=True)
class BodyLoad:
    """A constant load without potential: a torque on a body, or a force on a node turning with its body."""

    kind: Literal["force", "torque"]
    target: int
    vector: Vector3
    frame: Frame


@dataclass(frozen=True)
class JointFriction:
    """Friction torque d (w_a - w_b) on body a, the opposite on body b (SCS 12); d <= 0 [N m s]."""

    bodies: tuple[int, int]
    coefficient: float


@dataclass(frozen=True)
class BodyInput(RestLengthGains):
    """One scalar input: added to rest lengths [m], or a force [N] or torque [N m] along a unit direction.

    targets: members of a rest_length or temperature, nodes of a force, bodies of a torque; gain: as of
    ActuatedInput.
    """

    name: str
    kind: Literal["rest_length", "temperature", "force", "torque"]
    targets: tuple[int, ...]
    direction: Vector3 = (0.0, 0.0, 0.0)
    frame: Frame = "inertial"
    gain: tuple[float, ...] = ()


def coordinate_labels(body: Body) -> tuple[str, ...]:
    """Return the short names of a body's own coordinates, in order."""
    if isinstance(body, Bar):
        angles = (body.chart.polar, "azimuth")
        return angles if body.held else ("x", "y", "z", *angles)
    return ("psi", "phi", "theta", "x", "y", "z") if isinstance(body, RigidBody) else ()


@dataclass(frozen=True, repr=False)
class BodySystem(WithMemberLaws, Summarised):
    """Bodies, their points (nodes), tendons (members) and loads; SI units, radians; arrays are read-only.

    node_local: for a fixed body the position, for a rigid body the place in its frame, for a bar the
    distance from its middle towards B in the first column. Tendons follow the laws of `Structure`.
    """

    sliding = ()  # cables with friction at rings: of structures alone

    name: str
    bodies: tuple[Body, ...]
    coordinate: FloatArray  # (n_coordinates,) [m, rad]
    velocity: FloatArray  # (n_coordinates,) [m/s, rad/s]
    gravity: FloatArray  # (3,) [m/s2]
    node_name: tuple[str, ...]
    node_body: NDArray[np.int64]  # (n_nodes,)
    node_local: FloatArray  # (n_nodes, 3) [m]
    node_load: FloatArray  # (n_nodes, 3) [N], constant in direction
    member_name: tuple[str, ...]
    member_class: tuple[str, ...]
    connectivity: NDArray[np.int64]  # (n_members, 2)
    tension_only: NDArray[np.bool_]  # (n_members,)
    rest_length: FloatArray  # (n_members,) [m]
    spring_constant: FloatArray  # (n_members,) [N/m]
    axial_stiffness: FloatArray  # (n_members,) [N]
    damping: FloatArray  # (n_members,) [N s/m]
    radius: FloatArray  # (n_members,) [m]
    thermal_expansion: FloatArray | None = None  # (n_members,) [1/K], 0 if not given; None: nowhere
    law_parameter: Mapping[str, FloatArray] = field(default_factory=dict)  # (n_members,) each, by name
    groups: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    loads: tuple[BodyLoad, ...] = ()
    friction: tuple[JointFriction, ...] = ()
    inputs: tuple[BodyInput, ...] = ()
    actuators: tuple[Actuator, ...] = ()  # whose inputs are the last ones
    sensors: tuple[Sensor, ...] = ()
    limits: Limits = field(default_factory=Limits)  # of tendons; clearance of bars
    interference: tuple[tuple[int, int], ...] | None = None  # pairs of bars to watch, see bar_pairs
    ground: Ground | None = None  # the plane that nodes can touch

    axes = (0, 1, 2)
    inner_radius = None  # tendons are no tubes

    def headline(self) -> str:
        """Return the name of the scene."""
        return self.name

    def facts(self) -> list[Fact]:
        """Return numbers and names, for `repr` and notebooks."""
        return [
            ("bodies", count_names([entry.name for entry in self.bodies])),
            ("points", count_names(self.node_name)),
            ("tendons", count_names(self.member_name)),
            ("coordinates", count_names(self.coordinate_name)),
            ("inputs", count_names([entry.name for entry in self.inputs])),
            ("gravity", f"{self.gravity.tolist()} m/s2"),
        ]

    def __post_init__(self) -> None:
        object.__setattr__(self, "limits", self.limits.for_members(len(self.member_name)))
        freeze_fields(self)

    def __reduce__(self) -> tuple[Any, ...]:
        return reduce_fields(self)

    @cached_property
    def strands(self) -> Strands:
        """The straight pieces of tendons: each tendon is one."""
        return list_strands(self.connectivity.reshape(-1, 2), ())

    @property
    def n_nodes(self) -> int:
        """Number of points of all bodies."""
        return len(self.node_name)

    @property
    def n_members(self) -> int:
        """Number of tendons."""
        return len(self.member_name)

    @property
    def n_coordinates(self) -> int:
        """Number of coordinates."""
        return len(self.coordinate_name)

    @cached_property
    def coordinate_start(self) -> tuple[int, ...]:
        """Index of each body's first coordinate."""
        starts, count = [], 0
        for body in self.bodies:
            starts.append(count)
            count += len(coordinate_labels(body))
        return tuple(starts)

    @cached_property
    def coordinate_name(self) -> tuple[str, ...]:
        """Names such as `bar1_azimuth` or `top_psi`, in the order of the coordinates."""
        return tuple(f"{body.name}_{label}" for body in self.bodies for label in coordinate_labels(body))

    @property
    def is_bar(self) -> NDArray[np.bool_]:
        """(n_members,): false, for tendons are cables; bars are bodies."""
        return np.zeros(self.n_members, dtype=np.bool_)

    @property
    def charted(self) -> tuple[int, ...]:
        """Indices of the bodies that have angles, which are those that can come near a pole."""
        return tuple(k for k, body in enumerate(self.bodies) if not isinstance(body, FixedBody))

    def bar_ends(self, body: int) -> tuple[int, int]:
        """Return the nodes of a bar's ends A and B."""
        start, second = np.flatnonzero(self.node_body == body)[:2]
        return int(start), int(second)

    def bar_joints(self, body: int) -> set[int]:
        """Return the nodes where a bar ends: its own, and the node of another body that holds it."""
        bar = self.bodies[body]
        held = {bar.anchor} if isinstance(bar, Bar) and bar.held else set()
        return {*self.bar_ends(body), *held}

    @property
    def n_bar_pairs(self) -> int:
        """Number of rows of `bar_pairs`."""
        return len(self.bar_pairs)

    @property
    def bar_pairs(self) -> NDArray[np.int64]:
        """(n_bar_pairs, 2): bodies of `interference`, or all bars with a radius that share no joint."""
        if self.interference is not None:
            return np.array(self.interference, dtype=np.int64).reshape(-1, 2)
        round_bars = [k for k, bar in enumerate(self.bodies) if isinstance(bar, Bar) and bar.radius > 0]
        joints = {body: self.bar_joints(body) for body in round_bars}
        pairs = [pair for pair in combinations(round_bars, 2) if not joints[pair[0]] & joints[pair[1]]]
        return np.array(pairs, dtype=np.int64).reshape(-1, 2)

    @property
    def has_unpotential_load(self) -> bool:
        """Whether torques or turning forces act, or can act through inputs."""
        turning = [entry for entry in self.inputs if entry.kind == "torque" or entry.frame == "body"]
        return bool(self.loads or turning)

    def find_node(self, name: str) -> int:
        """Return the index of a node by its name, as `bar1_A`; ValueError if there is none."""
        return self.node_name.index(name)

    def with_changes(self, **changes: Any) -> "BodySystem":
        """Return a copy with some fields replaced."""
        return replace(self, **changes)
