"""Discrete Riccati equations, and the modes that inputs do not change or outputs do not show."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, solve_discrete_are

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.runtime.statics.neutral_motion import NeutralMotions
from tensegrity_codegen.runtime.statics.static_problem import build_rigid_motions
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import ConvergenceError

RESIDUAL = 1e-10  # of |P|
MAX_POLISHING = 20
MAX_DOUBLINGS, DOUBLING_TOLERANCE = 60, 1e-15
RANK = 1e-9  # singular value over the largest, up to which a direction is lost
UNSTABLE = 1.0 - 1e-7  # modulus from which on a mode does not decay by itself
NEAR_ONE = 1e-5
NAMED_SHARE = 0.05  # of the largest part, from which on a state is named
N_NAMED = 6
NO_EFFECT = 1e-9  # of the largest effect of any actuator


def compute_gain(p: FloatArray, a: FloatArray, b: FloatArray, r: FloatArray) -> FloatArray:
    """Return K = (R + B^T P B)^-1 B^T P A, shape (m, n)."""
    factor = cho_factor(r + b.T @ p @ b)
    return np.asarray(cho_solve(factor, b.T @ p @ a))


def step_back(
    p: FloatArray, a: FloatArray, b: FloatArray, q: FloatArray, r: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the cost to go p (n, n) one sample earlier, and the gain K (m, n) there, of u = -K x."""
    # x[k+1] = a x[k] + b u[k] with weights q, r: P = Q + K^T R K + (A - B K)^T P (A - B K), symmetric and
    # positive semidefinite in rounded arithmetic too.
    gain = compute_gain(p, a, b, r)
    closed = a - b @ gain
    earlier = q + gain.T @ r @ gain + closed.T @ p @ closed
    return 0.5 * (earlier + earlier.T), gain


def find_stationary(
    a: FloatArray, b: FloatArray, q: FloatArray, r: FloatArray, where: str
) -> tuple[FloatArray, float]:
    """Return the stabilising solution of the stationary Riccati equation, and its residual over |P|.

    The structure-preserving doubling algorithm (E. K.-W. Chu, H.-Y. Fan, W.-W. Lin, C.-S. Wang,
    "Structure-preserving algorithms for periodic discrete-time algebraic Riccati equations", International
    Journal of Control 77, 2004): k steps of it are 2^k steps of the recursion. If its solution does not
    stabilise the system (an unstable motion without weight), the ordered QZ decomposition of SciPy. Then the
    recursion itself, which contracts towards P.
    """
    p = _solve_by_doubling(a, b, q, r)
    closed = None if p is None else np.linalg.eigvals(a - b @ compute_gain(p, a, b, r))
    if p is None or closed is None or not np.abs(closed).max(initial=0.0) < 1.0:
        p = _solve_by_decomposition(a, b, q, r, where)
    best, residual = p, np.inf
    for _ in range(MAX_POLISHING):
        following, _ = step_back(p, a, b, q, r)
        now = float(np.abs(following - p).max() / np.abs(p).max())
        if now < residual:
            best, residual = p, now
        if residual < 0.01 * RESIDUAL:
            break
        p = following
    if not residual < RESIDUAL:
        raise ConvergenceError(
            "the stationary Riccati equation is not solved",
            evidence={"residual over |P|": residual, "allowed": RESIDUAL},
            where=where,
            hint="scale the weights nearer to each other",
        )
    return best, residual


def _solve_by_doubling(a: FloatArray, b: FloatArray, q: FloatArray, r: FloatArray) -> FloatArray | None:
    """Return the limit of the recursion from P = 0 backwards by doubling; None if it has none."""
    n = len(a)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        try:
            through, reach, cost = a, b @ cho_solve(cho_factor(r), b.T), q
        except (LinAlgError, ValueError):  # not definite, or not finite
            return None
    for _ in range(MAX_DOUBLINGS):
        with np.errstate(over="ignore", invalid="ignore"):
            try:
                solved = np.linalg.solve(np.eye(n) + reach @ cost, np.hstack([through, reach]))
            except np.linalg.LinAlgError:
                return None
            added = through.T @ cost @ solved[:, :n]
            reach = reach + through @ solved[:, n:] @ through.T
            cost, through = cost + added, through @ solved[:, :n]
            reach, cost = 0.5 * (reach + reach.T), 0.5 * (cost + cost.T)
        if not all(np.isfinite(matrix).all() for matrix in (cost, reach, through)):
            return None
        size = float(np.abs(cost).max())
        if np.abs(added).max() <= DOUBLING_TOLERANCE * size:
            return cost
    return None


def _solve_by_decomposition(
    a: FloatArray, b: FloatArray, q: FloatArray, r: FloatArray, where: str
) -> FloatArray:
    """Return the stabilising solution by the QZ decomposition; raises ConvergenceError without one."""
    try:
        p = np.asarray(solve_discrete_are(a, b, q, r), dtype=np.float64)
    except (LinAlgError, ValueError) as error:
        raise ConvergenceError(
            "the stationary Riccati equation has no solution that stabilises the system",
            evidence={"reason": str(error)},
            where=where,
            hint="give all states a weight, or scale the weights nearer to each other",
        ) from error
    return 0.5 * (p + p.T)


# Which modes of a sampled linear model inputs can change, and which outputs can show: rank tests.
#
# A mode with eigenvalue z is stabilisable if [z 1 - A, B] has full rank, and detectable if [z 1 - A; C] has
# (M. L. J. Hautus, "Controllability and observability conditions of linear autonomous systems", Indagationes
# Mathematicae 31, 1969). Only modes with |z| >= 1 need to be either. Whether a number counts as zero depends
# on the units of the states, which differ (m, rad, m/s, sums of errors): rows are scaled to unit norm first.


@dataclass(frozen=True)
class HiddenMode:
    """A mode that inputs do not change, or outputs do not show."""

    eigenvalue: complex  # of the sampled system; modulus 1 or more does not decay
    direction: FloatArray  # (n_states,): unit vector of the states that take part
    rank: int  # rank of the test matrix, and the rank that it should have
    size: int


def find_uncontrolled(a: FloatArray, b: FloatArray) -> list[HiddenMode]:
    """Return the modes of x[k+1] = a x[k] + b u[k] that do not decay and that no input changes."""
    return _test(a.T, b.T)


def find_unobserved(a: FloatArray, c: FloatArray) -> list[HiddenMode]:
    """Return the modes of x[k+1] = a x[k], y = c x, that do not decay and that no output shows."""
    return _test(a, c)


def describe_direction(direction: FloatArray, names: Sequence[str]) -> str:
    """Return the largest parts of a direction in words, such as "0.71 top_x - 0.71 top_y"."""
    size = np.abs(direction)
    order = [int(k) for k in np.argsort(-size, kind="stable") if size[k] >= NAMED_SHARE * size.max()]
    if not order:
        return "none"
    turned = direction * np.sign(direction[order[0]])
    terms = " ".join(f"{'+-'[int(turned[k] < 0)]} {abs(turned[k]):.2g} {names[k]}" for k in order[:N_NAMED])
    return terms.removeprefix("+ ") + (f" and {len(order) - N_NAMED} more" if len(order) > N_NAMED else "")


def _test(a: FloatArray, c: FloatArray) -> list[HiddenMode]:
    n = len(a)
    norm = np.linalg.norm(c, axis=1)
    rows = c[norm > 0.0] / norm[norm > 0.0][:, None]
    modes: list[HiddenMode] = []
    values = np.linalg.eigvals(a)
    chosen = values[(np.abs(values) >= UNSTABLE) & (values.imag >= 0.0)]
    chosen[np.abs(chosen - 1.0) < NEAR_ONE] = 1.0  # rounding splits the double eigenvalue of a free motion
    # Of eigenvalues that differ by rounding only one.
    distinct: list[complex] = []
    for value in chosen.tolist():
        if all(abs(value - previous) > 1e-6 for previous in distinct):
            distinct.append(value)
    for value in distinct:
        matrix = np.vstack([value * np.eye(n) - a, rows])
        _, singular, right = np.linalg.svd(matrix)
        rank = int((singular > RANK * singular[0]).sum())
        for vector in right[rank:].conj():
            pair = np.concatenate([vector.real, vector.imag])
            half = pair[:n] if np.linalg.norm(pair[:n]) >= np.linalg.norm(pair[n:]) else pair[n:]
            modes.append(HiddenMode(complex(value), half / np.linalg.norm(half), rank, n))
    return modes


# Rigid motions of a whole structure that its actuators cannot change.


def name_free_motions(
    model: CompiledModel, coordinate: FloatArray, gain: FloatArray, arguments: Mapping[str, Any]
) -> tuple[str, ...]:
    """Return the rigid motions that no actuator changes, such as "slide along x".

    Rigid motions R for which R^T M gain = 0: internal forces change neither momentum.
    """
    manifest = model.manifest
    if not manifest.coordinate_node_axis or not model.has("mass_matrix"):
        return ()
    position = place_nodes(model, coordinate, arguments.get("anchor_position"), arguments=arguments)
    rigid = build_rigid_motions(manifest, position)
    mass = model.compute("mass_matrix", **{**arguments, "coordinate": coordinate})
    effect = rigid.T @ (mass @ gain)
    scale = np.linalg.norm(mass @ gain)
    directions, size, _ = np.linalg.svd(effect)
    rank = int((size > NO_EFFECT * scale).sum())
    free = rigid @ directions[:, rank:]
    velocity = np.zeros((len(position), 3, free.shape[1]))
    node, axis = manifest.coordinate_place.T
    velocity[node, axis] = free
    local = position - position.mean(axis=0)
    unit_motions = np.array([(np.cross(turn[:3], local) + turn[3:]).ravel() for turn in np.eye(6)]).T
    twist = np.linalg.lstsq(unit_motions, velocity.reshape(len(unit_motions), free.shape[1]), rcond=None)[0].T
    return NeutralMotions(position.mean(axis=0), twist, np.zeros((len(position), 3, 0))).names
