"""Cables that slide through rings with friction: members, of which each slips into the next."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.manifest import SLID_END
from tensegrity_codegen.tables.request import ModelRequest

MAX_RINGS = 12  # of one cable with friction: the code for them grows with their square


@dataclass(frozen=True)
class SlidingCable:
    """A cable that slides through rings with friction.

    name: name of the cable, and of the group of its strands.
    strand_name: names of its strands.
    members: indices of its strands, from its first node to its last.
    friction [1]: coefficient of friction mu at each ring between two of them.
    wrap_deg [deg]: angle that the cable turns at each ring; 0: as the nodes say.
    """

    name: str
    strand_name: tuple[str, ...]
    members: tuple[int, ...]
    friction: tuple[float, ...]
    wrap_deg: tuple[float, ...]

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the internal states: the rest length that has slid through each ring [m]."""
        return tuple(f"{name}{SLID_END}" for name in self.strand_name[:-1])

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Strands before and behind each ring."""
        return list(pairwise(self.members))


def name_rings(sliding: Sequence[SlidingCable]) -> tuple[str, ...]:
    """Return the names of the internal states of all rings with friction, cable by cable."""
    return tuple(name for cable in sliding for name in cable.state_names)


def slip_rest_lengths(
    sliding: Sequence[SlidingCable], rest_length: FloatArray, slid: Mapping[str, float]
) -> FloatArray:
    """Return rest lengths (n_members,) [m] with what has slipped; slid: by the strand before each ring."""
    lengths = rest_length.copy()
    for cable in sliding:
        for name, (before, after) in zip(cable.strand_name[:-1], cable.pairs, strict=True):
            lengths[[before, after]] += [-slid.get(name, 0.0), slid.get(name, 0.0)]
    return lengths


def require_no_ring_friction(subject: Any, what: str, hint: str = "leave friction out") -> None:
    """Raise FormulationError for cables with friction at rings; what: names what does not know them."""
    if subject.sliding:
        problem = f"friction at rings is not supported here: {what}"
        location = f"{subject.name}: members.{subject.sliding[0].name}.friction"
        allowed = "motions and equilibria, in node positions or with rigid bars"
        raise FormulationError(problem, where=location, allowed=allowed, hint=hint)


def check_ring_friction(subject: Any, request: ModelRequest) -> None:
    """Raise FormulationError for a request that cables with friction at rings cannot serve."""
    foreign = {
        f"formulation {request.formulation!r}": request.formulation not in ("node_position", "rigid_bar"),
        "rigid bars with correction": request.options.get("correction", "none") != "none",
        f"emitter {request.emitter!r}": request.emitter not in ("auto", "unrolled"),
        "solvers in C": bool(request.solvers),
        "energy that is kept": bool(request.keep),
        "live pages, and a pull that changes with time": bool(request.driven),
        "single precision": request.precision != "double",
    }
    for feature, is_wanted in foreign.items():
        if is_wanted:
            require_no_ring_friction(subject, feature)


FORMULATIONS_WITH_RINGS = ("node_position", "rigid_bar")
EMITTERS_WITH_RINGS = ("auto", "unrolled")


def has_rings(subject: Any) -> bool:
    """Return whether cables of a structure or body system slide through rings."""
    return bool(getattr(subject, "ring_nodes", ()))


def require_no_rings(subject: Any, what: str, hint: str = "") -> None:
    """Raise FormulationError for cables through rings; what: names what does not know them."""
    if not has_rings(subject):
        return
    cables = [name for name, rings in zip(subject.member_name, subject.ring_nodes, strict=True) if rings]
    raise FormulationError(
        f"cables through rings are not supported here: {what}",
        where=f"{subject.name}: members.{cables[0]}.nodes",
        allowed="two nodes",
        hint=hint or "split the cable at its rings, each part with a tension of its own",
    )


def check_rings(subject: Any, request: ModelRequest) -> None:
    """Raise FormulationError for a request that a structure with cables through rings cannot serve."""
    if request.formulation not in FORMULATIONS_WITH_RINGS:
        either = " or ".join(FORMULATIONS_WITH_RINGS)
        require_no_rings(subject, f"formulation {request.formulation!r}", f"choose {either}")
    if request.options.get("correction", "none") != "none":
        require_no_rings(subject, "rigid bars with correction", 'choose correction = "none"')
    if request.emitter not in EMITTERS_WITH_RINGS:
        require_no_rings(subject, f"emitter {request.emitter!r}", 'choose emitter = "auto"')
