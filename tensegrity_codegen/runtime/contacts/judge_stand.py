"""Standing: whether the ground can hold a structure in a given shape, as a rigid whole."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.contacts.foot_forces import (
    GAP,
    FootProblem,
    find_foot_forces,
    find_least_friction,
)
from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.system.errors import FormulationError

TOUCH = 1e-6  # of the structure's size: distance above the lowest contact up to which a contact is a foot
LINE = 1e-9  # of the structure's size: width up to which feet lie on a line
ROUNDING = 1e-12  # of the loads on all nodes: a resultant that is zero


@dataclass(frozen=True)
class Stand:
    """Whether a structure stands, as a rigid whole in a given shape.

    Attributes
    ----------
    verdict : str
        ``"stands"``; ``"tips"``, ``"slides"``, ``"lifts_off"`` (nothing presses it onto the ground);
        ``"no_foot"``, ``"one_foot"``, ``"on_a_line"`` (all feet on one line, so that it balances at best).
    message : str
        A sentence.
    resultant, moment : ndarray, shape (3,) [N, N m]
        Of weights and loads; the moment about the origin.
    foot : tuple of str
        Nodes in contact.
    place : ndarray, shape (n_feet, 3) [m]
        Their positions.
    force : ndarray, shape (n_feet, 3) [N]
        Forces of the ground on them; where none are possible, those that exceed friction least, or nan.
    distribution : str
        Where the forces are from: ``"equilibrium"``, ``"statics"`` (they follow from the balance alone),
        ``"least_squares"`` (of all that balance, those with the least sum of squares), ``"feasible"``.
    centre_of_pressure : ndarray, shape (3,) [m]
        Where the line of action of the resultant meets the plane of the feet; nan without a resultant.
    tipping_margin : float [m]
        Its least distance from the edges of the support polygon, negative outside.
    edge : tuple of str
        The two feet of that edge; one in a planar scene.
    friction : float
        Coefficient of friction of the ground.
    friction_needed : float
        Least coefficient with which forces of the feet exist; inf where none is enough.
    excess : float [N]
        By how much ``|F|`` exceeds mu N at least; 0 or less where forces exist.
    motion : ndarray, shape (n_nodes, 3), or None
        Where no such forces exist, the proof: a rigid motion, with a power of the loads of 1 W [m/s], that
        moves each foot away from the ground at least mu times as fast as along it.
    """

    verdict: str
    message: str
    resultant: FloatArray
    moment: FloatArray
    foot: tuple[str, ...]
    place: FloatArray
    force: FloatArray
    distribution: str
    centre_of_pressure: FloatArray
    tipping_margin: float
    edge: tuple[str, ...]
    friction: float
    friction_needed: float
    excess: float
    motion: FloatArray | None

    @property
    def is_standing(self) -> bool:
        """Whether it stands."""
        return self.verdict == "stands"

    def as_evidence(self) -> dict[str, Any]:
        """Return all by name, JSON-ready."""
        names = (
            "verdict",
            "message",
            "distribution",
            "tipping_margin",
            "friction",
            "friction_needed",
            "excess",
        )
        arrays = ("resultant", "moment", "centre_of_pressure")
        feet = zip(self.foot, self.place.tolist(), self.force.tolist(), strict=True)
        return {
            **{name: _jsonable(getattr(self, name)) for name in names},
            **{name: [_jsonable(x) for x in getattr(self, name).tolist()] for name in arrays},
            "edge": list(self.edge),
            "feet": {
                name: {"position": x, "force": [_jsonable(f) for f in force]} for name, x, force in feet
            },
            "proof": None if self.motion is None else self.motion.tolist(),
        }


def judge_stand(
    structure: Structure,
    position: FloatArray,
    external: FloatArray,
    *,
    force: FloatArray | None = None,
    friction: float | None = None,
) -> Stand:
    """Return whether a structure stands.

    structure: with a ground.
    position, external (n_nodes, 3) [m, N]: shape, and weights and loads.
    force (n_contacts, 3) [N]: forces of the ground in an equilibrium; they say which contacts are feet.
    friction: coefficient of friction; by default that of the ground.
    """
    ground = structure.ground
    assert ground is not None
    if structure.node_anchored[:, list(structure.axes)].any():
        raise FormulationError(
            "anchors hold the structure, so that it does not stand alone",
            where=f"{structure.name}: nodes",
            given="anchored nodes",
            allowed="free nodes",
            hint="remove the anchors, or look at the forces in `equilibrium`",
        )
    depth = ground.compute_depth(position)
    size = float(np.ptp(position, axis=0).max()) or 1.0
    feet = depth >= depth.max() - TOUCH * size if force is None else force @ ground.normal > 0.0
    if force is None and depth.max() < -TOUCH * size:
        feet = np.zeros(len(depth), dtype=bool)
    mu = ground.friction if friction is None else friction
    return _Judge(structure, ground, position, external, feet, force, mu, size).judge()


@dataclass(frozen=True)
class _Judge:
    structure: Structure
    ground: Ground
    position: FloatArray
    external: FloatArray
    feet: BoolArray
    given: FloatArray | None
    mu: float
    size: float

    def judge(self) -> Stand:
        node = self.ground.node[self.feet]
        name = tuple(self.structure.node_name[k] for k in node)
        place = self.position[node]
        frame = np.vstack([self.ground.normal, self.ground.tangents(self.structure.axes)])
        total = self.external.sum(axis=0)
        moment = np.cross(self.position, self.external).sum(axis=0)
        centre = place.mean(axis=0) if len(place) else self.position.mean(axis=0)
        nan = np.full(3, np.nan)
        unknown = np.full((len(place), 3), np.nan)
        known = Stand(
            "", "", total, moment, name, place, unknown, "", nan, np.nan, (), self.mu, np.inf, np.inf, None
        )
        if not len(place):
            high = -float(self.ground.compute_depth(self.position).max())
            return _say(known, "no_foot", f"no foot: the lowest contact is {high:.6g} m above the ground")
        press = -float(total @ self.ground.normal)
        if press <= ROUNDING * float(np.abs(self.external).sum()):
            return _say(known, "lifts_off", "nothing presses it onto the ground")
        about = moment - np.cross(centre, total)
        reach, margin, edge = _find_support(self.structure, place, self.position, self.external)
        problem = FootProblem(
            place - centre, np.concatenate([total, about]), frame, self._moving(), self.size
        )
        known = replace(
            known, centre_of_pressure=reach, tipping_margin=margin, edge=tuple(name[k] for k in edge)
        )
        return self._with_forces(known, problem, frame)

    def _moving(self) -> BoolArray:
        """Return which motions there are: slides along modelled axes, turns in planes of two of them."""
        axes = self.structure.axes
        slides = [axis in axes for axis in range(3)]
        turns = [all(other in axes for other in range(3) if other != axis) for axis in range(3)]
        return np.array(slides + turns)

    def _with_forces(self, known: Stand, problem: FootProblem, frame: FloatArray) -> Stand:
        """Return the verdict, with forces and their proof."""
        found = find_foot_forces(problem, self.mu)
        scale = float(np.linalg.norm(problem.load))
        needed = np.inf if np.isinf(found.excess) else find_least_friction(problem)
        exists = found.excess <= GAP * scale
        sign = np.array([1.0, *[-1.0] * (len(frame) - 1)])
        force = (found.force * sign) @ frame if np.isfinite(found.excess) else known.force
        distribution = ""
        if exists:
            force, distribution = self._distribute(problem, force, frame)
        known = replace(
            known, force=force, distribution=distribution, friction_needed=needed, excess=found.excess,
            motion=None if exists else self._move(problem, found.motion),
        )  # fmt: skip
        return self._name(known, exists)

    def _distribute(
        self, problem: FootProblem, force: FloatArray, frame: FloatArray
    ) -> tuple[FloatArray, str]:
        """Return the forces of an equilibrium, those that statics determine, or the least squares."""
        if self.given is not None:
            return self.given[self.feet], "equilibrium"
        matrix = problem.matrix
        rank = int(np.linalg.matrix_rank(matrix, tol=1e-9))
        least = -np.linalg.lstsq(matrix, problem.load, rcond=1e-12)[0].reshape(-1, len(frame))
        if not self.mu:  # normal forces alone
            normal = matrix[:, :: len(frame)]
            rank = int(np.linalg.matrix_rank(normal, tol=1e-9))
            least = np.zeros_like(least)
            least[:, 0] = -np.linalg.lstsq(normal, problem.load, rcond=1e-12)[0]
        tangential = np.linalg.norm(least[:, 1:], axis=1)
        scale = float(np.linalg.norm(problem.load))
        is_allowed = bool(
            (least[:, 0] >= 0.0).all() and (tangential <= self.mu * least[:, 0] + GAP * scale).all()
        )
        if not is_allowed:
            return force, "feasible"
        unknowns = len(least) if not self.mu else least.size
        sign = np.array([1.0, *[-1.0] * (len(frame) - 1)])
        return (least * sign) @ frame, "statics" if unknowns <= rank else "least_squares"

    def _move(self, problem: FootProblem, motion: FloatArray) -> FloatArray:
        """Return the velocities of all nodes in a certificate, at unit power of the loads."""
        whole = np.zeros(6)
        whole[problem.moving] = motion
        centre = self.position[self.ground.node[self.feet]].mean(axis=0)
        moved = whole[:3] + np.cross(whole[3:] / problem.size, self.position - centre)
        power = float(motion @ problem.load)
        return np.asarray(moved / power if power > 0 else moved)

    def _name(self, known: Stand, exists: bool) -> Stand:
        """Return the verdict in words."""
        margin, planar = known.tipping_margin, len(self.structure.axes) == 2
        edge = " and ".join(known.edge)
        line = not planar and _is_line(known.place, self.size)
        if len(known.foot) == 1:
            return _say(known, "one_foot", f"one foot, {known.foot[0]}: it balances at best")
        if line:
            away = f", from which its load is {-margin:.6g} m away" if margin < -ROUNDING * self.size else ""
            return _say(
                known, "on_a_line", f"feet on a line, {', '.join(known.foot)}: it tips about it{away}"
            )
        if margin < 0.0 or np.isinf(known.friction_needed):
            about = f"the edge between {edge}" if not planar else edge
            return _say(
                known, "tips", f"tips about {about}: its load meets the ground {-margin:.6g} m outside"
            )
        if not exists:
            needs = f"needs a friction of {known.friction_needed:.9g}, the ground has {self.mu:.9g}"
            return _say(known, "slides", f"slides: {needs}")
        where = (
            f"{margin:.6g} m from the edge between {edge}" if not planar else f"{margin:.6g} m from {edge}"
        )
        return _say(known, "stands", f"stands: its load meets the ground {where}")


def find_support_margin(
    structure: Structure, position: FloatArray, external: FloatArray, force: FloatArray
) -> tuple[float, tuple[str, ...]]:
    """Return the tipping margin [m] and its edge, for feet that press.

    structure: with a ground; position, external (n_nodes, 3) [m, N]: shape, and weights and loads; force
    (n_contacts, 3) [N]: forces of the ground.
    Returns margin: see Stand; edge: its feet.
    """
    ground = structure.ground
    assert ground is not None
    node = ground.node[force @ ground.normal > 0.0]
    _, margin, edge = _find_support(structure, position[node], position, external)
    return margin, tuple(structure.node_name[node[k]] for k in edge)


def _find_support(
    structure: Structure, place: FloatArray, position: FloatArray, external: FloatArray
) -> tuple[FloatArray, float, tuple[int, ...]]:
    """Return the centre of pressure (3,), the tipping margin and the feet of its edge; place: of the feet."""
    ground = structure.ground
    assert ground is not None
    total, centre = external.sum(axis=0), place.mean(axis=0)
    about = np.cross(position - centre, external).sum(axis=0)
    reach = centre + np.cross(ground.normal, about) / float(total @ ground.normal)
    along = ground.tangents(structure.axes).T
    size = float(np.ptp(position, axis=0).max()) or 1.0
    return reach, *_find_margin((place - centre) @ along, (reach - centre) @ along, size)


def _find_margin(place: FloatArray, at: FloatArray, size: float) -> tuple[float, tuple[int, ...]]:
    """Return the least distance of a point from the edges of the hull of feet, and the feet of that edge.

    place: (n_feet, 2) along the plane, (n_feet, 1) in planar scenes. Feet on a line have the width 0.
    """
    if place.shape[1] == 1:
        low, high = int(place.argmin()), int(place.argmax())
        left = [float(at[0] - place[low, 0]), float(place[high, 0] - at[0])]
        return min(left), ((low, high)[int(np.argmin(left))],)
    if _is_line(place, size):
        ends = _find_ends(place)
        first, last = place[list(ends)]
        span = float((last - first) @ (last - first))
        part = float(np.clip((at - first) @ (last - first) / span, 0.0, 1.0)) if span else 0.0
        return -float(np.linalg.norm(at - first - part * (last - first))), tuple(dict.fromkeys(ends))
    hull = scipy.spatial.ConvexHull(place)
    inside = -(hull.equations[:, :2] @ at + hull.equations[:, 2])
    k = int(inside.argmin())
    return float(inside[k]), tuple(int(i) for i in np.sort(hull.simplices[k]))


def _is_line(place: FloatArray, size: float) -> bool:
    """Return whether points lie on a line, or are one point."""
    spread = np.linalg.svd(place - place.mean(axis=0), compute_uv=False)
    return bool(len(place) < 3 or spread[1] <= LINE * size)


def _find_ends(place: FloatArray) -> tuple[int, int]:
    """Return the two points of a line that are farthest apart."""
    along = np.linalg.svd(place - place.mean(axis=0))[2][0]
    reach = place @ along
    return int(reach.argmin()), int(reach.argmax())


def _say(known: Stand, verdict: str, message: str) -> Stand:
    return replace(known, verdict=verdict, message=message)


def _jsonable(value: Any) -> Any:
    """Return None in place of a number that JSON does not have."""
    return None if isinstance(value, float) and not np.isfinite(value) else value
