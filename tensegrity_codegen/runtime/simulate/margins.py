"""Values along a motion that are positive as long as nothing happens, and the rates at which they change."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.integrate.motion import Schedule
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes, place_velocities
from tensegrity_codegen.runtime.model.require import require_double, require_quantities
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.manifest import FunctionSpec

Evaluate = Callable[[float, FloatArray], FloatArray]

# What contacts and slack cables need of a model besides what a simulation needs.
CONTACT_QUANTITIES = ("bar_distance", "bar_distance_jacobian")
SLACK_QUANTITIES = ("member_extension",)

UNSTRETCHED = 1e-12  # of its length, below which a cable counts as neither taut nor slack at the start
TIME_NUDGE = 1e-6  # of a second, for the rates of scheduled rest lengths


@dataclass(frozen=True)
class Margins:
    """Named values of (time [s], state (n_states,)); where one falls through zero, `kind` happens.

    values (n,), rates (n,) per second; at the start of a motion it has happened to those up to `floor` (n,).
    """

    kind: str
    names: tuple[str, ...]
    values: Evaluate
    rates: Evaluate
    floor: FloatArray


def build_contact_margins(model: CompiledModel, arguments: Mapping[str, Any]) -> Margins:
    """Return the distances between bars [m], pair by pair, with rates dD/dq q'.

    Raises FormulationError where the model lacks bar_distance or its Jacobian.
    """
    require_double(model.manifest, "the search for events")
    require_quantities(model, CONTACT_QUANTITIES, "these events need")
    n, names = len(model.manifest.coordinate_name), model.manifest.bar_pair_name

    function = model.function("bar_distance_jacobian")
    row, column = _places(function.spec)
    passed = {name: arguments.get(name, model.nominal(name)) for name in function.arguments}

    def distance(time: float, state: FloatArray) -> FloatArray:
        return np.asarray(model.compute("bar_distance", coordinate=state[:n], **arguments))

    def rate(time: float, state: FloatArray) -> FloatArray:
        # The product of the Jacobian's non-zeros: to build a sparse array takes ten times as long.
        given = [state[:n] if name == "coordinate" else value for name, value in passed.items()]
        products = function.values(given, None) * state[n:][column]
        return np.bincount(row, weights=products, minlength=len(names)).astype(np.float64)

    return Margins("contact", names, distance, rate, np.zeros(len(names)))


def build_slack_margins(
    model: CompiledModel,
    members: tuple[str, ...],
    arguments: Mapping[str, Any],
    schedule: Schedule | None = None,
) -> Margins:
    """Return the extensions l - rho [m] of these members, with rates d . (v_i - v_j) / l - rho'.

    Raises FormulationError where the model lacks member_extension or has no such member.
    """
    require_double(model.manifest, "the search for events")
    require_quantities(model, SLACK_QUANTITIES, "these events need")
    manifest, n = model.manifest, len(model.manifest.coordinate_name)
    if unknown := [name for name in members if name not in manifest.member_name]:
        raise FormulationError("the model has no such member", where=manifest.name, given=", ".join(unknown))
    rows = [manifest.member_name.index(name) for name in members]
    first, second = np.array([manifest.connectivity[row] for row in rows], dtype=np.int64).reshape(-1, 2).T

    def extension(time: float, state: FloatArray) -> FloatArray:
        given = {**arguments, **(schedule(time) if schedule else {})}
        return np.asarray(model.compute("member_extension", coordinate=state[:n], **given))[rows]

    def rate(time: float, state: FloatArray) -> FloatArray:
        q, v = state[:n], state[n:]
        place = place_nodes(model, q, arguments.get("anchor_position"), arguments=arguments)
        speed = place_velocities(model, q, v, arguments=arguments)
        vector = place[first] - place[second]
        stretch = np.sum(vector * (speed[first] - speed[second]), axis=1) / np.linalg.norm(vector, axis=1)
        if schedule is None:
            return np.asarray(stretch)
        later, earlier = extension(time + TIME_NUDGE, state), extension(max(time - TIME_NUDGE, 0.0), state)
        return np.asarray(stretch + (later - earlier) / (TIME_NUDGE + min(time, TIME_NUDGE)))

    place = np.array(manifest.node_position)
    length = np.linalg.norm(place[first] - place[second], axis=1)
    return Margins("slack", members, extension, rate, -UNSTRETCHED * length)


def _places(spec: FunctionSpec) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return row and column of every non-zero of a sparse function."""
    if spec.pattern is None:
        raise FormulationError("the function is not sparse", where=spec.quantity)
    counts = np.diff(spec.pattern.column_start)
    return np.array(spec.pattern.row, dtype=np.int64), np.repeat(np.arange(len(counts)), counts)
