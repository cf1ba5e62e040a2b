"""Feet of a motion: when nodes touched the ground, how far they slid, and how hard they were pressed."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.integrate.event_log import EventLog
from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.system.arrays import FloatArray


@dataclass(frozen=True)
class Foot:
    """A node that touched the ground; forces and penetration are those of the samples.

    node: its name.
    first_touch [s]: when it touched first.
    touches: how often it touched, that at the start included.
    slide [m]: length of its way along the ground between samples at which it touched.
    largest_force [N]: largest normal force.
    largest_use: largest friction over friction that is possible, F / (mu N); 0 without friction.
    penetration [m]: largest penetration.
    """

    node: str
    first_touch: float
    touches: int
    slide: float
    largest_force: float
    largest_use: float
    penetration: float

    def as_dict(self) -> dict[str, Any]:
        """Return all by name, JSON-ready."""
        return asdict(self)


@dataclass(frozen=True)
class ContactSamples:
    """Contacts with the ground at the samples of a motion.

    time (n_t,) [s]; node: names of the contacts; position (n_t, n_contacts, 3) [m]; force (n_t, n_contacts,
    3) [N]; penetration (n_t, n_contacts) [m]; friction: coefficients (n_t,), None: that of the ground.
    """

    time: FloatArray
    node: tuple[str, ...]
    position: FloatArray
    force: FloatArray
    penetration: FloatArray
    friction: FloatArray | None = None


def find_feet(samples: ContactSamples, ground: Ground, log: EventLog) -> tuple[Foot, ...]:
    """Return the contacts that touched, those with the largest force first.

    log: events of the motion; without events of the ground times are those of samples.
    """
    normal = samples.force @ ground.normal
    tangential = np.linalg.norm(samples.force - normal[..., None] * ground.normal, axis=2)
    limit = (ground.friction if samples.friction is None else samples.friction[:, None]) * normal
    use = np.divide(tangential, limit, out=np.zeros_like(limit), where=limit > 0)
    moved = np.diff(samples.position, axis=0) - np.diff(samples.time)[:, None, None] * ground.velocity
    along = np.linalg.norm(moved - (moved @ ground.normal)[..., None] * ground.normal, axis=2)
    closed = samples.penetration > 0
    slide = np.where(closed[1:] & closed[:-1], along, 0.0).sum(axis=0)
    found = []
    for k, node in enumerate(samples.node):
        begun = [0.0] if closed[0, k] else []
        begun += [
            float(time)
            for time, kind, name, sign in zip(log.time, log.kind, log.name, log.direction, strict=True)
            if (kind, name, sign) == ("ground", node, 1)
        ]
        if not begun and closed[:, k].any():
            begun = samples.time[1:][closed[1:, k] & ~closed[:-1, k]].tolist()
        if begun:
            found.append(
                Foot(
                    node=node,
                    first_touch=begun[0],
                    touches=len(begun),
                    slide=float(slide[k]),
                    largest_force=float(normal[:, k].max()),
                    largest_use=float(use[:, k].max()),
                    penetration=float(max(samples.penetration[:, k].max(), 0.0)),
                )
            )
    return tuple(sorted(found, key=lambda foot: -foot.largest_force))
