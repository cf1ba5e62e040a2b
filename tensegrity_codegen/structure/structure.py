"""The structure as frozen arrays, free of files and of formulations.

Sign convention, said once and kept everywhere: `member_tension` is positive in tension, for bars too;
the member vector of member e = (i, j) is d_e = r_i - r_j, so a member in tension pulls node i along
-d_e and node j along +d_e.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.actuators import Actuator, RestLengthGains, Sensor
from tensegrity_codegen.structure.collision import Collision
from tensegrity_codegen.structure.free_bodies import FreeBody, find_attached
from tensegrity_codegen.structure.frozen import freeze_fields
from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.structure.limits import Limits
from tensegrity_codegen.structure.member_laws import WithMemberLaws
from tensegrity_codegen.structure.memory import name_internal_states
from tensegrity_codegen.structure.sliding import SlidingCable
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance
from tensegrity_codegen.system.pickling import reduce_fields
from tensegrity_codegen.system.summaries import Fact, Summarised, count_names, describe_range
from tensegrity_codegen.tables.body_places import (
    BodyPlace,
    join_bodies,
    label_nodes,
    show_members,
    show_nodes,
)
from tensegrity_codegen.tables.strands import Strands, list_strands


@dataclass(frozen=True)
class ActuatedInput(RestLengthGains):
    """One scalar input u of the structure.

    Attributes
    ----------
    name : str
        Name of the input.
    kind : str
        ``"rest_length"``: u [m] times its gain is added to the rest length of each member of `targets`.
        ``"temperature"``: the same with u [K], a change of temperature, and gains rho alpha. ``"force"``:
        u [N] times `direction` acts on each node of `targets`.
    targets : tuple of int
        Indices of members or nodes.
    direction : tuple of float, shape (3,)
        Unit vector of a force.
    gain : tuple of float
        Change of the rest length of each target for one unit of u [1, m/K]; empty: 1 for all.
    """

    name: str
    kind: Literal["rest_length", "temperature", "force"]
    targets: tuple[int, ...]
    direction: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gain: tuple[float, ...] = ()


@dataclass(frozen=True, repr=False)
class Structure(WithMemberLaws, Summarised):
    """Nodes, members, loads and inputs, in SI units; every array is read-only.

    Attributes
    ----------
    name : str
        Name of the scene.
    axes : tuple of int
        Modelled axes, a subset of (0, 1, 2).
    node_name, member_name, member_class : tuple of str
        Names of nodes, members and member classes.
    node_position, node_velocity, node_load : ndarray, shape (n_nodes, 3) [m, m/s, N]
        Stated positions, initial velocities, constant loads.
    node_mass : ndarray, shape (n_nodes,) [kg]
        Point masses, without bars.
    node_anchored : ndarray of bool, shape (n_nodes, 3)
        Anchored axes.
    gravity : ndarray, shape (3,) [m/s2]
        Acceleration of free fall.
    connectivity : ndarray of int, shape (n_members, 2)
        Indices (i, j) of the two nodes of each member.
    is_bar, tension_only : ndarray of bool, shape (n_members,)
        Bars, and cables without force when slack.
    rest_length : ndarray, shape (n_members,) [m]
        Rest lengths.
    spring_constant, axial_stiffness : ndarray, shape (n_members,) [N/m, N]
        Stiffness; one of the two is zero, both for a rigid bar.
    damping : ndarray, shape (n_members,) [N s/m]
        Damping constants.
    member_mass, radius, inner_radius : ndarray, shape (n_members,) [kg, m, m]
        Own mass of bars, outer and inner radius (0 if not given).
    thermal_expansion : ndarray or None, shape (n_members,) [1/K]
        Coefficients of thermal expansion, which gains of inputs of temperature follow from.
    law_parameter : mapping of str to ndarray, shape (n_members,)
        Parameters of member laws other than a linear spring, see `laws`.
    groups : mapping of str to tuple of int
        Indices of members by group.
    inputs : tuple of ActuatedInput
        Inputs, in the order of the input vector; those of the actuators are the last ones.
    actuators : tuple of Actuator
        What the motors of rest-length inputs can do.
    sensors : tuple of Sensor
        Measurements of members and nodes.
    limits : Limits
        Limits of members, of distances between bars, and of the stiffness.
    interference : tuple of pairs of int, or None
        Pairs of bars whose distance is computed; None: all with a radius.
    ground : Ground or None
        The plane that nodes can touch.
    collision : Collision or None
        The force between bars that touch; None: contacts of bars are detected only.
    ring_nodes : tuple of tuple of int
        The rings (nodes) that each member slides through between its two ends, in order, without friction;
        empty where no member passes any. Its length is the sum of its strands, with one tension in all.
    sliding : tuple of SlidingCable
        Cables with friction at rings, each of several members that slide into one another.
    is_large : bool
        Whether members of 50 m and more are meant.
    bodies : tuple of FreeBody
        Rigid bodies, whose corners and points are nodes, and whose edges are rigid bars.
    notes : tuple of str
        What was changed in the numbers of the scene, for warnings.

    Notes
    -----
    A member is a spring of stiffness mu = spring_constant + axial_stiffness / rest_length [N/m].

    Examples
    --------
    >>> from tensegrity_codegen import load_scene
    >>> structure, _ = load_scene("prism.toml")
    >>> structure.n_nodes, structure.n_members
    (6, 12)
    """

    name: str
    axes: tuple[int, ...]  # modelled axes, a subset of (0, 1, 2)
    node_name: tuple[str, ...]
    node_position: FloatArray  # (n_nodes, 3) [m]
    node_velocity: FloatArray  # (n_nodes, 3) [m/s]
    node_mass: FloatArray  # (n_nodes,) [kg], point masses; bars add their own
    node_anchored: NDArray[np.bool_]  # (n_nodes, 3), axis by axis
    node_load: FloatArray  # (n_nodes, 3) [N], constant in direction
    gravity: FloatArray  # (3,) [m/s2]
    member_name: tuple[str, ...]
    member_class: tuple[str, ...]
    connectivity: NDArray[np.int64]  # (n_members, 2) node indices (i, j)
    is_bar: NDArray[np.bool_]  # (n_members,)
    tension_only: NDArray[np.bool_]  # (n_members,)
    rest_length: FloatArray  # (n_members,) [m]
    spring_constant: FloatArray  # (n_members,) [N/m], 0 if axial_stiffness is given
    axial_stiffness: FloatArray  # (n_members,) [N], 0 if spring_constant is given
    damping: FloatArray  # (n_members,) [N s/m]
    member_mass: FloatArray  # (n_members,) [kg], a bar's own, spread evenly along it
    radius: FloatArray  # (n_members,) [m], 0 if not given
    inner_radius: FloatArray | None = None  # (n_members,) [m], of tubes; None: no member is one
    thermal_expansion: FloatArray | None = None  # (n_members,) [1/K], 0 if not given; None: nowhere
    law_parameter: Mapping[str, FloatArray] = field(default_factory=dict)  # (n_members,) each, by name
    groups: Mapping[str, tuple[int, ...]] = field(default_factory=dict)  # member indices
    inputs: tuple[ActuatedInput, ...] = ()
    actuators: tuple[Actuator, ...] = ()  # whose inputs are the last ones
    sensors: tuple[Sensor, ...] = ()
    limits: Limits = field(default_factory=Limits)
    interference: tuple[tuple[int, int], ...] | None = None  # pairs of bars to watch, see bar_pairs
    ground: Ground | None = None
    collision: Collision | None = None  # force between bars that touch
    ring_nodes: tuple[tuple[int, ...], ...] = ()  # that each member passes between its ends; (): none does
    sliding: tuple[SlidingCable, ...] = ()  # cables with friction at rings
    is_large: bool = False  # members of 50 m and more are meant
    bodies: tuple[FreeBody, ...] = ()  # whose corners and points are nodes, and whose edges are rigid bars
    notes: tuple[str, ...] = ()  # what was changed in the numbers of the scene, for warnings

    def headline(self) -> str:
        """Return the name of the scene."""
        return self.name

    def facts(self) -> list[Fact]:
        """Return numbers and names, for `repr` and notebooks."""
        held = [name for name, axes in zip(self.node_name, self.node_anchored, strict=True) if axes.any()]
        size = np.ptp(self.node_position, axis=0) if self.n_nodes else np.zeros(3)
        bars, members = (
            int((self.is_bar & ~self.is_edge).sum()),
            show_members(self.member_name, self.body_places),
        )
        nodes, cables = show_nodes(self.node_name, self.body_places), len(members) - bars
        named = [("bodies", count_names([body.name for body in self.bodies]))] if self.bodies else []
        return [
            ("nodes", f"{count_names(nodes)}, anchored: {count_names(held)}"),
            ("members", f"{bars} bars and {cables} cables: {count_names(members)}"),
            *named,
            ("size", " x ".join(f"{side:.4g}" for side in size) + f" m, mass {self.total_mass:.6g} kg"),
            ("tension", describe_range(self.static_tension()[: len(members)], "N")),
            ("inputs", count_names([entry.name for entry in self.inputs])),
            ("gravity", f"{self.gravity.tolist()} m/s2"),
        ]

    def __post_init__(self) -> None:
        check_instance(self.member_name, (tuple, list), "member_name", "a tuple of names")
        check_instance(self.limits, Limits, "limits", "Limits")
        object.__setattr__(self, "limits", self.limits.for_members(len(self.member_name)))
        freeze_fields(self)

    def __reduce__(self) -> tuple[Any, ...]:
        return reduce_fields(self)

    @property
    def total_mass(self) -> float:
        """Mass of all nodes and members [kg]."""
        return float(self.node_mass.sum() + self.member_mass.sum())

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.node_name)

    @property
    def n_members(self) -> int:
        """Number of members."""
        return len(self.member_name)

    @cached_property
    def strands(self) -> Strands:
        """The straight pieces of all members: of most members they are the member itself."""
        return list_strands(self.connectivity.reshape(-1, 2), self.ring_nodes)

    @property
    def joined(self) -> NDArray[np.int64]:
        """(n, 2): pairs of nodes that a strand or a body joins."""
        return join_bodies(self.strands.ends, self.body_places)

    @property
    def passes_rings(self) -> NDArray[np.bool_]:
        """(n_members,): cables that slide through rings."""
        return self.strands.passes_rings

    def path(self, e: int) -> tuple[int, ...]:
        """Return the nodes of member e, from its first to its last."""
        i, j = (int(node) for node in self.connectivity[e])
        return (i, *(self.ring_nodes[e] if self.ring_nodes else ()), j)

    @cached_property
    def coordinate_node_axis(self) -> NDArray[np.int64]:
        """(n_coordinates, 2): node and axis of each free coordinate, node by node."""
        axes = np.array(self.axes, dtype=np.int64)
        node, column = np.nonzero(self.has_coordinate[:, axes])
        node_axis: NDArray[np.int64] = np.stack([node, axes[column]], axis=1).astype(np.int64)
        node_axis.flags.writeable = False
        return node_axis

    @cached_property
    def attached(self) -> dict[int, tuple[tuple[int, float], ...]]:
        """Points of bodies: node -> corners of the body with their weights in its position."""
        return find_attached(self.n_nodes, self.bodies)

    @cached_property
    def body_places(self) -> tuple[BodyPlace, ...]:
        """What results need of each body."""
        return tuple(body.place() for body in self.bodies)

    @cached_property
    def is_attached(self) -> NDArray[np.bool_]:
        """(n_nodes,): points of bodies, whose positions follow from the corners of these."""
        found = np.zeros(self.n_nodes, dtype=np.bool_)
        found[list(self.attached)] = True
        return found

    @property
    def ends_at_body(self) -> NDArray[np.bool_]:
        """(n_members,): members that end at points of bodies."""
        return np.asarray(self.is_attached[self.connectivity].any(axis=1))

    @property
    def is_mixed(self) -> NDArray[np.bool_]:
        """(n_members,): two-sided linear members, whose tensions are unknowns of the mixed form.

        Elastic ones that end at points of bodies, which have no coordinates, count with the cables.
        """
        return super().is_mixed & ~(self.ends_at_body & ~self.is_rigid)

    @property
    def is_corner(self) -> NDArray[np.bool_]:
        """(n_nodes,): corners of bodies."""
        found = np.zeros(self.n_nodes, dtype=np.bool_)
        found[[node for body in self.bodies for node in body.corner]] = True
        return found

    @cached_property
    def is_edge(self) -> NDArray[np.bool_]:
        """(n_members,): rigid bars between the corners of one body."""
        body = np.full(self.n_nodes, -1)
        for k, entry in enumerate(self.bodies):
            body[list(entry.corner)] = k
        found: NDArray[np.bool_] = (body[self.connectivity].min(axis=1, initial=len(self.bodies)) >= 0) & (
            body[self.connectivity[:, 0]] == body[self.connectivity[:, 1]]
        )
        return found

    @property
    def node_label(self) -> tuple[str, ...]:
        """Names of nodes for texts: corners of bodies go by the names of these."""
        return label_nodes(self.node_name, self.body_places)

    @property
    def has_coordinate(self) -> NDArray[np.bool_]:
        """(n_nodes, 3): axes along which a node has a coordinate: it is neither anchored nor attached."""
        free: NDArray[np.bool_] = ~self.node_anchored & ~self.is_attached[:, None]
        return free

    @property
    def n_coordinates(self) -> int:
        """Number of free node coordinates."""
        return len(self.coordinate_node_axis)

    @cached_property
    def internal_name(self) -> tuple[str, ...]:
        """Names of the internal states, see structure/memory.py."""
        return name_internal_states(self)

    @property
    def lagging_actuators(self) -> dict[str, Actuator]:
        """Actuators with a time constant, by name."""
        return {actuator.name: actuator for actuator in self.actuators if actuator.time_constant}

    @property
    def contact_name(self) -> tuple[str, ...]:
        """Names of the nodes that can touch the ground."""
        return () if self.ground is None else tuple(self.node_name[node] for node in self.ground.node)

    @property
    def is_rigid(self) -> NDArray[np.bool_]:
        """(n_members,): members without any stiffness, which keep their length exactly."""
        rigid: NDArray[np.bool_] = (self.spring_constant == 0) & (self.axial_stiffness == 0)
        return rigid

    @property
    def lumped_mass(self) -> FloatArray:
        """(n_nodes,) [kg]: the masses of nodes, each with half of the masses of its members."""
        mass: FloatArray = self.node_mass.copy()
        np.add.at(mass, self.connectivity.ravel(), np.repeat(self.member_mass / 2, 2))
        return mass

    @property
    def effective_mass(self) -> FloatArray:
        """(n_nodes,) [kg]: the mass that a force on a node moves at least; `lumped_mass` but for bodies."""
        mass = self.lumped_mass
        for body in self.bodies:
            mass[list(body.point)] = [body.mass_at(local) for local in body.point_local]
        return mass

    @property
    def has_much_damping(self) -> NDArray[np.bool_]:
        """(n_members,): cables with half of critical damping or more, c >= sqrt(mu m), m: lighter end."""
        mass = self.node_mass.copy()
        np.add.at(mass, self.connectivity.ravel(), np.repeat(self.member_mass / 6, 2))
        mass[self.node_anchored[:, list(self.axes)].all(axis=1)] = np.inf
        mass[self.is_attached] = self.effective_mass[self.is_attached]
        lighter = np.full(self.n_members, np.inf)
        np.minimum.at(lighter, self.strands.member, mass[self.strands.ends].min(axis=1))
        much: NDArray[np.bool_] = (self.damping > 0) & (self.damping**2 >= self.mu * lighter)
        return self.tension_only & much

    @property
    def n_bar_pairs(self) -> int:
        """Number of rows of `bar_pairs`, counted without making them: there may be too many to hold."""
        if self.interference is not None:
            return len(self.interference)
        round_bar = self.is_bar & (self.radius > 0)
        count = int(np.count_nonzero(round_bar))
        at_node = np.bincount(self.connectivity[round_bar].ravel(), minlength=self.n_nodes)
        return count * (count - 1) // 2 - int((at_node * (at_node - 1) // 2).sum())

    @property
    def bar_pairs(self) -> NDArray[np.int64]:
        """(n_bar_pairs, 2): members of `interference`, or all bars with a radius that share no node."""
        if self.interference is not None:
            return np.array(self.interference, dtype=np.int64).reshape(-1, 2)
        round_bar = np.flatnonzero(self.is_bar & (self.radius > 0))
        start, second = np.triu_indices(len(round_bar), 1)
        pairs = np.stack([round_bar[start], round_bar[second]], axis=1)
        ends = self.connectivity[pairs]
        meets = (ends[:, 0, :, None] == ends[:, 1, None, :]).any(axis=(1, 2))
        disjoint: NDArray[np.int64] = pairs[~meets].astype(np.int64)
        return disjoint

    def member_length(self) -> FloatArray:
        """Return the member lengths at the stated node positions, (n_members,) [m]."""
        return self.strands.lengths(self.node_position)

    def static_tension(self) -> FloatArray:
        """Return the member tensions at the stated node positions, without damping, (n_members,) [N].

        Zero in slack cables and in rigid bars, whose force does not follow from lengths: see
        report.rest_tension for those.
        """
        return self.compute_static_tension(self.member_length())

    def with_changes(self, **changes: Any) -> "Structure":
        """Return a copy with some fields replaced."""
        return replace(self, **changes)
