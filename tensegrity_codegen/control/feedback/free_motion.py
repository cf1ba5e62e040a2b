"""Rigid motions of free structures: those in which momentum and angular momentum stay zero.

Internal forces change no momentum. So a path through shapes fixes how a free structure turns and moves.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from tensegrity_codegen.control.feedback.path_knots import PathKnots
from tensegrity_codegen.control.feedback.smooth_path import SmoothPath
from tensegrity_codegen.control.planning.plan_point import PlanModel
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray

TOLERANCE = 1e-12


def remove_momentum(plan_model: PlanModel, knots: PathKnots, path: SmoothPath) -> SmoothPath:
    """Return the path with the rigid motions in which a free structure keeps zero momentum.

    Parameters
    ----------
    plan_model : PlanModel
        The model; scenes of bodies, structures that are held, loaded or have no masses stay as they are.
    knots : PathKnots
        Equilibria of the path.
    path : SmoothPath
        The path.

    Returns
    -------
    SmoothPath
        With the same shapes, and the same position at the start.

    Notes
    -----
    With positions x_i (from the centre of mass) and masses m_ij of the path over progress, the angular
    velocity W in the path's axes follows from sum m_ij x_i x (x_j' + W x x_j) = 0; R' = R [W].
    """
    structure, model = plan_model.model.structure, plan_model.model
    if not isinstance(structure, Structure) or not model.has("mass_matrix"):
        return path
    axes = list(structure.axes)
    rigid = {3: 6, 2: 3}.get(len(axes), 0)
    if structure.node_anchored[:, axes].any() or any(at.neutral.shape[1] != rigid for at in knots.point):
        return path
    count = len(axes)
    place = model.manifest.coordinate_place
    order = np.lexsort((place[:, 1], place[:, 0]))  # node by node, axis by axis
    mass = model.compute("mass_matrix", **plan_model.arguments).toarray()[np.ix_(order, order)]
    turned = _turn(path, mass[::count, ::count], order, axes)
    result = np.empty_like(turned)
    result[:, order] = turned
    return replace(path, coordinate=CubicSpline(path.knots, result))


def _turn(path: SmoothPath, mass: FloatArray, order: NDArray[np.int64], axes: list[int]) -> FloatArray:
    """Return the coordinates at the knots (n, n_coordinates), node by node, without momentum on the way."""
    total = float(mass.sum())

    def nodes(s: float, derivative: int) -> FloatArray:
        """Return positions, or their derivatives, from the centre of mass, (n_nodes, 3)."""
        field = np.zeros((len(mass), 3))
        field[:, axes] = np.asarray(path.coordinate(s, derivative))[order].reshape(len(mass), -1)
        return np.asarray(field - mass.sum(axis=0) @ field / total)

    def spin(s: float, turn: FloatArray) -> FloatArray:
        x, rate = nodes(s, 0), nodes(s, 1)
        momentum = np.cross(x, mass @ rate).sum(axis=0)
        products = x.T @ mass @ x
        inertia = np.trace(products) * np.eye(3) - products
        w = -np.linalg.pinv(inertia, rcond=1e-12) @ momentum
        cross = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        return np.asarray((turn.reshape(3, 3) @ cross).ravel())

    found = solve_ivp(
        spin,
        (0.0, 1.0),
        np.eye(3).ravel(),
        method="DOP853",
        t_eval=path.knots,
        rtol=TOLERANCE,
        atol=TOLERANCE,
    )
    first = np.zeros((len(mass), 3))
    first[:, axes] = np.asarray(path.coordinate(0.0))[order].reshape(len(mass), -1)
    centre = mass.sum(axis=0) @ first / total
    turns = [np.linalg.svd(row.reshape(3, 3)) for row in found.y.T]  # nearest rotations
    placed = [nodes(float(s), 0) @ (u @ v).T + centre for s, (u, _, v) in zip(path.knots, turns, strict=True)]
    return np.array([place[:, axes].ravel() for place in placed])
