"""Members against their limits: tension, yield stress, Euler buckling, strain."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.pickling import reduce_fields
from tensegrity_codegen.system.summaries import Summarised, describe_count, describe_range

MEMBER_CHECKS = ("least_tension", "most_tension", "yield_stress", "buckling")
BLOCK = 2**20  # tensions that are compared at a time
ROUNDING = 1e-9  # use above 1 that is no excess
MAX_STRAIN = 0.01  # of bars, and of members with a section, up to which materials are mostly linear
# The value that is compared with each limit, its unit, and the word of the limit.
WORDS = {
    "least_tension": ("tension", " N", "at least"),
    "most_tension": ("tension", " N", "at most"),
    "yield_stress": ("stress", " MPa", "at most"),
    "buckling": ("safety factor against buckling", "", "at least"),
}


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
        Its tension [N], stress [Pa], safety factor against buckling or strain, and the limit.
    use : float
        Part of the limit that is used, above 1.
    """

    member: str
    limit: str
    value: float
    allowed: float
    use: float


@dataclass(frozen=True, repr=False)
class MemberFlaws(Summarised):
    """Limits that members exceed.

    Attributes
    ----------
    exceeded : tuple of Exceeded
        Stated limits, the worst first, each member's in its worst state.
    doubtful : tuple of Exceeded
        The same where no limit is stated: ``"buckling"`` of members that buckle, and ``"strain"`` above
        1 %, of bars and of members with a section.
    """

    exceeded: tuple[Exceeded, ...]
    doubtful: tuple[Exceeded, ...]

    @property
    def is_beyond(self) -> bool:
        """Whether a stated limit is exceeded, or a member buckles."""
        return bool(self.exceeded) or any(flaw.limit == "buckling" for flaw in self.doubtful)

    def describe(self) -> list[str]:
        """Return a sentence for each kind of limit that is exceeded, for buckling, and for large strains."""
        sentences = []
        for group, is_stated in ((self.exceeded, True), (self.doubtful, False)):
            for limit in dict.fromkeys(flaw.limit for flaw in group):
                flaws = [flaw for flaw in group if flaw.limit == limit]
                name, value = flaws[0].member, flaws[0].value
                if is_stated:
                    description, unit, bound = WORDS[limit]
                    scale = 1e-6 if unit == " MPa" else 1.0
                    sentence = (
                        f"{name} has a {description} of {scale * value:.6g}{unit}, allowed is {bound} "
                        f"{scale * flaws[0].allowed:.6g}{unit}"
                    )
                elif limit == "buckling":
                    sentence = f"{name} buckles: its compression is {1 / value:.4g} times Euler's load"
                else:
                    sentence = (
                        f"{name} has a strain of {100 * value:.3g} %: most materials yield or are no longer "
                        f"linear above {100 * MAX_STRAIN:g} %"
                    )
                count_text = f" (and {describe_count(len(flaws) - 1, 'more member')})"
                sentences.append(sentence + (count_text if len(flaws) > 1 else ""))
        return sentences

    def as_evidence(self) -> dict[str, Any]:
        """Return the limits that are exceeded, and the doubtful values without a limit, JSON-ready."""
        return {name: [vars(flaw) for flaw in getattr(self, name)] for name in ("exceeded", "doubtful")}


@dataclass(frozen=True, repr=False)
class MemberChecks(MemberFlaws):
    """Members at some tensions, against their limits; with a leading axis where there are several states.

    Attributes
    ----------
    exceeded, doubtful : tuple of Exceeded
        As of `MemberFlaws`.
    stress : ndarray, shape (..., n_members) [Pa]
        Axial stress, positive in tension; nan without a section.
    strain : ndarray, shape (..., n_members) [1]
        Tension over EA of the unstrained member; nan of rigid bars.
    buckling_load : ndarray, shape (..., n_members) [N]
        Euler's load, pinned ends; nan for tension-only members, rigid bars, and without a section.
    buckling_factor : ndarray, shape (..., n_members)
        Euler's load over the compression: below 1 the member buckles; inf in tension, nan if not known.
    value, allowed, use : mapping of str to ndarray, shape (..., n_members); of allowed (n_members,)
        By the name of the limit: the value that is compared, the limit, and the part of the limit that is
        used: above 1 it is exceeded; nan where there is no limit, or no section.
    worst : tuple of (str, str, float), or None
        Member, limit and use, of the member that is nearest to one of its limits or farthest beyond.
    largest_use : ndarray, shape (...)
        Largest part that any member uses of its limits, of Euler's load and of 1 % strain; 0 without any.
    """

    stress: FloatArray
    strain: FloatArray
    buckling_load: FloatArray
    buckling_factor: FloatArray
    value: Mapping[str, FloatArray]
    allowed: Mapping[str, FloatArray]
    use: Mapping[str, FloatArray]
    worst: tuple[str, str, float] | None
    largest_use: FloatArray

    def __reduce__(self) -> tuple[Any, ...]:
        return reduce_fields(self)

    @property
    def member_use(self) -> FloatArray:
        """Largest part that each member uses of its stated limits, (..., n_members); nan without any."""
        largest: FloatArray = np.fmax.reduce([self.use[limit] for limit in MEMBER_CHECKS])
        return largest

    def as_dict(self, member_name: Sequence[str]) -> dict[str, Any]:
        """Return one state of the members, by name, JSON-ready."""

        def name(values: FloatArray) -> dict[str, float]:
            return dict(zip(member_name, values.tolist(), strict=True))

        worst = None if self.worst is None else dict(zip(("member", "limit", "use"), self.worst, strict=True))
        return {
            "is_met": not self.exceeded,
            "worst": worst,
            **self.as_evidence(),
            "use": {limit: name(self.use[limit]) for limit in MEMBER_CHECKS},
            "member_stress": name(self.stress),
            "buckling_load": name(self.buckling_load),
            "buckling_factor": name(self.buckling_factor),
        }


@np.errstate(all="ignore")
def check_members(
    structure: Structure | BodySystem,
    tension: FloatArray,
    length: FloatArray,
    *,
    elastic: FloatArray | None = None,
) -> MemberChecks:
    """Return members at tensions and lengths (..., n_members) [N, m] against the limits of a structure."""
    # sigma = t / A; P = pi^2 E I / l^2 with E I = mu rho (R^2 + r^2) / 4 (docs/members.md, Sections).
    limits = structure.limits.for_members(tension.shape[-1])
    area = structure.section_area
    elastic = structure.mu * structure.rest_length if elastic is None else elastic
    rigidity = elastic * structure.gyration_square
    stress = np.where(area > 0, tension / area, np.nan)
    strain = np.where(elastic > 0, tension / elastic, np.nan)
    is_known = ~structure.tension_only & (rigidity > 0)
    load = np.where(is_known, math.pi**2 * rigidity / length**2, np.nan)
    factor = np.where(is_known & (tension >= 0), np.inf, load / -tension)
    value = {"least_tension": tension, "most_tension": tension, "yield_stress": stress, "buckling": factor}
    allowed = {name: np.asarray(getattr(limits, name), dtype=float) for name in MEMBER_CHECKS}
    use = {
        "least_tension": _compare(-tension, -allowed["least_tension"]),
        "most_tension": _compare(tension, allowed["most_tension"]),
        "yield_stress": _compare(np.abs(stress), allowed["yield_stress"]),
        "buckling": np.where(allowed["buckling"] > 0, allowed["buckling"] / factor, np.nan),
    }
    names = structure.member_name
    solid = structure.is_bar | (structure.radius > 0)
    doubtful = {
        "buckling": np.where(allowed["buckling"] == 0, -tension / load, np.nan),
        "strain": np.where(solid, np.abs(strain) / MAX_STRAIN, np.nan),
    }
    threshold = {"buckling": np.ones_like(area), "strain": np.full_like(area, MAX_STRAIN)}
    return MemberChecks(
        stress=stress,
        strain=strain,
        buckling_load=load,
        buckling_factor=factor,
        value=MappingProxyType(value),
        allowed=MappingProxyType(allowed),
        use=MappingProxyType(use),
        exceeded=_list_exceeded(names, value, allowed, use),
        worst=_find_worst(names, use),
        largest_use=np.fmax.reduce([np.zeros_like(tension), *use.values(), *doubtful.values()]).max(
            axis=-1, initial=0.0
        ),
        doubtful=_list_exceeded(names, {**value, "strain": strain}, threshold, doubtful),
    )


def check_motion(structure: Structure | BodySystem, tension: FloatArray, position: FloatArray) -> MemberFlaws:
    """Return the limits that members exceed in any of many states, each in its worst state."""
    tension = tension.reshape(-1, structure.n_members)
    position = position.reshape(len(tension), -1, 3)
    worst: dict[str, dict[tuple[str, str], Exceeded]] = {"exceeded": {}, "doubtful": {}}
    size = max(1, BLOCK // max(structure.n_members, 1))
    for k in range(0, len(tension), size):
        positions = position[k : k + size]
        with np.errstate(all="ignore"):  # of motions that blow up
            length = structure.strands.lengths(positions)
        flaws = check_members(structure, tension[k : k + size], length)
        for name, worst_flaws in worst.items():
            for flaw in getattr(flaws, name):
                key = (flaw.member, flaw.limit)
                worst_flaws[key] = max(flaw, worst_flaws.get(key, flaw), key=lambda each: each.use)
    return MemberFlaws(**{name: _sort(worst_flaws.values()) for name, worst_flaws in worst.items()})


def summarise_tensions(structure: Structure | BodySystem, tension: FloatArray) -> dict[str, Any]:
    """Return the ranges of the tensions of cables and of bars, and which cables are slack in some state."""
    tension = tension.reshape(-1, len(structure.member_name))
    summary: dict[str, Any] = {}
    bars = structure.is_bar & ~structure.is_edge if isinstance(structure, Structure) else structure.is_bar
    for kind, rows in (("cable", ~structure.is_bar), ("bar", bars)):
        finite = tension[:, rows][np.isfinite(tension[:, rows])]
        summary[f"{kind}_tension"] = [finite.min(), finite.max()] if finite.size else None
    slack = (tension <= 0).any(axis=0) & structure.tension_only
    summary["slack_cables"] = [structure.member_name[e] for e in np.flatnonzero(slack)]
    return summary


def describe_tensions(data: Mapping[str, Any]) -> str:
    """Return such a summary as text: "cables 0 to 20 N (3 slack), bars -29.6 N"."""
    slack = len(data["slack_cables"])
    sentences = [
        f"{kind}s {describe_range(data[f'{kind}_tension'], 'N')}"
        + (f" ({slack} slack)" if slack and kind == "cable" else "")
        for kind in ("cable", "bar")
        if data[f"{kind}_tension"]
    ]
    return ", ".join(sentences) or "no member"


def _compare(value: FloatArray, most: FloatArray) -> FloatArray:
    """Return the part of the limit value <= most that is used: above 1 if it is exceeded; nan without one.

    A limit below zero asks for a value that is farther from zero.
    """
    below = np.where(value < 0, most / value, np.inf)
    none = np.where(value > 0, np.inf, 0.0)
    use = np.where(most > 0, np.maximum(value, 0.0) / most, np.where(most < 0, below, none))
    return np.where(np.isfinite(most) & ~np.isnan(value), use, np.nan)


def _list_exceeded(
    names: tuple[str, ...],
    value: Mapping[str, FloatArray],
    allowed: Mapping[str, FloatArray],
    use: Mapping[str, FloatArray],
) -> tuple[Exceeded, ...]:
    """Return the limits of which more than all is used, of each member in its worst state."""
    exceeded = []
    for limit, fraction in use.items() if names else ():
        states = np.nan_to_num(fraction.reshape(-1, len(names)), nan=-np.inf, posinf=np.inf)
        worst = states.argmax(axis=0) if len(states) else np.zeros(len(names), dtype=np.int64)
        for e in np.flatnonzero((states > 1 + ROUNDING).any(axis=0)).tolist():
            at = float(value[limit].reshape(-1, len(names))[worst[e], e])
            flaw = Exceeded(names[e], limit, at, float(allowed[limit][e]), float(states[worst[e], e]))
            exceeded.append(flaw)
    return _sort(exceeded)


def _sort(found: Iterable[Exceeded]) -> tuple[Exceeded, ...]:
    return tuple(sorted(found, key=lambda item: -item.use))


def _find_worst(names: tuple[str, ...], use: Mapping[str, FloatArray]) -> tuple[str, str, float] | None:
    """Return member, limit and use of the largest use of all."""
    known_rows = [(limit, row) for limit, row in use.items() if not np.isnan(row).all()]
    if not known_rows:
        return None
    limit, row = max(known_rows, key=lambda pair: float(np.nanmax(pair[1])))
    return names[int(np.nanargmax(row)) % len(names)], limit, float(np.nanmax(row))
