"""Members against their limits: tension, yield stress, Euler buckling."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure

__all__ = ["MEMBER_CHECKS", "Exceeded", "MemberChecks", "check_members"]

FloatArray = NDArray[np.float64]

MEMBER_CHECKS = ("least_tension", "most_tension", "yield_stress", "buckling")
ROUNDING = 1e-9  # use above 1 that is no excess


@dataclass(frozen=True)
class Exceeded:
    """One limit that a member exceeds.

    Attributes
    ----------
    member : str
        Name of the member.
    limit : str
        ``"least_tension"``, ``"most_tension"``, ``"yield_stress"`` or ``"buckling"``.
    value, allowed : float
        Its tension [N], stress [Pa] or safety factor against buckling, and the limit.
    """

    member: str
    limit: str
    value: float
    allowed: float


@dataclass(frozen=True)
class MemberChecks:
    """Members at some tensions, against their limits.

    Attributes
    ----------
    stress : ndarray, shape (n_members,) [Pa]
        Axial stress, positive in tension; nan without a section.
    buckling_load : ndarray, shape (n_members,) [N]
        Euler's load, pinned ends; nan for tension-only members, rigid bars, and without a section.
    buckling_factor : ndarray, shape (n_members,)
        Euler's load over the compression: below 1 the member buckles; inf in tension, nan if not known.
    value, allowed, use : mapping of str to ndarray, shape (n_members,)
        By the name of the limit: the value that is compared, the limit, and the part of the limit that is
        used: above 1 it is exceeded; nan where there is no limit, or no section.
    exceeded : tuple of Exceeded
        Limits that are exceeded, the worst first.
    worst : tuple of (str, str, float), or None
        Member, limit and use, of the member that is nearest to one of its limits or farthest beyond.
    """

    stress: FloatArray
    buckling_load: FloatArray
    buckling_factor: FloatArray
    value: Mapping[str, FloatArray]
    allowed: Mapping[str, FloatArray]
    use: Mapping[str, FloatArray]
    exceeded: tuple[Exceeded, ...]
    worst: tuple[str, str, float] | None


def check_members(structure: Structure | BodySystem, tension: FloatArray, length: FloatArray) -> MemberChecks:
    """Return members against the limits of their structure.

    Parameters
    ----------
    structure : Structure or BodySystem
        With sections, stiffnesses and limits of its members.
    tension, length : ndarray, shape (n_members,) [N, m]
        Member tensions and lengths.

    Returns
    -------
    MemberChecks
        Stresses, buckling loads, and the part of each limit that is used.

    Notes
    -----
    sigma = t / A; P = pi^2 E I / l^2 with E I = mu rho (R^2 + r^2) / 4 (docs/model.md, Sections).
    """
    limits = structure.limits.for_members(len(tension))
    area = structure.section_area
    stress = np.divide(tension, area, out=np.full_like(tension, np.nan), where=area > 0)
    rigidity = structure.flexural_rigidity
    known = ~structure.tension_only & (rigidity > 0)
    load = np.full_like(tension, np.nan)
    load[known] = math.pi**2 * rigidity[known] / length[known] ** 2
    pressed = tension < 0
    factor = np.where(known, np.inf, np.nan)
    factor[known & pressed] = load[known & pressed] / -tension[known & pressed]
    value = {
        "least_tension": tension,
        "most_tension": tension,
        "yield_stress": stress,
        "buckling": factor,
    }
    allowed = {name: np.asarray(getattr(limits, name), dtype=float) for name in MEMBER_CHECKS}
    use = {
        "least_tension": _compare(-tension, -allowed["least_tension"]),
        "most_tension": _compare(tension, allowed["most_tension"]),
        "yield_stress": _compare(np.abs(stress), allowed["yield_stress"]),
        "buckling": np.where(allowed["buckling"] > 0, allowed["buckling"] / factor, np.nan),
    }
    names = structure.member_name
    return MemberChecks(
        stress=stress,
        buckling_load=load,
        buckling_factor=factor,
        value=MappingProxyType(value),
        allowed=MappingProxyType(allowed),
        use=MappingProxyType(use),
        exceeded=_list_exceeded(names, value, allowed, use),
        worst=_find_worst(names, use),
    )


def _compare(value: FloatArray, most: FloatArray) -> FloatArray:
    """Return the part of the limit value <= most that is used: above 1 where it is exceeded; nan without one.

    A limit below zero asks for a value that is farther from zero.
    """
    result = np.full_like(value, np.nan)
    stated = np.isfinite(most) & ~np.isnan(value)
    for e in np.flatnonzero(stated):
        x, limit = float(value[e]), float(most[e])
        if limit > 0:
            result[e] = max(x, 0.0) / limit
        elif limit == 0:
            result[e] = math.inf if x > 0 else 0.0
        else:
            result[e] = limit / x if x < 0 else math.inf
    return result


def _list_exceeded(
    names: tuple[str, ...],
    value: Mapping[str, FloatArray],
    allowed: Mapping[str, FloatArray],
    use: Mapping[str, FloatArray],
) -> tuple[Exceeded, ...]:
    found = [
        (float(use[limit][e]), Exceeded(names[e], limit, float(value[limit][e]), float(allowed[limit][e])))
        for limit in MEMBER_CHECKS
        for e in np.flatnonzero(use[limit] > 1 + ROUNDING)
    ]
    return tuple(item for _, item in sorted(found, key=lambda pair: -pair[0]))


def _find_worst(names: tuple[str, ...], use: Mapping[str, FloatArray]) -> tuple[str, str, float] | None:
    known = [(limit, row) for limit, row in use.items() if not np.isnan(row).all()]
    if not known:
        return None
    limit, row = max(known, key=lambda pair: float(np.nanmax(pair[1])))
    e = int(np.nanargmax(row))
    return names[e], limit, float(row[e])
