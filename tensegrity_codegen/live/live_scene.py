"""The content of a live page: a structure, and a motion, modes and reactions if they are known.

Arrays are compressed, in base64, in the shortest type that keeps the stated rounding.
"""

import base64
import gzip
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.report.loads import compute_loads, compute_reactions
from tensegrity_codegen.report.pictures.draw import outline_motion, pad_tension
from tensegrity_codegen.report.pictures.shown import find_imbalance, find_rest_tension
from tensegrity_codegen.report.pictures.view import (
    NAMED_VIEWS,
    Direction,
    check_array,
    check_planar_direction,
    check_tension,
    check_trajectory,
)
from tensegrity_codegen.runtime.analysis.analyse import Analysis
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.body_meshes import build_mesh
from tensegrity_codegen.structure.limits import MEMBER_LIMITS
from tensegrity_codegen.structure.member_limits import check_members
from tensegrity_codegen.structure.outline import find_joints, hide_edges, outline_bodies, split_at_rings
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.summaries import describe_count

MAX_USE = 1000.0  # of a use that is infinite, such as a tension if none is allowed

MAX_FLOATS = 1_500_000  # numbers of an array that are kept in single precision; more take 16 bit each
STEPS = 32000  # of a 16-bit number, to each side of zero
UNKNOWN = -32768


@dataclass(frozen=True)
class Channel:
    """An array as a page holds it."""

    kind: str  # type of the numbers: ``"float64"``, ``"float32"``, ``"int32"``, ``"int16"`` or ``"uint8"``
    shape: tuple[int, ...]  # shape; the first axis runs over rows
    data: str  # the numbers, little-endian, compressed by gzip, in base64
    # scale, offset of 16-bit numbers: value = number * scale + offset; one entry, or one for each place of
    # the last axis
    scale: tuple[float, ...] = ()
    offset: tuple[float, ...] = ()
    rounding: float = 0.0  # largest difference from the given array

    def describe(self) -> dict[str, Any]:
        """Return all but the data, in JSON's types."""
        return {"kind": self.kind, "shape": self.shape, "scale": self.scale, "offset": self.offset}


def pack(values: ArrayLike, kind: str) -> Channel:
    """Return an array as it is, in the type `kind`."""
    array = np.ascontiguousarray(values, dtype=np.dtype(kind).newbyteorder("<"))
    return Channel(kind, array.shape, _compress(array.tobytes()))


def pack_rounded(values: NDArray[np.float64], *, by_place: bool = False) -> Channel:
    """Return an array in single precision, a large one as 16-bit numbers of equal steps."""
    array = np.asarray(values, dtype=np.float64)
    if array.size <= MAX_FLOATS:
        single = array.astype("<f4")
        rounding = float(np.nanmax(np.abs(single - array), initial=0.0))
        return Channel("float32", array.shape, _compress(single.tobytes()), rounding=rounding)
    flat = array.reshape(-1, array.shape[-1]) if by_place else array.reshape(-1, 1)
    low, high = (np.nan_to_num(end.reduce(flat, axis=0)) for end in (np.fmin, np.fmax))
    offset = (low + high) / 2 if by_place else np.zeros(1)
    reach = np.maximum(np.abs(low - offset), np.abs(high - offset))
    scale = np.where(reach > 0, reach / STEPS, 1.0)
    number = np.rint((flat - offset) / scale)
    if not by_place:
        number = np.where((number == 0) & (flat != 0), np.sign(flat), number)
    rounding = float(np.nanmax(np.abs(number * scale + offset - flat), initial=0.0))
    integers = np.where(np.isnan(number), UNKNOWN, number).astype("<i2").reshape(array.shape[0], -1)
    steps = np.diff(integers, axis=0, prepend=np.zeros((1, integers.shape[1]), dtype="<i2"))  # modulo 2^16
    data = _compress(np.ascontiguousarray(steps, dtype="<i2").tobytes())
    return Channel("int16", array.shape, data, tuple(scale.tolist()), tuple(offset.tolist()), rounding)


def pack_text(text: str) -> str:
    """Return text compressed, in base64."""
    return _compress(text.encode("utf-8"))


def _compress(data: bytes) -> str:
    return base64.b64encode(gzip.compress(data, compresslevel=9, mtime=0)).decode("ascii")


# The content of a page.


def compute_uses(
    subject: Structure | BodySystem, structure: Structure, position: FloatArray, tension: FloatArray
) -> FloatArray | None:
    """Return the largest part of a limit that each member uses; above 1 the limit is exceeded."""
    limits = subject.limits.for_members(subject.n_members)
    if not any(np.any(getattr(limits, name) != none) for name, none in MEMBER_LIMITS.items()):
        return None
    length = structure.strands.lengths(position)[:, : subject.n_members]
    checks = check_members(subject, tension[:, : subject.n_members], length)
    result = np.full(tension.shape, np.nan)
    result[:, : subject.n_members] = checks.member_use
    limited: FloatArray = np.minimum(result, MAX_USE)
    return limited


SPACE = (1.0, -1.6, 0.62)
GROUND_GAP = 0.06  # of the size, between supported nodes and the grid


def choose_view(
    axes: Sequence[int], *, is_supported: bool, direction: Direction | None = None
) -> dict[str, Any]:
    """Return direction to the observer, upward axis, the two axes of the grid, and its distance below.

    Named views (top, iso ...) and those of planar scenes are parallel projections (is_flat), as in pictures.
    """
    axes_of_scene = tuple(axes)
    if len(axes_of_scene) >= 3:
        gap = GROUND_GAP if is_supported else 0.0
        eye = SPACE if direction is None else _compute_eye(direction)
        is_flat = direction is not None and direction.name in NAMED_VIEWS
        return _describe(eye, 2, (0, 1), is_planar=False, gap=gap) | {"is_flat": is_flat}
    if direction is not None:
        check_planar_direction(axes_of_scene, direction)
    if axes_of_scene == (0, 1):
        return _describe((0.0, 0.0, 1.0), 1, (0, 1), is_planar=True)
    if 1 in axes_of_scene:
        return _describe((1.0, 0.0, 0.0), 2, (1, 2), is_planar=True)
    return _describe((0.0, -1.0, 0.0), 2, (0, 2), is_planar=True)


def _compute_eye(direction: Direction) -> tuple[float, float, float]:
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


MAX_NAMES = 160  # of nodes or of members that a page writes at once


@dataclass(frozen=True)
class LiveStart:
    """The initial settings of a page; readers can change all of them."""

    view: Direction | None = None  # direction from which the structure is seen
    labels: tuple[str, ...] = ()  # names of ``"nodes"``, ``"members"`` or both
    follow: bool = False  # whether the camera moves with the structure

    def describe(self) -> dict[str, Any]:
        """Return labels and follow, as the page's controls call them."""
        labels = "all" if len(self.labels) > 1 else "".join(self.labels) or "none"
        return {"labels": labels, "follow": self.follow}


@dataclass(frozen=True)
class LiveScene:
    """All that a live page shows."""

    title: str  # name of the structure, and a line of facts
    headline: str
    facts: tuple[str, ...]  # sentences on roundings and omissions
    data: Mapping[str, Any]  # names, axes and other short things in JSON's types
    channels: Mapping[str, Channel] = field(default_factory=dict)  # arrays by name
    warnings: tuple[str, ...] = ()  # likely mistakes in the scene


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
    """Return the content of a page of a structure."""
    structure = outline_bodies(subject)
    lacking = find_imbalance(subject) if motion is None and tension is None else None
    if motion is None:
        time, position = np.zeros(1), structure.node_position[None]
        tensions = find_rest_tension(subject, rigid) if tension is None else pad_tension(tension, structure)
        tension = tensions[None]
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
    # Each strand of a cable through rings is a line of its own
    structure = hide_edges(structure)
    headline = _headline(structure, motion) + (f"; not in balance at {lacking[0]}" if lacking else "")
    is_whole = structure.strands.is_plain and not structure.bodies
    strands, structure = structure.strands, split_at_rings(structure)
    tension = strands.spread(tension[:, : strands.n_members])
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
        channels["use"] = pack_rounded(strands.spread(uses[:, : strands.n_members]))
    if not is_whole:
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
        "most_names": MAX_NAMES,
        "nodes": structure.node_name,
        "shown": int((~structure.is_corner).sum()),
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
    mesh, bodies = build_mesh(structure.bodies), {}
    if structure.bodies:
        bodies = {
            "body_first": pack(mesh.first, "int32"),
            "body_place": pack(mesh.place, "float32"),
            "body_normal": pack(mesh.normal, "float32"),
            "body_triangle": pack(mesh.triangle, "int32"),
        }
    return bodies | {
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
            rate_text = f"grows at {rate:.4g} 1/s" if rate > 0 else f"{frequency:.4g} Hz"
            shapes.append(analysis.modes.shape[:, :, k])
            labels.append({"label": f"mode {k + 1}: {rate_text}", "kind": "mode", "frequency": frequency})
    for k in range(analysis.mechanism.shape[2]):
        shapes.append(analysis.mechanism[:, :, k])
        labels.append({"label": f"mechanism {k + 1}", "kind": "mechanism"})
    sizes = [float(np.linalg.norm(shape, axis=1).max(initial=0.0)) for shape in shapes]
    scaled = [shape / size if size > 0 else shape for shape, size in zip(shapes, sizes, strict=True)]
    return np.array(scaled).reshape(len(scaled), -1, 3), labels


def _describe_modes(analysis: Analysis | None) -> str:
    """Return the notes on the modes for a reader."""
    if analysis is None:
        return ""
    notes = ["Displacements are exaggerated; tensions are those of the configuration."]
    if analysis.modes is None:
        notes = ["No natural modes: a free node has no mass."]
    if not analysis.is_balanced:
        notes.append("The stated positions are not in balance: the equilibrium has other frequencies.")
    return " ".join(notes)


def _headline(structure: Structure, motion: Trajectory | None) -> str:
    bars, n_nodes = int(structure.is_bar.sum()), int((~structure.is_corner).sum())
    counts = {"node": n_nodes, "bar": bars, "cable": structure.n_members - bars}
    clauses = [describe_count(len(structure.bodies), "body", "bodies")] if structure.bodies else []
    clauses += [describe_count(count, noun) for noun, count in counts.items() if count]
    if motion is not None:
        samples = describe_count(len(motion.time), "sample")
        clauses.append(f"{motion.time[-1] - motion.time[0]:.6g} s in {samples}")
        if motion.status != "ok":
            clauses.append(f"status {motion.status}")
    return ", ".join(clauses)


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
    for bars, noun in ((True, "Bars"), (False, "Cables")):
        chosen = structure.is_bar == bars
        if chosen.any() and not structure.radius[chosen].all():
            facts.append(f"{noun} without a radius have one that suits the picture and their largest force.")
    held: NDArray[np.bool_] = np.asarray(structure.node_anchored.any(axis=1))
    if held.any():
        facts.append("Reactions balance members, loads and weight at anchored nodes.")
        heavy = structure.is_bar & (structure.member_mass > 0) & held[structure.connectivity].any(axis=1)
        if motion is not None and heavy.any():
            facts.append("The inertia of bars at anchored nodes is not part of the reactions.")
    return tuple(facts)
