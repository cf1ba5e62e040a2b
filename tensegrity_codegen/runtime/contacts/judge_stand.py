"""Standing: whether the ground can hold a structure in a given shape, as a rigid whole.

Feet at x_i carry f_i = N_i n - F_i with |F_i| <= mu N_i. They balance the wrench W of weights and loads if

    G f + W = 0,  G f = (sum f_i, sum x_i x f_i)

Otherwise (Farkas) there is a rigid motion w with W . w > 0 whose velocities u_i at the feet have
n . u_i >= mu |u_i in the plane|: no force of the ground can take up the energy that the loads give.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.system.errors import ConvergenceError, FormulationError

GAP = 1e-9  # of the force on the feet: by how much cones may be violated
CUT_GAP = 1e-12  # the same up to which planes are added, as long as that helps
MAX_CUTS = 30  # rounds of cutting planes
FIRST_CUTS = 8  # planes about each cone to begin with
LARGEST_FRICTION = 1e3  # coefficient from which on friction counts as unlimited
OPTIONS: Any = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
TOUCH = 1e-6  # of the structure's size: distance above the lowest contact up to which a contact is a foot
LINE = 1e-9  # of the structure's size: width up to which feet lie on a line
ROUNDING = 1e-12  # of the loads on all nodes: a resultant that is zero


@dataclass(frozen=True)
class FootProblem:
    """A rigid structure on its feet."""

    place: FloatArray  # (n_feet, 3) [m], from the centre of the feet
    wrench: FloatArray  # (6,), force [N] and moment [N m] of weights and loads about that centre
    frame: FloatArray  # rows normal, tangents
    moving: BoolArray  # (6,), rigid motions that the modelled axes have
    size: float  # largest distance of a foot, or 1 [m]

    @property
    def matrix(self) -> FloatArray:
        """G over the components (N, F) of each foot in `frame`, moments over `size`, (k, n_feet * n)."""
        columns = []
        for x in self.place:
            for axis, sign in zip(self.frame, (1.0, *[-1.0] * (len(self.frame) - 1)), strict=True):
                columns.append(np.concatenate([sign * axis, sign * np.cross(x, axis) / self.size]))
        return np.array(columns).T[self.moving]

    @property
    def load(self) -> FloatArray:
        """W without the motions that there are not, moments over `size`, (k,) [N]."""
        return np.concatenate([self.wrench[:3], self.wrench[3:] / self.size])[self.moving]

    def velocities(self, motion: FloatArray) -> FloatArray:
        """Return the velocities (n_feet, n) of a rigid motion (k,), along `frame`."""
        rigid_motion = np.zeros(6)
        rigid_motion[self.moving] = motion
        moved = rigid_motion[:3] + np.cross(rigid_motion[3:] / self.size, self.place)
        return np.asarray(moved @ self.frame.T)


@dataclass(frozen=True)
class FootForces:
    """Whether forces of feet exist at a coefficient of friction."""

    force: FloatArray  # (n_feet, n), N and F of each, those that violate the cones least
    excess: float  # [N], that violation, its least possible value up to the gap
    gap: float  # [N]
    motion: FloatArray  # (k,), of the certificate, where there are no such forces


def find_foot_forces(problem: FootProblem, friction: float) -> FootForces:
    """Return the forces with the least excess tau, |F_i| <= mu N_i + tau, N_i >= 0, by cutting planes.

    The planes lie about the cones, so that the optimum of the linear program is a lower bound of tau, and
    its multipliers are a rigid motion that is exact where tau > 0.
    """
    matrix, load = problem.matrix, problem.load
    width = len(problem.frame)
    count, tangents = len(problem.place), width - 1
    scale = float(np.linalg.norm(load)) or 1.0
    angle = 2 * np.pi * np.arange(FIRST_CUTS) / FIRST_CUTS
    directions = (
        np.array([[1.0], [-1.0]]) if tangents == 1 else np.stack([np.cos(angle), np.sin(angle)], axis=1)
    )
    # Planes u . F - mu N <= tau about each cone to begin with.
    cuts = [(i, direction) for i in range(count) for direction in directions]
    equal = np.hstack([matrix, np.zeros((len(matrix), 1))])
    bounds: Any = [(0.0 if k % width == 0 else None, None) for k in range(count * width)] + [(None, None)]
    cost = np.zeros(count * width + 1)
    cost[-1] = 1.0
    previous_gap = np.inf
    # Minimise tau subject to G f = -W and the planes; add planes at violated cones.
    for _ in range(MAX_CUTS):
        rows = np.zeros((len(cuts), count * width + 1))
        for row, (i, direction) in zip(rows, cuts, strict=True):
            row[i * width] = -friction
            row[i * width + 1 : (i + 1) * width] = direction
            row[-1] = -1.0
        optimum = scipy.optimize.linprog(
            cost, rows, np.zeros(len(cuts)), equal, -load / scale, bounds, method="highs", options=OPTIONS
        )
        if optimum.status != 0:
            return FootForces(np.zeros((count, width)), np.inf, 0.0, _find_tip(problem))
        solution = np.asarray(optimum.x)
        force = solution[:-1].reshape(count, width)
        size = np.linalg.norm(force[:, 1:], axis=1)
        excess = float((size - friction * force[:, 0]).max())
        gap = excess - float(solution[-1])
        if gap <= CUT_GAP or (gap <= GAP and gap > previous_gap / 2):
            break
        previous_gap = gap
        violated = np.flatnonzero(size - friction * force[:, 0] > solution[-1] + gap / 2)
        cuts += [(int(i), force[i, 1:] / size[i]) for i in violated]
    return FootForces(force * scale, excess * scale, gap * scale, -optimum.eqlin.marginals)


def find_least_friction(problem: FootProblem) -> float:
    """Return the least coefficient of friction with which foot forces exist; inf if none is enough."""
    scale = float(np.linalg.norm(problem.load)) or 1.0

    def excess(friction: float) -> float:
        forces = find_foot_forces(problem, friction)
        return (forces.excess - forces.gap) / scale  # the bound of the program is the more exact one

    if excess(0.0) <= GAP:
        return 0.0
    if excess(LARGEST_FRICTION) > 0.0:
        return np.inf
    low, high = 0.0, 1.0
    while excess(high) > 0.0:
        low, high = high, 10 * high
    return float(scipy.optimize.brentq(excess, low, min(high, LARGEST_FRICTION), xtol=1e-13, rtol=1e-12))


def _find_tip(problem: FootProblem) -> FloatArray:
    """Return a rigid motion (k,) that lifts no foot below the plane, along which loads do most work."""
    velocity = np.array([problem.velocities(unit) for unit in np.eye(len(problem.load))])  # (k, n_feet, n)
    still = velocity[:, :, 1:].reshape(len(velocity), -1).T
    optimum = scipy.optimize.linprog(
        -problem.load, -velocity[:, :, 0].T, np.zeros(len(problem.place)), still, np.zeros(len(still)),
        (-1.0, 1.0), method="highs", options=OPTIONS,
    )  # fmt: skip
    if optimum.status != 0:
        raise ConvergenceError(
            f"the linear program was not solved: {optimum.message}",
            evidence={"status": int(optimum.status)},
            where="HiGHS",
            hint="check that all positions and loads are of sensible size",
        )
    return np.asarray(optimum.x)


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
        Least coefficient with which forces of the feet exist; inf if none is enough.
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
    """Return whether a structure stands; force (n_contacts, 3) [N] at equilibrium says which feet it has."""
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
        # Feet, resultant and moment.
        node = self.ground.node[self.feet]
        name = tuple(self.structure.node_name[k] for k in node)
        position = self.position[node]
        frame = np.vstack([self.ground.normal, self.ground.tangents(self.structure.axes)])
        total = self.external.sum(axis=0)
        moment = np.cross(self.position, self.external).sum(axis=0)
        centre = position.mean(axis=0) if len(position) else self.position.mean(axis=0)
        nan = np.full(3, np.nan)
        unknown = np.full((len(position), 3), np.nan)
        stand = Stand(
            "", "", total, moment, name, position, unknown, "", nan, np.nan, (), self.mu, np.inf, np.inf, None
        )
        if not len(position):
            high = -float(self.ground.compute_depth(self.position).max())
            return _say(stand, "no_foot", f"no foot: the lowest contact is {high:.6g} m above the ground")
        press = -float(total @ self.ground.normal)
        if press <= ROUNDING * float(np.abs(self.external).sum()):
            return _say(stand, "lifts_off", "nothing presses it onto the ground")
        # Support polygon, then forces of the feet.
        about = moment - np.cross(centre, total)
        reach, margin, edge = _find_support(self.structure, position, self.position, self.external)
        problem = FootProblem(
            position - centre, np.concatenate([total, about]), frame, self._moving(), self.size
        )
        stand = replace(
            stand, centre_of_pressure=reach, tipping_margin=margin, edge=tuple(name[k] for k in edge)
        )
        return self._with_forces(stand, problem, frame)

    def _moving(self) -> BoolArray:
        """Return which motions there are: slides along modelled axes, turns in planes of two of them."""
        axes = self.structure.axes
        slides = [axis in axes for axis in range(3)]
        turns = [
            all(other_axis in axes for other_axis in range(3) if other_axis != axis) for axis in range(3)
        ]
        return np.array(slides + turns)

    def _with_forces(self, stand: Stand, problem: FootProblem, frame: FloatArray) -> Stand:
        """Return the verdict, with forces and their proof."""
        foot_forces = find_foot_forces(problem, self.mu)
        scale = float(np.linalg.norm(problem.load))
        needed = np.inf if np.isinf(foot_forces.excess) else find_least_friction(problem)
        exists = foot_forces.excess <= GAP * scale
        sign = np.array([1.0, *[-1.0] * (len(frame) - 1)])
        force = (foot_forces.force * sign) @ frame if np.isfinite(foot_forces.excess) else stand.force
        distribution = ""
        if exists:
            force, distribution = self._distribute(problem, force, frame)
        stand = replace(
            stand, force=force, distribution=distribution, friction_needed=needed, excess=foot_forces.excess,
            motion=None if exists else self._move(problem, foot_forces.motion),
        )  # fmt: skip
        return self._name(stand, exists)

    def _distribute(
        self, problem: FootProblem, force: FloatArray, frame: FloatArray
    ) -> tuple[FloatArray, str]:
        """Return the forces of an equilibrium, those that statics determine, or the least squares."""
        if self.given is not None:
            return self.given[self.feet], "equilibrium"
        matrix = problem.matrix
        rank = int(np.linalg.matrix_rank(matrix, tol=1e-9))
        smallest = -np.linalg.lstsq(matrix, problem.load, rcond=1e-12)[0].reshape(-1, len(frame))
        if not self.mu:  # normal forces alone
            normal = matrix[:, :: len(frame)]
            rank = int(np.linalg.matrix_rank(normal, tol=1e-9))
            smallest = np.zeros_like(smallest)
            smallest[:, 0] = -np.linalg.lstsq(normal, problem.load, rcond=1e-12)[0]
        tangential = np.linalg.norm(smallest[:, 1:], axis=1)
        scale = float(np.linalg.norm(problem.load))
        is_allowed = bool(
            (smallest[:, 0] >= 0.0).all() and (tangential <= self.mu * smallest[:, 0] + GAP * scale).all()
        )
        if not is_allowed:
            return force, "feasible"
        unknowns = len(smallest) if not self.mu else smallest.size
        sign = np.array([1.0, *[-1.0] * (len(frame) - 1)])
        return (smallest * sign) @ frame, "statics" if unknowns <= rank else "least_squares"

    def _move(self, problem: FootProblem, motion: FloatArray) -> FloatArray:
        """Return the velocities of all nodes in a certificate, at unit power of the loads."""
        rigid_motion = np.zeros(6)
        rigid_motion[problem.moving] = motion
        centre = self.position[self.ground.node[self.feet]].mean(axis=0)
        moved = rigid_motion[:3] + np.cross(rigid_motion[3:] / problem.size, self.position - centre)
        power = float(motion @ problem.load)
        return np.asarray(moved / power if power > 0 else moved)

    def _name(self, stand: Stand, exists: bool) -> Stand:
        """Return the verdict in words."""
        margin, planar = stand.tipping_margin, len(self.structure.axes) == 2
        edge = " and ".join(stand.edge)
        line = not planar and _is_line(stand.place, self.size)
        if len(stand.foot) == 1:
            return _say(stand, "one_foot", f"one foot, {stand.foot[0]}: it balances at best")
        if line:
            away = f", from which its load is {-margin:.6g} m away" if margin < -ROUNDING * self.size else ""
            return _say(
                stand, "on_a_line", f"feet on a line, {', '.join(stand.foot)}: it tips about it{away}"
            )
        if margin < 0.0 or np.isinf(stand.friction_needed):
            about = f"the edge between {edge}" if not planar else edge
            return _say(
                stand, "tips", f"tips about {about}: its load meets the ground {-margin:.6g} m outside"
            )
        if not exists:
            needs = f"needs a friction of {stand.friction_needed:.9g}, the ground has {self.mu:.9g}"
            return _say(stand, "slides", f"slides: {needs}")
        location = (
            f"{margin:.6g} m from the edge between {edge}" if not planar else f"{margin:.6g} m from {edge}"
        )
        return _say(stand, "stands", f"stands: its load meets the ground {location}")


def find_support_margin(
    structure: Structure, position: FloatArray, external: FloatArray, force: FloatArray
) -> tuple[float, tuple[str, ...]]:
    """Return the tipping margin [m] and its edge, for feet that press with forces (n_contacts, 3) [N]."""
    ground = structure.ground
    assert ground is not None
    node = ground.node[force @ ground.normal > 0.0]
    _, margin, edge = _find_support(structure, position[node], position, external)
    return margin, tuple(structure.node_name[node[k]] for k in edge)


def find_pressure_centre(
    normal: FloatArray, origin: FloatArray, position: FloatArray, external: FloatArray
) -> FloatArray:
    """Return where the resultant of loads on nodes (n_nodes, 3) [N] meets the plane through a point (3,)."""
    about = np.cross(position - origin, external).sum(axis=0)
    return np.asarray(origin + np.cross(normal, about) / float(external.sum(axis=0) @ normal))


def _find_support(
    structure: Structure, place: FloatArray, position: FloatArray, external: FloatArray
) -> tuple[FloatArray, float, tuple[int, ...]]:
    """Return the centre of pressure (3,), the tipping margin and the feet of its edge; place: of the feet."""
    ground = structure.ground
    assert ground is not None
    centre = place.mean(axis=0)
    reach = find_pressure_centre(ground.normal, centre, position, external)
    along = ground.tangents(structure.axes).T
    size = float(np.ptp(position, axis=0).max()) or 1.0
    return reach, *_find_margin((place - centre) @ along, (reach - centre) @ along, size)


def _find_margin(points: FloatArray, at: FloatArray, size: float) -> tuple[float, tuple[int, ...]]:
    """Return a point's least distance from edges of the hull of feet (n_feet, 1 or 2), and its feet."""
    if points.shape[1] == 1:
        low, high = int(points.argmin()), int(points.argmax())
        distances = [float(at[0] - points[low, 0]), float(points[high, 0] - at[0])]
        return min(distances), ((low, high)[int(np.argmin(distances))],)
    if _is_line(points, size):
        reach = points @ np.linalg.svd(points - points.mean(axis=0))[2][0]
        ends = int(reach.argmin()), int(reach.argmax())  # the two that are farthest apart
        start, end = points[list(ends)]
        span = float((end - start) @ (end - start))
        fraction = float(np.clip((at - start) @ (end - start) / span, 0.0, 1.0)) if span else 0.0
        return -float(np.linalg.norm(at - start - fraction * (end - start))), tuple(dict.fromkeys(ends))
    hull = scipy.spatial.ConvexHull(points)
    inside = -(hull.equations[:, :2] @ at + hull.equations[:, 2])
    k = int(inside.argmin())
    return float(inside[k]), tuple(int(i) for i in np.sort(hull.simplices[k]))


def _is_line(place: FloatArray, size: float) -> bool:
    """Return whether points lie on a line, or are one point."""
    spread = np.linalg.svd(place - place.mean(axis=0), compute_uv=False)
    return bool(len(place) < 3 or spread[1] <= LINE * size)


def _say(stand: Stand, verdict: str, message: str) -> Stand:
    return replace(stand, verdict=verdict, message=message)


def _jsonable(value: Any) -> Any:
    """Return None in place of a number that JSON does not have."""
    return None if isinstance(value, float) and not np.isfinite(value) else value
