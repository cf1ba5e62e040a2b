"""Load paths on the ground: steps of the load, each with the bristles of the one before, and their events."""

from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.runtime.paths.load_path import LoadPath, PathEvent, PathPoint, collect_path
from tensegrity_codegen.runtime.paths.model_path import ModelPath
from tensegrity_codegen.runtime.statics.equilibrium import build_problem, find_equilibrium
from tensegrity_codegen.runtime.statics.newton import Outcome, find_stability
from tensegrity_codegen.runtime.statics.on_ground import Feet, describe_feet, step_on_ground
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.static_methods import FOUND

LOCATED = 1e-7  # of the path: how closely events are located
TOLERANCE = 1e-9
MAX_ITERATIONS = 200  # of the search in a step
KINDS = {"open": "lift", "slip": "slip", "stick": "stick"}  # kind of event by the state that begins
ENDS = ("slides", "tips", "lifts_off")  # how structures cease to stand
MAX_POINTS = 1000


@dataclass(frozen=True)
class _State:
    """An equilibrium of the path."""

    load_factor: float
    coordinate: FloatArray
    position: FloatArray
    feet: Feet
    residual: float
    eigenvalue: float


def follow_ground_path(path: ModelPath, *, most: float = 1.0, largest_step: float = 0.1) -> LoadPath:
    """Follow the equilibrium on the ground while loads grow, up to where the structure no longer stands.

    path: what `build_path` returns for a structure on the ground; most: load factor to reach; largest_step:
    largest step, as a part of `most`.
    Returns points and events: feet that `lift`, `touch`, `slip`, `stick`, and where it `slides`, `tips` or
    `lifts_off`, which end the path with the status ``"stopped"``. Their load factors are located to 1e-7 of
    `most`. ``"stalled"`` where no equilibrium is found otherwise, ``"step_limit"`` after 1,000 steps. Raises
    ConvergenceError: the structure does not stand at load factor 0.

    Friction depends on the way: a step starts from the bristles of the one before. A step in which a foot
    changes its state is halved until that is located.
    """
    begun = find_equilibrium(path.model, arguments=path.static_arguments(0.0))
    assert begun.feet is not None
    here = _State(
        0.0, begun.coordinate, begun.node_position, begun.feet, begun.residual, begun.smallest_eigenvalue
    )
    points, events, step, iterations = [here], list[PathEvent](), largest_step, 0
    status, message = "completed", "the load factor was reached"
    thorough = False  # Newton's method alone has found nothing since feet last changed their state
    while here.load_factor != most:
        if len(points) > MAX_POINTS:
            status, message = "step_limit", f"the load was not reached in {MAX_POINTS} steps"
            break
        remaining = 1.0 - here.load_factor / most
        is_last = step >= remaining
        is_located = min(step, remaining) <= LOCATED
        load_factor = most if is_last else here.load_factor + step * most
        outcome = _take_step(path, here, load_factor, at_any_cost=thorough or is_located)
        iterations += 1
        if isinstance(outcome, Outcome):
            if is_located and outcome.status in ENDS:
                status, message = "stopped", outcome.message
                events.append(_record(outcome.status, here.feet.node_name, here, len(points) - 1))
                break
            if is_located:
                status = "stalled"
                message = (
                    f"no equilibrium was found beyond load factor {here.load_factor:.10g}: {outcome.message}"
                )
                break
            step = min(step, remaining) / 2
            continue
        changes = _find_changes(here.feet, outcome.feet)
        if changes and not is_located:
            step = min(step, remaining) / 2
            continue
        thorough = (thorough or is_located) and not changes
        here = outcome
        points.append(here)
        events += [_record(kind, names, here, len(points) - 1) for kind, names in changes.items()]
        step = largest_step if changes else min(2 * step, largest_step)
    rows = [PathPoint(p.coordinate, p.load_factor, p.residual, p.eigenvalue, 1.0) for p in points]
    return collect_path(rows, events, status, message, iterations)


def _take_step(path: ModelPath, here: _State, load_factor: float, *, at_any_cost: bool) -> _State | Outcome:
    """Return the equilibrium at a load factor, or the outcome; at_any_cost: by a search for a minimum too."""
    problem = build_problem(path.model, path.static_arguments(load_factor))
    most_iterations = MAX_ITERATIONS if at_any_cost else 0
    state = here.coordinate, here.position, here.feet
    outcome = step_on_ground(problem, *state, tolerance=TOLERANCE, max_iterations=most_iterations)
    if outcome.status not in FOUND:
        return outcome
    point = outcome.point
    eigenvalue = (outcome.stability or find_stability(problem, point)).model_eigenvalue
    at, position = problem.to_model_coordinate(point.coordinate), problem.node_position(point.coordinate)
    feet = describe_feet(problem, point.coordinate)
    return _State(load_factor, at, position, feet, point.node_force, eigenvalue)


def _find_changes(before: Feet, after: Feet) -> dict[str, tuple[str, ...]]:
    """Return kind of event -> the feet whose state changes so."""
    changes: dict[str, tuple[str, ...]] = {}
    for name, old, new in zip(before.node_name, before.state, after.state, strict=True):
        if old != new:
            kind = "touch" if old == "open" else KINDS.get(new, new)
            changes[kind] = (*changes.get(kind, ()), name)
    return changes


def _record(kind: str, names: tuple[str, ...], at: _State, point: int) -> PathEvent:
    return PathEvent(kind, names, at.load_factor, at.coordinate, np.zeros(len(at.coordinate) + 1), point)
