"""A path through equilibria as a function of progress, with continuous second derivatives.

Inputs are the cubic spline through the points of the path. Coordinates are the cubic spline through these
points and the equilibria in between, which are added until the spline meets the equilibria.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from tensegrity_codegen.control.feedback.path_knots import PathKnots
from tensegrity_codegen.control.planning.plan_point import PlanModel, PlanPoint
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import ConvergenceError, UnstableError

EXACT = 1e-8  # of the longest member: distance of the spline from equilibria that counts as none
MOST_ROUNDS, MOST_KNOTS = 6, 1000
REACH = 1e-3  # of the longest member: least distance in which an equilibrium is searched


@dataclass(frozen=True, eq=False)
class SmoothPath:
    """Inputs, coordinates and tensions over progress s from 0 to 1.

    Attributes
    ----------
    change, coordinate, tension : CubicSpline
        Of the actuators' inputs (n_actuators,) [m], coordinates (n_coordinates,), tensions (n_members,) [N].
    knots : ndarray, shape (n,)
        Progress of the equilibria.
    error : float [m]
        Largest distance of a node between the splines and the equilibria halfway between knots.
    """

    change: CubicSpline
    coordinate: CubicSpline
    tension: CubicSpline
    knots: FloatArray
    error: float


def build_smooth_path(plan_model: PlanModel, knots: PathKnots) -> SmoothPath:
    """Return the path through equilibria.

    Raises ConvergenceError where no equilibrium is near the spline between two points, UnstableError where
    an equilibrium of the path is unstable.
    """
    change = CubicSpline(knots.progress, knots.change)
    found = dict(zip(knots.progress.tolist(), knots.point, strict=True))
    for s, at in found.items():
        _check_stable(plan_model, s, at)
    open_, error = list(zip(knots.progress[:-1].tolist(), knots.progress[1:].tolist(), strict=True)), 0.0
    for _ in range(MOST_ROUNDS):
        places = np.array(sorted(found))
        coordinate = CubicSpline(places, [found[s].coordinate for s in places])
        halves, error = [], 0.0
        for low, high in open_ if len(found) + len(open_) <= MOST_KNOTS else []:
            middle = (low + high) / 2
            off = _add(plan_model, found, change, coordinate, middle, (low, high))
            error = max(error, off)
            if off > EXACT * found[low].point.longest:
                halves += [(low, middle), (middle, high)]
        open_ = halves
        if not halves:
            break
    places = np.array(sorted(found))
    return SmoothPath(
        change,
        CubicSpline(places, [found[s].coordinate for s in places]),
        CubicSpline(places, [found[s].tension for s in places]),
        places,
        error,
    )


def _add(
    plan_model: PlanModel,
    found: dict[float, PlanPoint],
    change: CubicSpline,
    coordinate: CubicSpline,
    s: float,
    ends: tuple[float, float],
) -> float:
    """Add the equilibrium at progress s; return how far the spline is from it [m]."""
    low, high = (found[end] for end in ends)
    predicted, inputs = np.asarray(coordinate(s)), np.asarray(change(s))
    moved = float(np.abs(high.coordinate - low.coordinate).max(initial=0.0))
    at = plan_model.find_point(inputs, predicted, moved / 2 + REACH * low.point.longest)
    if at is None:
        raise ConvergenceError(
            "no equilibrium continues the path between two points",
            evidence={"progress": s, "between": f"{ends[0]:.6g} and {ends[1]:.6g}"},
            where=plan_model.model.manifest.name,
            hint="give points nearer to each other",
        )
    _check_stable(plan_model, s, at)
    found[s] = at
    place = plan_model.problem(inputs).node_position(predicted)
    return float(np.linalg.norm(place - at.position, axis=1).max(initial=0.0))


def _check_stable(plan_model: PlanModel, s: float, at: PlanPoint) -> None:
    if len(at.eigenvalue) and at.eigenvalue[0] <= 0:
        raise UnstableError(
            "the path leads through an unstable equilibrium",
            where=plan_model.model.manifest.name,
            evidence={"progress": s, "smallest_eigenvalue": float(at.eigenvalue[0])},
            hint="give a path through stable equilibria, as plan() finds them",
        )
