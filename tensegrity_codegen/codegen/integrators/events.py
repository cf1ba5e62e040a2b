"""Events that integrators watch: their kinds, quantities and memory."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from tensegrity_codegen.codegen.integrators.work_memory import count_bytes
from tensegrity_codegen.structure.memory import find_setting_events
from tensegrity_codegen.structure.sliding import name_rings
from tensegrity_codegen.system.errors import FormulationError, suggest
from tensegrity_codegen.system.summaries import describe_count
from tensegrity_codegen.tables.manifest import (
    EVENT_KINDS,
    JUMP_KINDS,
    SET_STATES,
    FunctionSpec,
    IntegratorSpec,
    Manifest,
)
from tensegrity_codegen.tables.request import AUTO_EVENTS, ModelRequest

if TYPE_CHECKING:  # a motion chooses its events without CasADi
    from tensegrity_codegen.codegen.emitter import EmittedModel

# The quantity of each kind of event; the condition is the caller's.
EVENT_QUANTITIES = {
    "cable": "cable_margin",
    "switch": "switch_margin",
    "contact": "bar_distance",
    "collision": "collision_margin",
    "ground": "contact_margin",
    "stick": "stick_margin",
    "yield": "yield_margin",
    "motor": "motor_margin",
    "ring": "ring_margin",
}
# Kinds at which forces that depend on velocities do not jump; next to each other among EVENT_KINDS, those at
# which contacts begin first.
BEGINNINGS = ("collision", "ground")
CONTINUOUS = (*BEGINNINGS, "stick", "yield", "motor", "ring")
MAX_WATCHED = 400  # cables, switches and contacts whose events "auto" watches
MAX_IN_SUCCESSION = 150  # events, each within a thousandth of a step of the one before


@dataclass(frozen=True)
class WatchedEvents:
    """The events that an integrator of a model can monitor.

    kinds: of events; quantities: whose changes of sign these are; cables: indices of the members watched,
    those that go slack, then those whose law switches; unwatched: how many of either sort are not; memory:
    doubles that the search works with.
    """

    kinds: tuple[str, ...]
    quantities: tuple[str, ...]
    cables: tuple[int, ...]
    unwatched: int
    memory: int


def watched_events(
    model: "EmittedModel", functions: Sequence[FunctionSpec], kinds: tuple[str, ...]
) -> WatchedEvents:
    """Return the events that integrators can monitor with these functions."""
    quantities = tuple(EVENT_QUANTITIES[kind] for kind in kinds if kind in EVENT_QUANTITIES)
    slack = tuple(int(e) for e in np.flatnonzero(model.subject.tension_only))
    switching = tuple(int(e) for e in np.flatnonzero(model.subject.has_switch))
    cables = slack if "cable" in kinds else ()
    switches = switching if "switch" in kinds else ()
    memory = event_memory(kinds, functions, state_sizes(model))
    unwatched = len({*slack, *switching} - {*cables, *switches})
    return WatchedEvents(kinds, quantities, (*cables, *switches), unwatched, memory)


def state_sizes(model: "EmittedModel") -> dict[str, int]:
    """Return the sizes of a state in C, by their names there."""
    n, internal = len(model.frame.coordinate_name), model.frame.n_internal
    return {"N": n, "N_STATES": 2 * n + internal, "N_SLOPES": n + internal, "N_OLD": 3 * n + 2 * internal}


def event_memory(kinds: Sequence[str], functions: Iterable[FunctionSpec], sizes: Mapping[str, int]) -> int:
    """Return how many doubles the search for events of these kinds works with, event_memory in C."""
    quantities = [EVENT_QUANTITIES[kind] for kind in kinds if kind in EVENT_QUANTITIES]
    margins = 1 + sum(function.shape[0] for function in functions if function.quantity in quantities)
    return count_bytes("event_memory", "events.h", {**sizes, "N_MARGINS": margins}) // 8 if kinds else 0


def choose_events(request: ModelRequest, subject: Any) -> tuple[str, ...]:
    """Return the kinds of events that "auto" stands for: jumps of stiffness, and a condition.

    subject: the structure or body system. None if no stiffness jumps, or that of more than MAX_WATCHED
    members does: each event ends a step, and thousands of cables leave no time in between.
    """
    counts = {"cable": int(subject.tension_only.sum()), "switch": int(subject.has_switch.sum())}
    if getattr(subject, "collision", None):
        counts["collision"] = subject.n_bar_pairs
    if ground := getattr(subject, "ground", None):
        counts |= {"ground": ground.n_contacts, "stick": ground.n_contacts if ground.friction else 0}
    setting = find_setting_events(subject)
    counts |= {
        "yield": 2 * int(subject.yields.sum()),
        "motor": sum(actuator.time_constant > 0 for actuator in subject.actuators),
        "ring": len(name_rings(subject.sliding)),
    }
    if setting and sum(counts.values()) > MAX_WATCHED:
        counts = {kind: counts[kind] for kind in counts if kind in (*setting, "ground")}
    if not 0 < sum(counts.values()) <= MAX_WATCHED or request.precision != "double":
        return ()
    return (*(kind for kind, count in counts.items() if count), "condition")


def describe_unwatched(request: ModelRequest, subject: Any) -> str:
    """Return what steps that end at no event mean for motions, and the key that changes it; "" if nothing."""
    kinds, n_slack = choose_events(request, subject)[:-1], int(subject.tension_only.sum())
    if not kinds:
        return ""
    slack = f"where one of {describe_count(n_slack, 'cable')} goes slack or taut"
    place = slack if "cable" in kinds else f"at events {', '.join(kinds)}"
    return f'a step loses its order {place}; events = ["auto"] under [model] ends steps there'


def find_events(
    request: ModelRequest, is_offered: Callable[[str], bool], subject: Any
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the kinds of events that integrators shall watch, and the quantities that these take.

    A request without the key has none, but "auto" where motions would be wrong without: if events set
    internal states, or motions are differentiated.
    """
    if not request.integrators:
        return (), ()
    kinds = request.events
    if kinds is None:
        kinds = AUTO_EVENTS if find_setting_events(subject) or request.differentiates_motions else ()
    chosen = choose_events(request, subject) if set(AUTO_EVENTS) & set(kinds) else ()
    kinds = tuple(kind for kind in kinds if kind not in AUTO_EVENTS)
    if kinds and request.precision != "double":
        raise FormulationError(
            "events need double precision",
            where="model.events",
            given=f"{', '.join(kinds)} with precision {request.precision!r}",
            allowed="no events in single precision",
        )
    jumps = tuple(kind for kind in chosen if kind in JUMP_KINDS and is_offered(EVENT_QUANTITIES[kind]))
    kinds = (*kinds, *jumps, "condition") if jumps else kinds
    for kind in kinds:
        if kind not in EVENT_KINDS:
            raise FormulationError(
                "unknown kind of event", where="model.events", given=kind, hint=suggest(kind, EVENT_KINDS)
            )
    ordered = tuple(kind for kind in EVENT_KINDS if kind in kinds)
    return ordered, tuple(EVENT_QUANTITIES[kind] for kind in ordered if kind in EVENT_QUANTITIES)


def events_context(
    manifest: Manifest,
    spec: IntegratorSpec,
    functions: Mapping[str, FunctionSpec],
    reach: Mapping[str, int] = MappingProxyType({}),
) -> dict[str, Any]:
    """Return the context of the templates of events; spec: an integrator that monitors them.

    reach: quantity -> how many coordinates, from the first, it depends on; all of those that it lacks.
    """
    offset = 0
    kinds: list[dict[str, Any]] = []
    for event in spec.events:
        if event in EVENT_QUANTITIES:
            function = functions[EVENT_QUANTITIES[event]]
            kinds.append(
                {
                    "word": event,
                    "quantity": function.quantity,
                    "arguments": function.arguments,
                    "first": offset,
                    "count": function.shape[0],
                }
            )
            offset += function.shape[0]
    setting = [kind for kind in SET_STATES if manifest.subjects_of(kind)]
    continuous = tuple(kind for kind in CONTINUOUS if kind != "stick" or "stick" not in setting)
    contacts = [kind for kind in kinds if kind["word"] in BEGINNINGS]
    position = np.array(manifest.node_position).reshape(-1, 3)
    n_coordinates = len(manifest.coordinate_name)
    return {
        "kinds": kinds,
        "cables": list(spec.cables),
        "n_margins": offset + 1,
        "first_contact": contacts[0]["first"] if contacts else 0,
        "n_contacts": sum(kind["count"] for kind in contacts),
        "n_kinks": sum(kind["count"] for kind in kinds if kind["word"] in continuous),
        "setting": setting,
        "first_stick": next((kind["first"] for kind in kinds if kind["word"] in setting), 0),
        "n_yields": len(manifest.subjects_of("yield")),
        "n_rings": len(manifest.ring_name),
        "n_slips": sum(len(manifest.subjects_of(kind)) for kind in setting),
        "n_measured": max(
            (reach.get(kind["quantity"], n_coordinates) for kind in kinds), default=n_coordinates
        ),
        "size": repr(float(manifest.strands.lengths(position).max(initial=0.0))),
        "is_smooth": all(kind["word"] in continuous or "velocity" not in kind["arguments"] for kind in kinds),
        "most_in_succession": MAX_IN_SUCCESSION,
    }
