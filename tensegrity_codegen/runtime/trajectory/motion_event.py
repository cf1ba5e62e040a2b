"""An event that ends a motion: contact of bars, or a condition."""

from dataclasses import dataclass
from typing import Any

from tensegrity_codegen.system.arrays import FloatArray


@dataclass(frozen=True)
class MotionEvent:
    """What has ended a motion.

    kind: "contact" or "condition"; names: all pairs of bars that touch at once, as by symmetry, or the
    condition; time [s]; margin: distance of these bars [m], zero to rounding, negative where the motion
    started with an overlap; coordinate, velocity (n_coordinates,): the state there.
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
