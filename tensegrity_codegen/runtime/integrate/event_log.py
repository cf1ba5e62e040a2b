"""Events that integrators in C cut their steps at: what to watch, and the log of what happened."""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.system.summaries import Summarised
from tensegrity_codegen.tables.manifest import EVENT_KINDS, JUMP_KINDS, IntegratorSpec, Manifest

# (time [s], coordinate, velocity) -> a number; where its sign changes is an event.
Condition = Callable[[float, FloatArray, FloatArray], float]

MAX_LOGGED = 100_000  # events of one run that are kept
NAME_OF_KIND = {bit: kind for kind, bit in EVENT_KINDS.items()}


@dataclass(frozen=True)
class Watch:
    """The kinds of events at which steps are cut, those that end the run, and a condition of one's own."""

    kinds: tuple[str, ...] = ()
    stop: tuple[str, ...] = ()
    condition: Condition | None = None

    @property
    def bits(self) -> int:
        """The kinds as C takes them."""
        return sum(EVENT_KINDS[kind] for kind in set(self.kinds))

    @property
    def stop_bits(self) -> int:
        """The kinds that end the run as C takes them."""
        return sum(EVENT_KINDS[kind] for kind in set(self.stop))


@dataclass(frozen=True, repr=False)
class EventLog(Summarised):
    """Events in the order of time; rows (n,) of time [s], kind, name of member or pair, direction.

    direction: 1 where a cable goes taut, a member grows longer than where its law switches, bars part
    (contact) or begin to press each other (collision), a node touches the ground, its contact sticks, a
    plastic member ends to flow, the rate of a motor ends to be limited, a cable sticks at a ring or the
    condition becomes positive, -1 for the reverse.
    count: how many there were, of which the first MAX_LOGGED are kept.
    """

    time: FloatArray = field(default_factory=lambda: np.empty(0))
    kind: tuple[str, ...] = ()
    name: tuple[str, ...] = ()
    direction: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    count: int = 0

    @classmethod
    def from_rows(cls, rows: NDArray[Any], count: int, manifest: Manifest) -> "EventLog":
        """Return the log of the C structures `rows`, of `count` events in all."""
        kinds = tuple(NAME_OF_KIND[bit] for bit in rows["kind"].tolist())
        names = {
            "cable": manifest.member_name,
            "switch": manifest.member_name,
            "contact": manifest.bar_pair_name,
            "collision": manifest.bar_pair_name,
            "ground": manifest.contact_name,
            "stick": manifest.contact_name,
            "motor": manifest.motor_name,
            "ring": manifest.ring_name,
            "yield": tuple(name.rsplit("_", 1)[0] for name in manifest.subjects_of("yield")),
            "condition": ("condition",),
        }
        return cls(
            time=rows["time"].copy(),
            kind=kinds,
            name=tuple(names[kind][which] for kind, which in zip(kinds, rows["which"].tolist(), strict=True)),
            direction=rows["direction"].astype(np.int64),
            count=count,
        )

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what a result file holds of it."""
        return {
            "log_time": self.time,
            "log_kind": np.array(self.kind, dtype=np.str_),
            "log_name": np.array(self.name, dtype=np.str_),
            "log_direction": self.direction,
        }


EMPTY_LOG = EventLog()


def choose_watch(spec: IntegratorSpec, manifest: Manifest, watch: Watch | None) -> Watch:
    """Return what to watch: as asked, or what makes stiffness jump if the integrator knows it.

    Raises FormulationError for kinds that the integrator of this library was not built for.
    """
    if watch is None:
        return Watch(tuple(kind for kind in spec.events if kind in JUMP_KINDS))
    if missing := [kind for kind in watch.kinds if kind not in spec.events]:
        raise FormulationError(
            "the integrator was built without these events",
            where=f"{manifest.name}: {spec.name}",
            given=", ".join(missing),
            allowed=", ".join(spec.events) or "none",
            hint=f"state events = {json.dumps(sorted({*spec.events, *missing}))} under [model] in the scene",
        )
    return watch
