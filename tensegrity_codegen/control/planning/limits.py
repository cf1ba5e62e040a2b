"""Limits of a plan, and how far an equilibrium is from each of them."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.planning.plan_point import MemberRanges, PlanPoint, Slopes
from tensegrity_codegen.runtime.model.arrays import to_doubles
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.structure.limits import MEMBER_LIMITS, Limits
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import is_number
from tensegrity_codegen.system.errors import InvalidValueError

LIMIT_TOLERANCE = 5e-7  # of the size of a limit: excess that counts as none
MIN_SIZE = 1e-4  # of the largest force or the longest member: size of limits near zero
MIN_STIFFNESS = 1e-3  # [N/m]: size of the limit of the smallest eigenvalue where it is near zero


@dataclass(frozen=True)
class PlanLimits:
    """What every equilibrium of a plan satisfies; infinities stand for no limit."""

    least_tension: FloatArray  # (n_members,) [N]: bounds of the member tensions
    most_tension: FloatArray  # (n_members,) [N]
    # (n_members,) [N]: largest force in tension and compression, from the yield stress
    yield_force: FloatArray
    # (n_members,) [N m2]: pi^2 E I over the safety factor: the compression is at most this over the squared
    # length
    buckling: FloatArray
    clearance: float  # [m]: least distance between bars
    # [N/m]: least smallest eigenvalue of the stiffness; 0 where the limits are below: plans are stable
    least_stiffness: float
    # least_change, most_change (n_actuators,) [m]: range of the actuators' inputs, by members that one
    # actuator alone moves
    least_change: FloatArray
    most_change: FloatArray
    ranges: MemberRanges  # ranges of the rest lengths of all members that move


@dataclass(frozen=True)
class Margins:
    """Margins to all limits, positive inside; one row each."""

    # "least_tension", "most_tension", "yield", "buckling", "clearance", "least_stiffness", "range"
    kind: tuple[str, ...]
    index: NDArray[np.int64]  # (n,): member, pair of bars, eigenvalue or row of the ranges
    value: FloatArray  # (n,) [N, m, N/m]: margins
    size: FloatArray  # (n,): size of each limit, for tolerances
    bound: FloatArray  # (n,) [N, m, N/m]: the limits themselves; of ranges, the value of the input
    # (n, n_actuators) or None: derivatives of the margins with respect to the inputs
    slope: FloatArray | None = None

    @property
    def excess(self) -> FloatArray:
        """How far each limit is exceeded, as a part of its size; negative inside."""
        return np.asarray(-self.value / self.size)


def build_limits(model: CompiledModel, ranges: MemberRanges, limits: Limits | None = None) -> PlanLimits:
    """Return the limits of a structure and of its actuators, as bounds of forces and inputs."""
    structure = model.structure
    assert structure is not None
    limits = _read_limits(structure.limits if limits is None else limits, len(structure.member_name))
    area = np.where(structure.section_area > 0, structure.section_area, math.inf)
    flexural = math.pi**2 * structure.flexural_rigidity
    with np.errstate(divide="ignore", invalid="ignore"):
        buckling = np.where(limits.buckling > 0, flexural / limits.buckling, math.inf)
    return PlanLimits(
        np.array(limits.least_tension),
        np.array(limits.most_tension),
        limits.yield_stress * area,
        buckling,
        limits.clearance,
        max(limits.least_stiffness, 0.0),
        *ranges.of_actuators(),
        ranges,
    )


def _read_limits(limits: Limits, count: int) -> Limits:
    """Return limits of `count` members, as arrays of doubles; raises InvalidValueError for others."""
    if not isinstance(limits, Limits):
        raise InvalidValueError(
            "not limits", where="limits", given=limits, allowed="an object Limits, or None"
        )
    for key in ("clearance", "least_stiffness"):
        value = getattr(limits, key)
        if not is_number(value) and not (isinstance(value, float) and math.isinf(value)):
            raise InvalidValueError("not a limit", where=f"limits.{key}", given=value, allowed="a number")
    allowed = f"{count} numbers, without NaN"
    arrays = {key: to_doubles(getattr(limits, key), f"limits.{key}", allowed) for key in MEMBER_LIMITS}
    shapes = {(count,)} if any(array.size for array in arrays.values()) else {(0,), (count,)}
    for key, array in arrays.items():
        if array.shape not in shapes or np.isnan(array).any():
            raise InvalidValueError(
                "not a limit of each member",
                where=f"limits.{key}",
                given=getattr(limits, key),
                allowed=allowed,
            )
    read = Limits(**arrays, clearance=limits.clearance, least_stiffness=limits.least_stiffness)
    return read.for_members(count)


def keep_taut(limits: PlanLimits, at: PlanPoint, tension_only: NDArray[np.bool_]) -> PlanLimits:
    """Return the limits with least tension 0 for cables without one that are in tension at the start."""
    free = tension_only & (at.tension > 0) & ~np.isfinite(limits.least_tension)
    return replace(limits, least_tension=np.where(free, 0.0, limits.least_tension))


def compute_margins(limits: PlanLimits, at: PlanPoint, slopes: Slopes | None = None) -> Margins:
    """Return the margins of an equilibrium to all limits that exist."""
    tension, load, count = at.tension, limits.buckling / at.length**2, len(at.change)
    ranges = limits.ranges
    change = ranges.pull @ at.change
    shortest, longest = ranges.least - ranges.rest_length, ranges.most - ranges.rest_length
    clearance = np.full(at.distance.shape, limits.clearance)
    stiff = np.full(at.eigenvalue.shape, limits.least_stiffness)
    # Margins and limits, kind by kind.
    rows = [
        ("least_tension", tension - limits.least_tension, limits.least_tension),
        ("most_tension", limits.most_tension - tension, limits.most_tension),
        ("yield", limits.yield_force - tension, limits.yield_force),
        ("yield", limits.yield_force + tension, limits.yield_force),
        ("buckling", tension + load, load),
        ("clearance", at.distance - clearance, clearance),
        ("range", change - shortest, shortest),
        ("range", longest - change, longest),
        ("least_stiffness", at.eigenvalue - stiff, stiff),
    ]
    # Their derivatives; buckling loads fall with the length.
    sloping: list[FloatArray | None] = [None] * len(rows)
    if slopes is not None:
        curve = np.where(np.isfinite(limits.buckling), -2 * limits.buckling / at.length**3, 0.0)
        bent = slopes.tension + curve[:, None] * slopes.length
        pull, pulled = ranges.pull, slopes.tension
        soft = slopes.eigenvalue if len(slopes.eigenvalue) else np.zeros((len(stiff), count))
        sloping = [pulled, -pulled, -pulled, pulled, bent, slopes.distance, pull, -pull, soft]
    # Sizes of limits near zero.
    force = max(at.point.largest_force, 1e-300)
    reference = {"clearance": at.point.longest, "range": at.point.longest, "least_stiffness": MIN_STIFFNESS}
    return _stack(rows, sloping, {kind: MIN_SIZE * reference.get(kind, force) for kind, *_ in rows})


def _stack(
    rows: list[tuple[str, FloatArray, FloatArray]], sloping: list[FloatArray | None], floor: dict[str, float]
) -> Margins:
    """Return the finite rows, one after the other."""
    kinds: list[str] = []
    index, value, size, bound, slope = [], [], [], [], []
    for (kind, margin, limit), derivative in zip(rows, sloping, strict=True):
        finite = np.flatnonzero(np.isfinite(margin))
        kinds += [kind] * len(finite)
        index.append(finite)
        value.append(margin[finite])
        size.append(np.maximum(np.abs(limit[finite]), floor[kind]))
        bound.append(limit[finite])
        if derivative is not None:
            slope.append(derivative[finite])
    return Margins(
        tuple(kinds),
        np.concatenate(index).astype(np.int64),
        np.concatenate(value),
        np.concatenate(size),
        np.concatenate(bound),
        np.concatenate(slope) if slope else None,
    )
