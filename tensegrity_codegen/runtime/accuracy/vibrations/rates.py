"""How fast a structure can move by itself: bounds on frequencies and decay rates, from members and masses.

With K = sum of mu_e g_e g_e^T over the members, the eigenvalues of H^-1 K are at most (Gershgorin, rows
scaled by roots of masses)

    max over nodes i of   sum over members e = (i, j) of   mu_e (1 / m_i + 1 / sqrt(m_i m_j))

and those of H^-1 C the same with damping constants. Cables count as taut, a mass as the least that a row of
H leaves.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.system.arrays import FloatArray


@dataclass(frozen=True)
class Rates:
    """Bounds from above. frequency, decay: of all members [rad/s], [1/s]; slow_*: of all but the stiff ones.

    Stiff are the two-sided members whose tensions the integrator radau takes as unknowns. stiffness_ratio:
    the largest mu of these over the largest of the others, infinite where there are no others; meeting: how
    many of them meet in one node at most; has_jumps: whether a cable is damped, so that its force jumps.
    """

    frequency: float
    decay: float
    slow_frequency: float
    slow_decay: float
    stiffness_ratio: float
    meeting: int
    has_jumps: bool


def find_rates(model: Model, stiff: tuple[int, ...], arguments: Mapping[str, Any]) -> Rates | None:
    """Return the rates at these arguments; None where the library has no member_law and no mass_matrix.

    stiff: indices of the members that count as stiff.
    """
    if not (model.has("member_law") and model.has("mass_matrix")):
        return None
    law = np.asarray(model.compute("member_law", **arguments))
    mu, c = law[:, 1], law[:, 2]
    mass, ends = _node_mass(model, arguments), _ends(model)
    is_stiff = np.isin(np.arange(len(mu)), stiff)
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
        has_jumps=bool(np.any(c[~is_stiff] > 0)),
    )


def _ends(model: Model) -> NDArray[np.int64]:
    return np.array(model.manifest.connectivity, dtype=np.int64).reshape(-1, 2)


def _node_mass(model: Model, arguments: Mapping[str, Any]) -> FloatArray:
    """Return the least mass of each node on a free axis, (n_nodes,); infinite where all are anchored."""
    row, column, value = _mass_entries(model, arguments)
    diagonal = np.zeros(len(model.manifest.coordinate_place))
    diagonal[row[row == column]] = value[row == column]
    spread = np.bincount(row, np.abs(value), len(diagonal)) - np.abs(diagonal)
    least = np.maximum(diagonal - spread, 1e-3 * diagonal)
    mass = np.full(len(model.manifest.node_name), np.inf)
    np.minimum.at(mass, model.manifest.coordinate_place[:, 0], least)
    return mass


def _mass_entries(
    model: Model, arguments: Mapping[str, Any]
) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]:
    """Return rows, columns and values of the mass matrix."""
    if isinstance(model, CompiledModel):
        return model.compute_entries("mass_matrix", **arguments)
    matrix = model.compute("mass_matrix", **arguments).tocoo()
    return matrix.row, matrix.col, matrix.data


def _bound(values: FloatArray, mass: FloatArray, ends: NDArray[np.int64]) -> float:
    """Return the largest eigenvalue that members of these constants can cause between these masses."""
    inverse = 1.0 / mass
    total = np.zeros(len(mass))
    for one, other in ((0, 1), (1, 0)):
        i, j = ends[:, one], ends[:, other]
        np.add.at(total, i, values * (inverse[i] + np.sqrt(inverse[i] * inverse[j])))
    return float(total.max(initial=0.0))
