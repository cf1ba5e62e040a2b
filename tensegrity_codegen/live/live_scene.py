"""The content of a live page: a structure, and a motion, modes and reactions where they are known."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.live.channels import Channel, pack, pack_rounded
from tensegrity_codegen.report.loads import compute_loads, compute_reactions
from tensegrity_codegen.report.pictures.choices import (
    NAMED_VIEWS,
    Direction,
    check_array,
    check_tension,
    check_trajectory,
)
from tensegrity_codegen.report.pictures.draw import outline_motion, pad_tension
from tensegrity_codegen.report.pictures.shown import find_rest_tension
from tensegrity_codegen.report.pictures.view import check_planar_direction
from tensegrity_codegen.runtime.analysis.analysis import Analysis
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.limits import MEMBER_LIMITS
from tensegrity_codegen.structure.member_limits import MEMBER_CHECKS, check_members
from tensegrity_codegen.structure.outline import find_joints, outline_bodies, split_at_rings
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.summaries import describe_count

MAX_USE = 1000.0  # of a use that is infinite, such as a tension where none is allowed


def compute_uses(
    subject: Structure | BodySystem, structure: Structure, position: FloatArray, tension: FloatArray
) -> FloatArray | None:
    """Return the largest part of a limit that each member uses; above 1 the limit is exceeded.

    subject: what has the limits; structure: its outline, whose first members are those of the subject;
    position (n_t, n_nodes, 3) [m]: positions; tension (n_t, n_members) [N]: tensions; NaN where unknown.
    Returns (n_t, n_members): uses, NaN for members without a limit or with an unknown tension; None where no
    member has a limit.
    """
    limits = subject.limits.for_members(subject.n_members)
    if not any(np.any(getattr(limits, name) != none) for name, none in MEMBER_LIMITS.items()):
        return None
    length = structure.strands.lengths(position)[:, : subject.n_members]
    use = check_members(subject, tension[:, : subject.n_members], length).use
    result = np.full(tension.shape, np.nan)
    result[:, : subject.n_members] = np.fmax.reduce([use[name] for name in MEMBER_CHECKS])
    limited: FloatArray = np.minimum(result, MAX_USE)
    return limited


SPACE = (1.0, -1.6, 0.62)
GROUND_GAP = 0.06  # of the size, between supported nodes and the grid


def choose_view(
    axes: Sequence[int], *, is_supported: bool, direction: Direction | None = None
) -> dict[str, Any]:
    """Return direction to the observer, upward axis, the two axes of the grid, and its distance below.

    Named views (top, iso ...) and those of planar scenes are parallel projections (is_flat), as in pictures.

    axes: modelled axes; is_supported: whether supports are drawn below nodes; direction: chosen by a reader.
    Raises InvalidValueError for a planar scene that is seen from elsewhere than along its normal.
    """
    found = tuple(axes)
    if len(found) >= 3:
        gap = GROUND_GAP if is_supported else 0.0
        eye = SPACE if direction is None else _find_eye(direction)
        is_flat = direction is not None and direction.name in NAMED_VIEWS
        return _describe(eye, 2, (0, 1), is_planar=False, gap=gap) | {"is_flat": is_flat}
    if direction is not None:
        check_planar_direction(found, direction)
    if found == (0, 1):
        return _describe((0.0, 0.0, 1.0), 1, (0, 1), is_planar=True)
    if 1 in found:
        return _describe((1.0, 0.0, 0.0), 2, (1, 2), is_planar=True)
    return _describe((0.0, -1.0, 0.0), 2, (0, 2), is_planar=True)


def _find_eye(direction: Direction) -> tuple[float, float, float]:
    """Return the direction to the observer; one along the upward axis leans back a little."""
    azimuth, elevation = math.radians(direction.azimuth), math.radians(direction.elevation)
    flat = max(math.cos(elevation), 1e-4)
    return flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)


def _describe(
    view: tuple[float, float, float], up: int, ground: tuple[int, int], *, is_planar: bool, gap: float = 0.0
) -> dict[str, Any]:
    upward = [float(axis == up) for axis in range(3)]
    return {
        "view": view, "up": upward, "ground": ground, "ground_gap": gap,
        "is_planar": is_planar, "is_flat": is_planar, "space": SPACE,
    }  # fmt: skip


MOST_NAMES = 160  # of nodes or of members that a page writes at once


@dataclass(frozen=True)
class LiveStart:
    """What a page shows at first; readers can change all of it.

    view: from where the structure is seen; labels: names of ``"nodes"``, ``"members"`` or both; follow:
    whether the camera moves with the structure.
    """

    view: Direction | None = None
    labels: tuple[str, ...] = ()
    follow: bool = False

    def describe(self) -> dict[str, Any]:
        """Return labels and follow, as the page's controls call them."""
        labels = "all" if len(self.labels) > 1 else "".join(self.labels) or "none"
        return {"labels": labels, "follow": self.follow}


@dataclass(frozen=True)
class LiveScene:
    """All that a live page shows.

    title, headline: name of the structure, and a line of facts.
    facts: sentences on roundings and on what is left out.
    data: names, axes and other short things in JSON's types.
    channels: arrays by name.
    warnings: what looks like a slip in the scene.
    """

    title: str
    headline: str
    facts: tuple[str, ...]
    data: Mapping[str, Any]
    channels: Mapping[str, Channel] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


AS_USUAL = LiveStart()


def build_live_scene(
    subject: Structure | BodySystem,
    motion: Trajectory | None = None,
    analysis: Analysis | None = None,
    *,
    modes_note: str = "",
    start: LiveStart = AS_USUAL,
    tension: FloatArray | None = None,
    rigid: NDArray[np.bool_] | None = None,
    load: FloatArray | None = None,
) -> LiveScene:
    """Return what a page of a structure shows.

    subject: the structure.
    motion: a motion of it; by default it stands at its stated positions.
    analysis: an analysis at the stated positions, for natural modes and mechanisms.
    modes_note: why there are no modes.
    start: what the page shows at first.
    tension (n_members,) [N]: tensions without a motion, where they are known; by default those that follow
        from the positions.
    rigid (n_members,): members that the formulation keeps rigid, by default those without a stiffness.
    load (n_nodes, 3) [N]: loads without a motion, by default those of the structure.
    """
    structure = outline_bodies(subject)
    if motion is None:
        time, position = np.zeros(1), structure.node_position[None]
        known = find_rest_tension(subject, rigid) if tension is None else pad_tension(tension, structure)
        tension = known[None]
    else:
        moved = outline_motion(motion, structure)
        check_trajectory(structure, moved)
        time, position, tension = moved.time, moved.node_position, moved.member_tension
    low, high = position.min(axis=(0, 1)), position.max(axis=(0, 1))
    origin = np.round((low + high) / 2, 6)
    held = np.flatnonzero(structure.node_anchored[:, list(structure.axes)].any(axis=1))
    loads = compute_loads(subject, motion) if load is None else load[None]
    for name, array in (("node_position", position), ("node_load", loads)):
        check_array(name, array, array.shape, "samples, nodes, axes")
    check_tension(tension, tension.shape, structure, "samples, members")
    reaction = compute_reactions(structure, position, tension, held, loads, find_joints(subject))
    shapes, labels = _list_modes(analysis)
    uses = compute_uses(subject, structure, position, tension)
    headline = _headline(structure, motion)
    # Each strand of a cable through rings is a line of its own
    strands, structure = structure.strands, split_at_rings(structure)
    tension = strands.spread(tension)
    channels = _pack_structure(structure) | {
        "time": pack(time, "float64"),
        "node_position": pack_rounded(position - origin, by_place=True),
        "member_tension": pack_rounded(tension),
    }
    changing = np.flatnonzero(np.any(loads != structure.node_load, axis=(0, 2)))
    if changing.size:
        every = np.flatnonzero(np.any(loads != 0.0, axis=(0, 2)))
        channels |= {"loaded": pack(every, "int32"), "load_motion": pack_rounded(loads[:, every])}
    if held.size:
        channels |= {"held": pack(held, "int32"), "reaction": pack_rounded(reaction)}
    if uses is not None:
        channels["use"] = pack_rounded(strands.spread(uses))
    if not strands.is_plain:
        channels["strand_of"] = pack(strands.member, "int32")
    if motion is not None:
        channels |= {
            name: pack(getattr(motion, name), "float64") for name in ("kinetic_energy", "total_energy")
        }
    if len(labels):
        channels["mode_shape"] = pack_rounded(shapes)
    rounding = {name: channels[name].rounding for name in ("node_position", "member_tension")}
    size = np.linalg.norm(reaction, axis=-1)
    data = {
        **choose_view(structure.axes, is_supported=bool(held.size), direction=start.view),
        "plane": _describe_plane(subject, origin),
        "title": structure.name,
        "start": start.describe(),
        "most_names": MOST_NAMES,
        "nodes": structure.node_name,
        "members": structure.member_name,
        "axes": structure.axes,
        "origin": origin.tolist(),
        "modes": labels,
        "modes_note": modes_note or _describe_modes(analysis),
        "rounding": rounding,
        "largest_load": float(np.linalg.norm(loads, axis=-1).max(initial=0.0)),
        "largest_reaction": float(np.nanmax(size, initial=0.0)),
        "unknown_reactions": int(np.isnan(size).any(axis=0).sum()),
    }
    facts = _list_facts(structure, motion, rounding)
    return LiveScene(structure.name, headline, facts, data, channels)


def _describe_plane(subject: Structure | BodySystem, origin: FloatArray) -> dict[str, Any] | None:
    """Return normal and offset of the ground from the page's origin, None without a ground."""
    ground = subject.ground
    if ground is None:
        return None
    offset = ground.offset - float(ground.normal @ origin)
    return {"normal": ground.normal.tolist(), "offset": offset}


def _pack_structure(structure: Structure) -> dict[str, Channel]:
    """Return the arrays of a structure that do not change."""
    return {
        "connectivity": pack(structure.connectivity.reshape(-1), "int32"),
        "is_bar": pack(structure.is_bar, "uint8"),
        "tension_only": pack(structure.tension_only, "uint8"),
        "radius": pack(structure.radius, "float64"),
        "rest_length": pack(structure.rest_length, "float64"),
        "area": pack(structure.section_area, "float64"),
        "anchored": pack(structure.node_anchored.reshape(-1), "uint8"),
        "load": pack(structure.node_load.reshape(-1), "float64"),
    }


def _list_modes(analysis: Analysis | None) -> tuple[FloatArray, list[dict[str, Any]]]:
    """Return shapes (k, n_nodes, 3), the largest displacement 1, of modes and mechanisms; labels."""
    shapes: list[FloatArray] = []
    labels: list[dict[str, Any]] = []
    if analysis is None:
        return np.zeros((0, 0, 3)), labels
    if analysis.modes is not None:
        for k, frequency in enumerate(analysis.modes.frequency.tolist()):
            rate = float(analysis.modes.growth_rate[k])
            text = f"grows at {rate:.4g} 1/s" if rate > 0 else f"{frequency:.4g} Hz"
            shapes.append(analysis.modes.shape[:, :, k])
            labels.append({"label": f"mode {k + 1}: {text}", "kind": "mode", "frequency": frequency})
    for k in range(analysis.mechanism.shape[2]):
        shapes.append(analysis.mechanism[:, :, k])
        labels.append({"label": f"mechanism {k + 1}", "kind": "mechanism"})
    sizes = [float(np.linalg.norm(shape, axis=1).max(initial=0.0)) for shape in shapes]
    scaled = [shape / size if size > 0 else shape for shape, size in zip(shapes, sizes, strict=True)]
    return np.array(scaled).reshape(len(scaled), -1, 3), labels


def _describe_modes(analysis: Analysis | None) -> str:
    """Return what a reader must know of the modes."""
    if analysis is None:
        return ""
    notes = ["Displacements are exaggerated; tensions are those of the configuration."]
    if analysis.modes is None:
        notes = ["No natural modes: a free node has no mass."]
    if not analysis.is_balanced:
        notes.append("The stated positions are not in balance: the equilibrium has other frequencies.")
    return " ".join(notes)


def _headline(structure: Structure, motion: Trajectory | None) -> str:
    bars = int(structure.is_bar.sum())
    counts = {"node": structure.n_nodes, "bar": bars, "cable": structure.n_members - bars}
    parts = [describe_count(count, word) for word, count in counts.items()]
    if motion is not None:
        samples = describe_count(len(motion.time), "sample")
        parts.append(f"{motion.time[-1] - motion.time[0]:.6g} s in {samples}")
        if motion.status != "ok":
            parts.append(f"status {motion.status}")
    return ", ".join(parts)


def _list_facts(
    structure: Structure, motion: Trajectory | None, rounding: Mapping[str, float]
) -> tuple[str, ...]:
    """Return sentences for the page's help."""
    facts: list[str] = [
        f"Positions are rounded by at most {rounding['node_position']:.2g} m, tensions by at most "
        f"{rounding['member_tension']:.2g} N; between samples they follow straight lines.",
        "Tensions are positive, compressions negative. A tension that is not known is named unknown.",
    ]
    if motion is not None and motion.status != "ok":
        facts.append(f"The simulation ended with status {motion.status}: {motion.message}.")
    for bars, word in ((True, "Bars"), (False, "Cables")):
        chosen = structure.is_bar == bars
        if chosen.any() and not structure.radius[chosen].all():
            facts.append(f"{word} without a radius have one that suits the picture and their largest force.")
    held: NDArray[np.bool_] = np.asarray(structure.node_anchored.any(axis=1))
    if held.any():
        facts.append("Reactions balance members, loads and weight at anchored nodes.")
        heavy = structure.is_bar & (structure.member_mass > 0) & held[structure.connectivity].any(axis=1)
        if motion is not None and heavy.any():
            facts.append("The inertia of bars at anchored nodes is not part of the reactions.")
    return tuple(facts)
