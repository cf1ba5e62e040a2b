"""Frequencies and decay rates of a structure, bounded from members or found by iteration.

With K = sum of mu_e g_e g_e^T over the members, the eigenvalues of H^-1 K are at most (Gershgorin, rows
scaled by roots of masses)

    max over nodes i of   sum over members e = (i, j) of   mu_e (1 / m_i + 1 / sqrt(m_i m_j))

and those of H^-1 C the same with damping constants. Cables count as taut, a mass as the least that a row of
H leaves. Without laws of members, the largest frequency comes by power iteration on differences of
accelerations.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.system.arrays import FloatArray

POSITION_ROUNDING = 5e-17  # of positions, in velocities that steps still hold
RATE_QUANTITIES = ("member_law", "mass_matrix")  # that rates follow from
# Of two evaluations; a few percent from below where frequencies lie close together, ten percent with few.
ITERATIONS, FEW_ITERATIONS = 12, 6
DISPLACEMENT = 1e-6  # of the largest coordinate, by which coordinates are moved
LEAST_JUMP_RATIO = 0.75  # of a difference of twice the length over a difference: 1 where forces are smooth


@dataclass(frozen=True)
class Rates:
    """Bounds from above. frequency, decay: of all members [rad/s], [1/s]; slow_*: of all but the stiff ones.

    Stiff are the two-sided members whose tensions the implicit method takes as unknowns. stiffness_ratio:
    the largest mu of these over the largest of the others, infinite where there are no others; meeting: how
    many of them meet in one node at most.
    """

    frequency: float
    decay: float
    slow_frequency: float
    slow_decay: float
    stiffness_ratio: float
    meeting: int


def find_rates(model: Model, stiff: tuple[int, ...], arguments: Mapping[str, Any]) -> Rates | None:
    """Return the rates at these arguments; None where the library has no member_law and no mass_matrix.

    stiff: indices of the members that count as stiff.
    """
    if not (model.has("member_law") and model.has("mass_matrix")):
        return None
    if isinstance(model, CompiledModel):
        specs = (spec for spec in model.manifest.functions if spec.quantity in RATE_QUANTITIES)
        if all(set(spec.arguments).isdisjoint(arguments) for spec in specs):  # the same at each call
            return cast(Rates, model.keep(("rates", stiff), lambda: _find_rates(model, stiff, {})))
    return _find_rates(model, stiff, arguments)


def _find_rates(model: Model, stiff: tuple[int, ...], arguments: Mapping[str, Any]) -> Rates:
    """Return the rates at these arguments."""
    law = np.asarray(model.compute("member_law", **arguments))
    mu, c = law[:, 1], law[:, 2]
    mass = _node_mass(model, arguments)
    strands = model.manifest.strands
    ends, mu, c = strands.ends, strands.spread(mu), strands.spread(c)
    is_stiff = np.isin(strands.member, stiff)
    frequency, decay = (_bound(values, mass, ends) for values in (mu, c))
    slow, slow_decay = (_bound(np.where(is_stiff, 0.0, values), mass, ends) for values in (mu, c))
    moves = np.isfinite(mass)[ends].any(axis=1)  # not between two anchors
    elastic, others = mu[is_stiff & moves & (mu > 0)], mu[~is_stiff & moves]
    soft = float(others.max(initial=0.0))
    ratio = float(elastic.max(initial=0.0)) / soft if soft > 0 else (np.inf if elastic.size else 0.0)
    count = np.bincount(ends[is_stiff].ravel(), minlength=len(mass))
    return Rates(
        frequency=float(np.sqrt(frequency)),
        decay=decay,
        slow_frequency=float(np.sqrt(slow)),
        slow_decay=slow_decay,
        stiffness_ratio=ratio,
        meeting=int(count[np.isfinite(mass)].max(initial=1)),
    )


def _node_mass(model: Model, arguments: Mapping[str, Any]) -> FloatArray:
    """Return the least mass of each node on a free axis, (n_nodes,); infinite where all are anchored."""
    if isinstance(model, CompiledModel):
        row, column, value = model.compute_entries("mass_matrix", **arguments)
    else:
        matrix = model.compute("mass_matrix", **arguments).tocoo()
        row, column, value = matrix.row, matrix.col, matrix.data
    diagonal = np.zeros(len(model.manifest.coordinate_place))
    diagonal[row[row == column]] = value[row == column]
    spread = np.bincount(row, np.abs(value), len(diagonal)) - np.abs(diagonal)
    least = np.maximum(diagonal - spread, 1e-3 * diagonal)
    mass = np.full(len(model.manifest.node_name), np.inf)
    np.minimum.at(mass, model.manifest.coordinate_place[:, 0], least)
    return mass


def _bound(values: FloatArray, mass: FloatArray, ends: NDArray[np.int64]) -> float:
    """Return the largest eigenvalue that members of these constants can cause between these masses."""
    inverse = 1.0 / mass
    total = np.zeros(len(mass))
    for one, other in ((0, 1), (1, 0)):
        i, j = ends[:, one], ends[:, other]
        np.add.at(total, i, values * (inverse[i] + np.sqrt(inverse[i] * inverse[j])))
    return float(total.max(initial=0.0))


def find_noise(motion: Motion, frequency: float) -> float:
    """Return what rounding of coordinates that forces depend on makes of velocities [m/s].

    frequency: [rad/s].
    """
    is_centre = motion.model.manifest.is_centre
    place = motion.state[: len(is_centre)][~is_centre]
    return POSITION_ROUNDING * float(np.abs(place).max(initial=0.0)) * frequency


def find_fastest(motion: Motion, iterations: int = ITERATIONS) -> float:
    """Return the largest frequency [rad/s] at the start, root of the norm of da/dq; 0 if not finite."""
    n = len(motion.state) // 2
    others = {**motion.arguments, "velocity": motion.state[n:]}

    def accelerate(place: FloatArray) -> FloatArray:
        return motion.model.compute_rows("acceleration", {"coordinate": place}, others, len(place))

    is_centre = motion.model.manifest.is_centre
    return float(_iterate(accelerate, motion.state[None, :n], is_centre, iterations)[0])


def find_decay(motion: Motion) -> float:
    """Return the largest decay rate [1/s] at the start, the norm of da/dv; 0 if not finite."""
    n = len(motion.state) // 2
    others = {**motion.arguments, "coordinate": motion.state[:n]}

    def accelerate(velocity: FloatArray) -> FloatArray:
        return motion.model.compute_rows("acceleration", {"velocity": velocity}, others, len(velocity))

    return float(_iterate(accelerate, motion.state[None, n:], np.zeros(n, dtype=np.bool_))[0]) ** 2


def bound_fastest(motion: Motion) -> float:
    """Return find_fastest, or in its place a bound by the laws of members, which costs nothing once known."""
    if not motion.model.manifest.needs_state_jacobian:  # no contacts, nor members or rings with memory
        rates = find_rates(motion.model, (), motion.arguments)
        if rates is not None:
            return rates.frequency
    return find_fastest(motion, FEW_ITERATIONS)


def find_fastest_of_batch(motion: Motion, threads: int = 1) -> FloatArray:
    """Return what find_fastest says of each motion of a batch, states (n_batch, n_states): (n_batch,)."""
    n = motion.state.shape[1] // 2
    own = {
        name for name, value in motion.arguments.items() if np.ndim(value) > motion.model.nominal(name).ndim
    }
    both = {
        name: np.concatenate([value] * 2) if name in own else value
        for name, value in motion.arguments.items()
    }
    velocity = np.concatenate([motion.state[:, n:]] * 2)

    def accelerate(place: FloatArray) -> FloatArray:
        found, _ = motion.model.compute_batch(
            "acceleration", coordinate=place, velocity=velocity, threads=threads, on_error="status", **both
        )
        return np.asarray(found)

    return _iterate(accelerate, motion.state[:, :n], motion.model.manifest.is_centre)


def _iterate(
    accelerate: Callable[[FloatArray], FloatArray],
    place: FloatArray,
    is_centre: NDArray[np.bool_],
    iterations: int = ITERATIONS,
) -> FloatArray:
    """Return roots of the norms of da/dq at places (n_batch, n_coordinates), row by row.

    accelerate: places on one side, then those on the other -> accelerations (2 n_batch, n_coordinates);
    is_centre (n_coordinates,): those that measure no length of the structure, see Manifest.
    """
    with np.errstate(all="ignore"):  # rows that are not finite come out as 0
        reach = DISPLACEMENT * np.abs(place[:, ~is_centre]).max(axis=1, initial=0.0, keepdims=True)
        reach[~(reach > 0.0)] = DISPLACEMENT

        def differ(direction: FloatArray, times: float) -> FloatArray:
            moved = times * reach * direction / np.linalg.norm(direction, axis=1, keepdims=True)
            ahead, behind = np.split(accelerate(np.concatenate([place + moved, place - moved])), 2)
            return np.asarray((ahead - behind) / (2.0 * times * reach))

        def iterate(find: Callable[[FloatArray], FloatArray]) -> tuple[FloatArray, FloatArray]:
            direction = np.tile(np.random.default_rng(0).standard_normal(place.shape[1]), (len(place), 1))
            for _ in range(iterations):
                before, direction = direction, find(direction)
            return np.linalg.norm(direction, axis=1), before

        square, last = iterate(lambda direction: differ(direction, 1.0))
        # At a kink a force that jumps looks stiff, the less so the longer the difference: it is taken off.
        is_jump = np.linalg.norm(differ(last, 2.0), axis=1) < LEAST_JUMP_RATIO * square
        if is_jump.any():
            smooth, _ = iterate(lambda direction: 2.0 * differ(direction, 2.0) - differ(direction, 1.0))
            square = np.where(is_jump, smooth, square)
    return np.sqrt(np.where(np.isfinite(square), square, 0.0))
