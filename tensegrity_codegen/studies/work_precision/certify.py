"""The reference of a report: two methods at their tightest, and by how much they agree."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.studies.work_precision.contender import Contender
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import ConvergenceError
from tensegrity_codegen.system.journal import read_record


@dataclass(frozen=True)
class Reference:
    """Positions (n_t, n_nodes, 3) [m] taken as true, and the largest difference [m] to the second opinion.

    Errors below ten times `uncertainty` are not told apart from the reference's own.
    """

    node_position: FloatArray
    first: str
    second: str
    uncertainty: float

    def error(self, node_position: FloatArray) -> float:
        """Return the largest error of a node coordinate [m]; infinite where samples are missing."""
        if node_position.shape != self.node_position.shape or not np.isfinite(node_position).all():
            return float("inf")
        return float(np.abs(node_position - self.node_position).max())

    def as_dict(self) -> dict[str, Any]:
        """Return the reference in JSON's types."""
        return dataclasses.asdict(self) | {"node_position": self.node_position.tolist()}

    @classmethod
    def from_dict(cls, data: Any, shape: tuple[int, ...]) -> "Reference | None":
        """Return the reference that `as_dict` wrote, with positions of this shape; None if it is none."""
        try:
            place = np.array(data["node_position"], dtype=np.float64)
            record = read_record(_Agreement, {key: data[key] for key in ("first", "second", "uncertainty")})
        except (KeyError, TypeError, ValueError, OverflowError):
            return None
        if record is None or place.shape != shape or not np.isfinite(place).all():
            return None
        return cls(place, record.first, record.second, record.uncertainty)


@dataclass(frozen=True)
class _Agreement:
    """Which two runs agree, and how well [m]."""

    first: str
    second: str
    uncertainty: float


def certify(contenders: list[Contender], progress: Callable[[float], None] | None = None) -> Reference:
    """Return the pair of results of different methods that agree best, found from the tightest setting up.

    Only contenders of the exact physics are asked: bars taken as rigid though they are not are left out.
    Raises ConvergenceError where no two methods come to an end.
    """
    found: list[tuple[str, FloatArray]] = []
    for number, contender in enumerate(contenders):
        if progress is not None:
            progress(number / len(contenders))
        for setting in sorted(contender.settings):
            contender.prepare(setting)
            run = contender.run(setting)()
            if run.status == "ok" and np.isfinite(run.node_position).all():
                found.append((f"{contender.name} at {setting:.0e}", run.node_position))
                break
    if len(found) < 2:
        raise ConvergenceError(
            "no two methods come to the end of this motion, so that nothing certifies a reference; "
            f"{', '.join(name for name, _ in found) or 'none'} did",
            where="report",
            hint="a shorter `t_end`",
        )
    pairs = [(float(np.abs(a[1] - b[1]).max()), a, b) for n, a in enumerate(found) for b in found[n + 1 :]]
    apart, first, second = min(pairs, key=lambda pair: pair[0])
    return Reference(first[1], first[0], second[0], apart)
