"""An event that a motion was searched for: contact of bars, a slack cable, a condition."""

from dataclasses import dataclass
from typing import Any

from tensegrity_codegen.system.arrays import FloatArray


@dataclass(frozen=True)
class MotionEvent:
    """Something that happens for the first time in a motion.

    kind: "contact", "slack" or "condition"; names: all pairs of bars, or cables, that it happens to at once,
    as by symmetry; time [s]; margin: distance or extension there [m], zero to rounding, negative where the
    motion started beyond; coordinate, velocity (n_coordinates,): the state there.
    """

    kind: str
    names: tuple[str, ...]
    time: float
    margin: float
    coordinate: FloatArray
    velocity: FloatArray

    def as_dict(self) -> dict[str, Any]:
        """Return the event as one JSON-ready object, without the state."""
        return {"kind": self.kind, "names": self.names, "time": self.time, "margin": self.margin}
