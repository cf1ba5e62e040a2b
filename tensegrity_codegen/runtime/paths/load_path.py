"""The problem of a load path, equilibria g(q, lambda) = 0 with monitored functions, and its result."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.summaries import Fact, Summarised, describe_range

# Motions that cost no force, as orthonormal columns (n, k), at coordinates q where the stiffness is K.
NeutralMotions = Callable[[FloatArray, Any], FloatArray]
NEAR_BIFURCATION = 0.02  # of the smallest eigenvalues on both sides: a minimum below it is near zero
STABILITY_LOSS_EVENTS = ("limit", "bifurcation", "stability")  # events at which a stable path ends


class PathProblem(Protocol):
    """Equilibria g(q, lambda) = -dU/dq = 0 under a growing load; all values exact, none by differences.

    Any of the three may raise NonFiniteError: the step is then taken again, shorter.
    """

    def residual(self, coordinate: FloatArray, load_factor: float, /) -> FloatArray:
        """Return g, (n,)."""
        ...

    def stiffness(self, coordinate: FloatArray, load_factor: float, /) -> Any:
        """Return K = -dg/dq, symmetric (n, n), dense or sparse."""
        ...

    def load_vector(self, coordinate: FloatArray, load_factor: float, /) -> FloatArray:
        """Return f = dg/dlambda, (n,)."""
        ...


@dataclass(frozen=True)
class Watch:
    """Functions of the configuration whose zeros are events of the path."""

    falling: str  # kind of event where a value falls through zero; "" is no event
    names: tuple[str, ...]  # one for each value
    values: Callable[[FloatArray, float], FloatArray]  # (q, lambda) -> continuous (len(names),)
    rising: str = ""  # the same where a value rises
    is_kink: bool = False  # the stiffness jumps there: the path is cut and taken up anew
    stops: bool = False  # falling through zero ends the path


@dataclass(frozen=True, repr=False)
class PathEvent(Summarised):
    """Something that happens on the path, located by root finding."""

    kind: str  # "limit" of the load, "bifurcation", "stability", or what a Watch calls it
    names: tuple[str, ...]  # all that reach it at once, as by symmetry
    load_factor: float
    coordinate: FloatArray  # (n,)
    tangent: FloatArray  # (n + 1,), (dq, dlambda) on the way in
    point: int  # index into the points of the path
    mode: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))  # (n, k), without force

    def as_dict(self) -> dict[str, Any]:
        """Return the event as one JSON-ready object, without the configuration."""
        return {"kind": self.kind, "names": self.names, "load_factor": self.load_factor, "point": self.point}


@dataclass(frozen=True, repr=False)
class LoadPath(Summarised):
    """Equilibria along a load path, and its events.

    status: ``"completed"``: the load factor was reached; ``"stopped"``: an event ended the path;
        ``"returned"``: the path turned back to its floor; ``"step_limit"``: too many steps; ``"stalled"``: no
        equilibrium beyond the last point; ``"no_start"``: none at the start.
    """

    status: str
    message: str
    load_factor: FloatArray  # (n_points,)
    coordinate: FloatArray  # (n_points, n)
    residual: FloatArray  # (n_points,) largest entry of g
    smallest_eigenvalue: FloatArray  # (n_points,) of K, neutral motions left out
    load_rate: FloatArray  # (n_points,) dlambda/ds; negative where the load falls along the path
    events: tuple[PathEvent, ...]
    n_iterations: int
    internal: FloatArray | None = None  # (n_points, n_internal) [m], of members with memory

    def headline(self) -> str:
        """Return status and message."""
        return f"{self.status}, {self.message}"

    def facts(self) -> list[Fact]:
        """Return sizes, ranges and events, for `repr` and notebooks."""
        events = [f"{event.kind} at {event.load_factor:.6g}" for event in self.events]
        return [
            ("points", f"{len(self.load_factor)}, load factor {describe_range(self.load_factor)}"),
            ("smallest eigenvalue", describe_range(self.smallest_eigenvalue, "N/m")),
            ("events", ", ".join(events) or "none"),
            ("largest residual", describe_range(self.residual.max(initial=0.0), "N")),
        ]

    @property
    def is_followed(self) -> bool:
        """Whether the path led to the load asked for, or to an event that ends it."""
        return self.status in ("completed", "stopped")

    @property
    def stable_up_to(self) -> float | None:
        """Load factor beyond which points are unstable; None where all are stable."""
        unstable = np.flatnonzero(self.smallest_eigenvalue < 0)
        if not unstable.size:
            return None
        lost = [
            event.load_factor
            for event in self.find_events(*STABILITY_LOSS_EVENTS)
            if unstable[0] - 1 <= event.point <= unstable[0]
        ]
        return lost[0] if lost else float(self.load_factor[unstable[0]])

    @property
    def near_bifurcation(self) -> float | None:
        """Load factor at which the smallest eigenvalue passes near zero, and rises again; None without any.

        There a structure that differs a little, as a symmetric one whose coordinates are rounded, may lose
        its stability; its shape turns away instead (an imperfect bifurcation).
        """
        value = self.smallest_eigenvalue
        if len(value) < 3 or value.min() <= 0:
            return None
        before, after = np.maximum.accumulate(value), np.maximum.accumulate(value[::-1])[::-1]
        candidates = np.flatnonzero(value < NEAR_BIFURCATION * np.minimum(before, after))
        return float(self.load_factor[candidates[value[candidates].argmin()]]) if candidates.size else None

    def describe_stability(self, digits: int) -> list[str]:
        """Return sentences about where it is no longer stable, or hardly so."""
        if self.stable_up_to is not None:
            return [f"it is stable up to load factor {self.stable_up_to:.{digits}g} only"]
        if self.near_bifurcation is None:
            return []
        start, minimum = self.smallest_eigenvalue[0], self.smallest_eigenvalue.min()
        return [
            f"it passes near a bifurcation at load factor {self.near_bifurcation:.4g}, where the smallest "
            f"eigenvalue falls from {start:.3g} to {minimum:.3g} N/m: a structure that differs a little may "
            "lose its stability there"
        ]

    def find_events(self, *kinds: str) -> tuple[PathEvent, ...]:
        """Return the events of these kinds, in order; all of them if none is named."""
        return tuple(event for event in self.events if not kinds or event.kind in kinds)

    def as_evidence(self) -> dict[str, Any]:
        """Return the scalar results by name, JSON-ready, for reports and errors."""
        count = len(self.load_factor)
        return {
            "status": self.status,
            "message": self.message,
            "n_points": count,
            "n_iterations": self.n_iterations,
            "load_factor_end": float(self.load_factor[-1]) if count else None,
            "load_factor_most": float(self.load_factor.max()) if count else None,
            "residual_most": float(self.residual.max()) if count else None,
            "smallest_eigenvalue_end": float(self.smallest_eigenvalue[-1]) if count else None,
            "events": [event.as_dict() for event in self.events],
        }


@dataclass(frozen=True)
class PathPoint:
    """One equilibrium of a path."""

    coordinate: FloatArray
    load_factor: float
    residual: float
    smallest_eigenvalue: float
    load_rate: float
    internal: FloatArray | None = None


def collect_path(
    points: Iterable[PathPoint], events: Iterable[PathEvent], status: str, message: str, n_iterations: int
) -> LoadPath:
    """Return the path of these points."""
    rows = list(points)
    return LoadPath(
        status=status,
        message=message,
        load_factor=np.array([row.load_factor for row in rows]),
        coordinate=np.array([row.coordinate for row in rows]),
        residual=np.array([row.residual for row in rows]),
        smallest_eigenvalue=np.array([row.smallest_eigenvalue for row in rows]),
        load_rate=np.array([row.load_rate for row in rows]),
        events=tuple(events),
        n_iterations=n_iterations,
        internal=np.array([row.internal for row in rows]) if rows and rows[0].internal is not None else None,
    )
