"""The record of a search for an equilibrium: its result, and the motion of the structure to reach it."""

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tensegrity_codegen.runtime.contacts.rest_memory import name_plastic
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.member_limits import MemberChecks, check_members
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.summaries import (
    ByName,
    Fact,
    Summarised,
    describe_count,
    describe_number,
    describe_range,
)
from tensegrity_codegen.tables.body_places import place_bodies
from tensegrity_codegen.tables.manifest import SLID_END
from tensegrity_codegen.tables.static_methods import FOUND

if TYPE_CHECKING:
    from tensegrity_codegen.runtime.statics.neutral_motion import NeutralMotions
    from tensegrity_codegen.runtime.statics.on_ground import Feet

MAX_SEGMENT_ERROR = 0.01  # discretisation error of a cable, as a part, that is warned of
LARGE_MOTION_RATIO = 0.1  # motion, as part of the structure's size, that is warned of


@dataclass(frozen=True)
class SegmentError:
    """The discretisation error of a cable in segments.

    Attributes
    ----------
    cable : str
        Its name.
    n_segments : int
        Number of its segments.
    end_tension, extrapolated_end_tension : float [N]
        Larger tension at its ends, with its segments, and extrapolated to infinitely many.
    sag, extrapolated_sag : float [m]
        Largest distance from the chord of its ends, likewise.
    """

    cable: str
    n_segments: int
    end_tension: float
    extrapolated_end_tension: float
    sag: float
    extrapolated_sag: float

    @property
    def relative(self) -> float:
        """The larger of both errors, as a part of the extrapolated value."""
        pairs = ((self.end_tension, self.extrapolated_end_tension), (self.sag, self.extrapolated_sag))
        return max(abs(value - exact) / abs(exact) if exact else 0.0 for value, exact in pairs)

    def describe(self) -> str:
        """Return a sentence without its full stop."""
        return f"{self.n_segments} segments of cable {self.cable} err by {100 * self.relative:.2g} %"


@dataclass(frozen=True)
class Snap:
    """Whether an equilibrium lies on the path of increasing loads.

    Attributes
    ----------
    snapped : bool or None
        Whether the equilibrium was reached by a jump; None if unknown.
    limit_load_factor : float or None
        Part of the loads up to which the path is stable; None if it is stable to its end, 0 if the
        structure is unstable, or a mechanism, before any load acts.
    limit_prestress_factor : float or None
        The same for the prestress that is not in equilibrium in the given shape.
    limit_added_load_factor : float or None
        The same for loads in addition to those of the scene, which act from the start.
    reason : str
        What happened, or why nothing is known.
    """

    snapped: bool | None
    limit_load_factor: float | None = None
    limit_prestress_factor: float | None = None
    limit_added_load_factor: float | None = None
    reason: str = ""

    def as_evidence(self) -> dict[str, Any]:
        """Return all by name, JSON-ready; the reason as `snap_reason`."""
        return {
            "snapped": self.snapped,
            "limit_load_factor": self.limit_load_factor,
            "limit_prestress_factor": self.limit_prestress_factor,
            "limit_added_load_factor": self.limit_added_load_factor,
            "snap_reason": self.reason,
        }

    def describe(self) -> list[str]:
        """Return the sentences that the equilibrium was reached by a jump, or that nobody knows."""
        if self.snapped is None:
            return [f"whether the structure snapped is unknown: {self.reason}"] if self.reason else []
        if not self.snapped:
            return []
        if self.limit_prestress_factor is not None:
            return [f"snapped without any load, due to its prestress alone: {self.reason}"]
        if self.limit_load_factor == 0.0:
            return [f"snapped: the given shape is unstable under any load, however small: {self.reason}"]
        return [f"snapped: {self.reason}; this equilibrium is on a far branch (see load-path)"]


@dataclass(frozen=True, repr=False)
class Equilibrium(ByName, Summarised):
    """Result of the search for an equilibrium.

    Attributes
    ----------
    status : str
        ``"converged"``: the largest node residual is at most the tolerance times the largest member force
        (with unstressed members: at most 64 eps max(mu l)). ``"rounding_limited"``: a minimum whose residual
        is larger due to rounding, but below 64 eps max(mu l), with l at least 1/16 of the distance from the
        origin. Not found: ``"unstable"`` (the forces balance
        on a saddle of the energy), ``"no_equilibrium"`` (nothing balances the loads), ``"stalled"``,
        ``"iteration_limit"``, ``"work_limit"``, ``"at_pole"`` (a body reached the pole of its angles),
        ``"not_finite"``; on the ground ``"slides"``, ``"tips"``, ``"lifts_off"``.
    method : str
        Method that found it.
    coordinate : ndarray, shape (n_coordinates,) [m]
        Free coordinates.
    node_position : ndarray, shape (n_nodes, 3) [m]
        Positions of all nodes.
    member_length, member_tension : ndarray, shape (n_members,) [m, N]
        Lengths and tensions of members.
    residual, largest_force : float
        Largest node residual and largest member force [N].
    iterations : int
        Number of iterations.
    smallest_eigenvalue : float
        Of the stiffness in the model's coordinates without neutral rigid motions [N/m]; may be nan.
    neutral_motions : int
        Number of neutral rigid motions.
    energy, energy_change : float
        Potential energy, and its change from the start [J].
    displacement, displaced_node : float, str
        Largest distance of a node from its start [m], and its name.
    message : str
        A sentence.
    change, changed_node : float, str
        The same as displacement without neutral motions [m].
    neutral_motion_names : tuple of str
        For example ``"slide along x"``.
    extent : float
        Longest side of a box around the start [m].
    is_start_unstable : bool
        Whether the start was an unstable equilibrium.
    saddles_left : int
        Number of unstable equilibria that the search passed.
    motions : NeutralMotions or None
        The neutral motions.
    node_name, member_name : tuple of str
        Names, for `position` and `tension`.
    structure : Structure, BodySystem or None
        The structure, for pictures; None with a library that was loaded alone.
    node_load : ndarray or None, shape (n_nodes, 3) [N]
        Loads on nodes, without inputs, where they can change at run time; None: those of the scene.
    input : ndarray or None, shape (n_inputs,) [m, N or N m]
        Values of the inputs; None: those of the scene.
    segments : tuple of SegmentError
        Discretisation errors of cables in segments, after `add_segment_error`.
    internal : ndarray or None, shape (n_internal,) [m]
        Internal states of members with memory, settled; None without any.
    internal_name : tuple of str
        Their names.
    feet : Feet or None
        Contacts with the ground: force, penetration, whether each is open, sticks or slips; None without one.
    snap : Snap or None
        Whether it was reached by a jump while prestress and loads increased; None if that was not asked.
    """

    status: str
    method: str
    coordinate: FloatArray  # (n_coordinates,) [m]
    node_position: FloatArray  # (n_nodes, 3) [m]
    member_length: FloatArray  # (n_members,) [m]
    member_tension: FloatArray  # (n_members,) [N]
    residual: float  # largest node residual [N]
    largest_force: float  # largest member force [N]
    iterations: int
    # Of the stiffness in the model's coordinates, neutral rigid motions projected off; may be nan. [N/m], and
    # [N m] where coordinates are angles.
    smallest_eigenvalue: float
    neutral_motions: int  # number of those rigid motions
    energy: float  # potential energy [J]
    energy_change: float  # from the starting point [J]
    displacement: float  # largest distance of a node from its starting point [m]
    displaced_node: str
    message: str
    # Largest distance of a node from its starting point after the neutral motions are taken out [m].
    change: float = float("nan")
    changed_node: str = ""
    neutral_motion_names: tuple[str, ...] = ()
    extent: float = float("nan")  # longest side of a box around the start [m]
    is_start_unstable: bool = False  # the start was an equilibrium, and unstable
    saddles_left: int = 0  # unstable equilibria that the search came to and left
    motions: "NeutralMotions | None" = None
    node_name: tuple[str, ...] = ()
    member_name: tuple[str, ...] = ()
    structure: Structure | BodySystem | None = None
    node_load: FloatArray | None = None
    input: FloatArray | None = None
    feet: "Feet | None" = None
    segments: tuple[SegmentError, ...] = ()
    internal: FloatArray | None = None  # (n_internal,)
    internal_name: tuple[str, ...] = ()
    snap: Snap | None = None

    def headline(self) -> str:
        """Return status and message."""
        return f"{self.status}, {self.message}" if self.message else self.status

    def facts(self) -> list[Fact]:
        """Return tensions, residual, stability and motion, for `repr` and notebooks."""
        residual, largest = describe_number(self.residual, "N"), describe_number(self.largest_force, "N")
        node = f" at {self.displaced_node}" if self.displaced_node else ""
        tension = self.member_tension
        if isinstance(self.structure, Structure):
            tension = tension[~self.structure.is_edge]
        return [
            ("tension", f"{describe_range(tension, 'N')} in {describe_count(len(tension), 'member')}"),
            *[("segments", segment.describe()) for segment in self.worst_segments],
            ("residual", f"{residual}, largest member force {largest}"),
            ("smallest eigenvalue", describe_number(self.smallest_eigenvalue, "N/m")),
            ("displacement", describe_number(self.displacement, "m") + node),
            ("energy", describe_number(self.energy, "J")),
            ("method", f"{self.method}, {self.iterations} iterations"),
        ]

    @property
    def body_position(self) -> FloatArray | None:
        """Centres of mass of rigid bodies, (n_bodies, 3) [m]; None without any, or without a structure."""
        bodies = getattr(self.structure, "body_places", ())
        return place_bodies(bodies, self.node_position)[0] if bodies else None

    @property
    def body_axes(self) -> FloatArray | None:
        """Rotation matrices of rigid bodies, with the axes of each frame as columns, (n_bodies, 3, 3)."""
        bodies = getattr(self.structure, "body_places", ())
        return place_bodies(bodies, self.node_position)[1] if bodies else None

    @property
    def is_found(self) -> bool:
        """Whether this is a minimum of the energy, as exact as asked or as rounding permits."""
        return self.status in FOUND

    @property
    def worst_segments(self) -> list[SegmentError]:
        """The cable in segments that errs most, if there are any."""
        return sorted(self.segments, key=lambda item: -item.relative)[:1]

    @property
    def members(self) -> MemberChecks | None:
        """Members against their limits; None without a structure, or where no equilibrium was found."""
        if self.structure is None or not self.is_found:
            return None
        return check_members(self.structure, self.member_tension, self.member_length)

    def distance_of(self, node_position: FloatArray) -> float:
        """Return how far nodes (n_nodes, 3) are from these at most, neutral motions taken out [m]."""
        if self.motions is None:
            return float(np.linalg.norm(node_position - self.node_position, axis=1).max(initial=0.0))
        return float(self.motions.distance(node_position, self.node_position).max(initial=0.0))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences about unexpected results; none if no equilibrium was found."""
        if not self.is_found:
            return ()
        sentences = []
        if self.is_start_unstable:
            sentences.append(
                "the structure starts in an unstable equilibrium and leaves it: the result is one of "
                "several equilibria; a small disturbance in another direction leads to another one"
            )
        elif self.saddles_left:
            sentences.append(
                "the search passed an unstable equilibrium: the result is one of several equilibria"
            )
        if self.change > LARGE_MOTION_RATIO * self.extent:
            sentences.append(
                f"node {self.changed_node} moves {self.change:.6g} m, {self.change / self.extent:.0%} of the "
                f"structure's size ({self.extent:.6g} m): "
                "the shape differs from that of the scene"
            )
        sentences += [
            f"{segment.describe()}: with segments = {4 * segment.n_segments} it is a sixteenth of that"
            for segment in self.worst_segments
            if segment.relative > MAX_SEGMENT_ERROR
        ]
        sentences += [] if self.snap is None else self.snap.describe()
        return (*sentences, *([] if self.members is None else self.members.describe()))

    @property
    def internal_argument(self) -> dict[str, FloatArray]:
        """Internal states of members and feet as the argument `internal` [m]; empty if there are none."""
        if self.internal is not None:
            return {"internal": self.internal}
        return {} if self.feet is None or not self.feet.internal.size else {"internal": self.feet.internal}

    @property
    def plastic_elongation(self) -> dict[str, float]:
        """Plastic elongations of members by name [m]; empty if none is plastic."""
        return name_plastic(self.internal_name, self.internal)

    @property
    def slid(self) -> dict[str, float]:
        """Rest lengths that have slipped through rings with friction, by the strand before each [m]."""
        return name_plastic(self.internal_name, self.internal, SLID_END)

    def as_evidence(self) -> dict[str, Any]:
        """Return the scalar results by name, JSON-ready, for reports and errors."""
        names = (
            "status", "method", "iterations", "residual", "largest_force", "smallest_eigenvalue",
            "neutral_motions", "neutral_motion_names", "energy", "displacement", "displaced_node", "change",
            "changed_node", "extent", "is_start_unstable", "saddles_left", "warnings", "message",
        )  # fmt: skip
        details: dict[str, Any] = {} if self.feet is None else {"contacts": self.feet.as_evidence()}
        if self.plastic_elongation:
            details["plastic_elongation"] = self.plastic_elongation
        if self.slid:
            details["slid"] = self.slid
        if self.segments:
            details["segments"] = [asdict(segment) for segment in self.segments]
        if self.snap is not None:
            details |= self.snap.as_evidence()
        limits = details | {"limits": None if self.members is None else self.members.as_evidence()}
        return {name: getattr(self, name) for name in names} | limits
