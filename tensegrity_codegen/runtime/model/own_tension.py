"""Tensions that an integrator found as unknowns of their own, put in place of those that follow from lengths.

A stiff member's extension is next to rounding beside its length: mu (l - rho) multiplies that rounding,
and the error of the positions, by mu. As an unknown the tension is known as well as the positions are. The
strain energy follows from it, (t - c l')^2 / (2 mu), none in a rigid member.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.runtime.model.placement import place_nodes, place_velocities
from tensegrity_codegen.system.arrays import FloatArray

# Change of a rigid member's tension over that of the elastic members beside it, at most.
MAX_AMPLIFICATION = 10.0


def put_own_tensions(
    model: Model,
    state: FloatArray,
    tension: FloatArray,
    members: Sequence[int],
    columns: Mapping[str, FloatArray],
    arguments: Mapping[str, Any],
) -> dict[str, FloatArray]:
    """Return member_tension and total_energy (n_t, ...) with the given tensions (n_t, len(members)) [N].

    state (n_t, n_states): the samples; columns: the results that follow from states. Tensions of rigid
    members that follow from states stay where the elastic ones do not spoil them: between two steps they are
    more exact than the polynomial of the method.
    """
    chosen = list(members)
    law = model.compute("member_law", **arguments)[chosen]
    mu, damping, rest_length = law[:, 1], law[:, 2], law[:, 0]
    if not mu.any():
        return dict(columns)
    member_tension, total_energy = columns["member_tension"].copy(), columns["total_energy"].copy()
    for row, (x, own) in enumerate(zip(state, tension[: len(state)], strict=True)):
        length, rate = _lengths(model, x, chosen, arguments)
        elastic = np.divide(own - damping * rate, mu, out=np.zeros_like(mu), where=mu > 0)
        by_length = length - rest_length
        total_energy[row] += float(0.5 * np.sum(mu * (elastic * elastic - by_length * by_length)))
        member_tension[row, chosen] = _choose(own, member_tension[row, chosen], mu)
    return {**columns, "member_tension": member_tension, "total_energy": total_energy}


def _choose(own: FloatArray, by_state: FloatArray, mu: FloatArray) -> FloatArray:
    """Return the more exact tensions (n_members,) [N]; those that follow from states only of rigid members.

    They carry the rounding of lengths of stiff members, which shows as the difference of their two tensions.
    A difference of a rigid member's that is far larger is an error of the method's own.
    """
    difference = np.abs(own - by_state)
    rounding = float(difference[mu > 0].sum())
    return np.where((mu == 0) & (difference > MAX_AMPLIFICATION * rounding), by_state, own)


def _lengths(
    model: Model, x: FloatArray, members: Sequence[int], arguments: Mapping[str, Any]
) -> tuple[FloatArray, FloatArray]:
    """Return lengths [m] and their rates [m/s] of some members at the state x."""
    n = len(x) // 2
    ends = np.array(model.manifest.connectivity)[list(members)]
    position = place_nodes(model, x[:n], arguments.get("anchor_position"), arguments=arguments)
    velocity = place_velocities(model, x[:n], x[n:], arguments=arguments)
    vector = position[ends[:, 0]] - position[ends[:, 1]]
    length = np.sqrt(np.sum(vector * vector, axis=1))
    along = np.sum(vector * (velocity[ends[:, 0]] - velocity[ends[:, 1]]), axis=1)
    return length, along / length
