"""Natural frequencies and modes of the present state, from tangent stiffness and masses."""

from dataclasses import dataclass

import numpy as np
import scipy

from tensegrity_codegen.runtime.analysis.configuration import Configuration
from tensegrity_codegen.runtime.statics.bar_problem import BarProblem
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import NonFiniteError
from tensegrity_codegen.tables.formulations import find_formulation

ZERO_FREQUENCY_TOLERANCE = 1e-13  # part of the largest square of a frequency that counts as none


@dataclass(frozen=True)
class Modes:
    """Small undamped vibrations about a configuration.

    frequency (n_modes,) [Hz]: natural frequencies, ascending; 0 where a motion has no stiffness.
    growth_rate (n_modes,) [1/s]: rates at which unstable modes grow; 0 for the others.
    shape (n_nodes, 3, n_modes): displacements of the nodes, the largest of each mode 1.
    n_rigid: number of rigid motions without stiffness, which are not among the modes.
    n_total: number of modes there are; only the first are computed.
    """

    frequency: FloatArray
    growth_rate: FloatArray
    shape: FloatArray
    n_rigid: int
    n_total: int


def find_modes(at: Configuration, rigid: FloatArray, count: int) -> Modes | None:
    """Find the first natural frequencies and modes.

    at: the configuration; its model must have `mass_matrix`; rigid (n_directions, k): orthonormal rigid
    motions without stiffness, over the directions of the static problem; count: number of modes.
    Returns frequencies and shapes; None where a free coordinate has no mass.

    K v = (2 pi f)^2 H v with the tangent stiffness K and the mass matrix H, over motions that keep the
    lengths of rigid bars, orthogonal to the rigid motions.
    """
    problem = at.problem
    stiffness = np.asarray(problem.stiffness(at.coordinate).toarray())
    mass = _find_mass(at)
    if len(mass) and mass.diagonal().min() <= 0.0:
        return None
    basis = scipy.linalg.null_space(rigid.T @ mass) if rigid.shape[1] else np.eye(len(stiffness))
    total = basis.shape[1]
    if total == 0:
        return Modes(np.zeros(0), np.zeros(0), np.zeros((len(at.position), 3, 0)), rigid.shape[1], 0)
    k, m = (basis.T @ (matrix + matrix.T) @ basis / 2 for matrix in (stiffness, mass))
    try:
        value, vector = scipy.linalg.eigh(k, m)
    except np.linalg.LinAlgError as error:
        raise NonFiniteError(
            f"the natural frequencies cannot be computed: {error}",
            where=problem.model.manifest.name,
            allowed="masses and stiffnesses whose quotients are numbers",
        ) from error
    chosen = slice(0, min(count, total))
    square = np.where(np.abs(value) > ZERO_FREQUENCY_TOLERANCE * np.abs(value).max(), value, 0.0)[chosen]
    shape = problem.node_velocities(at.coordinate, basis @ vector[:, chosen])
    largest = np.linalg.norm(shape, axis=1).max(axis=0)
    return Modes(
        frequency=np.sqrt(np.maximum(square, 0.0)) / (2 * np.pi),
        growth_rate=np.sqrt(np.maximum(-square, 0.0)),
        shape=shape / np.where(largest > 0, largest, 1.0),
        n_rigid=rigid.shape[1],
        n_total=total,
    )


def _find_mass(at: Configuration) -> FloatArray:
    """Return the mass matrix over the directions of the static problem."""
    problem = at.problem
    mass = np.asarray(problem.compute("mass_matrix", at.coordinate).toarray())
    if isinstance(problem, BarProblem):
        directions = problem.directions(at.coordinate)
        return np.asarray(directions.T @ mass @ directions)
    if find_formulation(at.manifest.formulation).of_bodies:
        scale = problem.scale  # type: ignore[attr-defined]
        return np.asarray(mass / scale[:, None] / scale)
    return mass
