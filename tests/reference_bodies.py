"""Rigid bodies with unit quaternions in plain NumPy, read from the same scene: independent of the package.

State y: centres r, quaternions q, free nodes x; velocities r', omega in the bodies' frames, x'; deflections s
of the contacts, vectors along the plane. With R of q / |q|, p = r + R c of a point, n out of the ground

q' = q (0, omega) / 2,   I omega' = R^T M - omega x I omega,   m r'' = F + m g
t  = max(0, k (l - rho) + c l') while l > rho, else 0             a cable; of a bar k (l - rho) + c l'
d  = offset + radius - n . p,  v = r' + (R omega) x (p - radius n - r) along the plane, less the belt
N  = k d^e max(0, 1 + a d') where d > 0,  T = kt s + ct v,  F = T min(1, mu N / |T|),  s' = (F - kt s) / ct

All of it takes complex numbers, so that imaginary steps give derivatives to rounding.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

Array = Any  # NumPy arrays, real or complex
GROUND: dict[str, Any] = dict.fromkeys(("offset", "radius", "stiffness", "dissipation", "friction"), 0.0)
GROUND |= {"exponent": 1.0, "contacts": (), "normal": (0.0, 0.0, 1.0), "velocity": np.zeros(3)}


def unit(vector: Array) -> Array:
    """Return a vector over its length."""
    return np.array(vector, float) / np.linalg.norm(vector)


def turn(quaternion: Array) -> Array:
    """Return the rotations (..., 3, 3) of quaternions (..., 4) of any length."""
    w, x, y, z = np.moveaxis(quaternion / np.sqrt((quaternion**2).sum(-1))[..., None], -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def read_orientation(body: Mapping[str, Any]) -> Array:
    """Return the quaternion of a body or part."""
    if "quaternion" in body:
        return unit(body["quaternion"])
    if "axis" in body:
        half = np.radians(body["angle_deg"]) / 2
        return np.array([np.cos(half), *(np.sin(half) * unit(body["axis"]))])
    if "from" in body:  # the shortest turn of z
        x, y, z = unit(np.subtract(body["to"], body["from"]))
        return unit([1 + z, -y, x, 0.0]) if z > -1 else np.array([0.0, 1.0, 0.0, 0.0])
    return Rotation.from_matrix(body.get("matrix", np.eye(3))).as_quat(scalar_first=True)


def weigh_part(part: Mapping[str, Any]) -> tuple[float, Array, Array]:
    """Return mass, centre and inertia (3, 3) about it of a part with a mass or a density."""
    r, hole = part.get("radius", 0.0), part.get("inner_radius", 0.0)
    ends = [np.array(part[key], float) for key in ("from", "to") if key in part]
    length = np.linalg.norm(ends[1] - ends[0]) if ends else 0.0
    ball, tube = 4 / 3 * np.pi * r**3, np.pi * (r**2 - hole**2) * length
    across, along = (r**2 + hole**2) / 4 + length**2 / 12, (r**2 + hole**2) / 2
    if part["kind"] == "box":
        a, b, c = np.array(part["size"]) ** 2
        volume, moments = np.prod(part["size"]), np.array([b + c, a + c, a + b]) / 12
    elif part["kind"] in ("ball", "capsule"):  # a capsule without length is a ball
        cap = 0.4 * r**2 + length**2 / 4 + 3 / 8 * length * r
        volume, across = ball + tube, ball * cap + tube * across
        moments = np.array([across, across, 0.4 * ball * r**2 + tube * along]) / volume
    else:
        volume, moments = tube, np.array([across, across, along])
    mass = part["mass"] if "mass" in part else part["density"] * volume
    axes, place = turn(read_orientation(part)), sum(ends) / 2 if ends else np.array(part["position"], float)
    return mass, place, mass * (axes * moments) @ axes.T


def weigh_body(body: Mapping[str, Any]) -> tuple[float, Array, Array]:
    """Return mass, centre in the frame and inertia about it of a body."""
    if "mass" in body:
        inertia = np.array(body["inertia"], float)
        centre = np.array(body.get("centre_of_mass", np.zeros(3)), float)
        return body["mass"], centre, inertia if inertia.ndim == 2 else np.diag(inertia)
    parts = [weigh_part(part) for part in body["parts"]]
    mass = sum(part[0] for part in parts)
    centre = sum(m * c for m, c, _ in parts) / mass
    arms = [(m, c - centre, inertia) for m, c, inertia in parts]
    return mass, centre, sum(i + m * (a @ a * np.eye(3) - np.outer(a, a)) for m, a, i in arms)


class BodyReference:
    """Bodies, nodes, members, ground and loads of a scene, and their motion.

    Owners of points are the bodies, then the free nodes, then the fixed ones.
    """

    def __init__(self, scene: Mapping[str, Any]) -> None:
        bodies, nodes = scene.get("bodies", {}), scene.get("nodes", {})
        weights = [weigh_body(body) for body in bodies.values()]
        self.mass = np.array([mass for mass, _, _ in weights])
        self.centre = np.array([centre for _, centre, _ in weights]).reshape(-1, 3)
        self.inertia = np.array([inertia for _, _, inertia in weights]).reshape(-1, 3, 3)
        free = {name: node for name, node in nodes.items() if not node.get("anchored", False)}
        fixed = {name: node for name, node in nodes.items() if name not in free}
        self.node_mass = np.array([node["mass"] for node in free.values()])
        self.fixed = np.array([node["position"] for node in fixed.values()], float).reshape(-1, 3)
        point = {name: (len(bodies) + k, np.zeros(3), 0.0) for k, name in enumerate([*free, *fixed])}
        for b, (name, body) in enumerate(bodies.items()):
            for key, value in body.get("points", {}).items():
                of = value if isinstance(value, Mapping) else {"position": value}
                point[f"{name}.{key}"] = (b, of["position"] - self.centre[b], of.get("radius", 0.0))
        self.index = {name: k for k, name in enumerate(point)}
        self.owner = np.array([owner for owner, _, _ in point.values()], int)
        self.local = np.array([arm for _, arm, _ in point.values()]).reshape(-1, 3)
        members = list(scene.get("members", {}).values())
        self.ends = np.array([[self.index[n] for n in m["nodes"]] for m in members], int).reshape(-1, 2)
        values = [(m["spring_constant"], m["rest_length"], m.get("damping", 0.0)) for m in members]
        self.stiffness, self.rest_length, self.damping = np.array(values, float).reshape(-1, 3).T
        self.is_cable = np.array([member["kind"] == "cable" for member in members], bool)
        self.gravity = np.array(scene.get("gravity", np.zeros(3)), float)
        self.load = np.zeros((len(point), 3))
        for load in scene.get("loads", ()):
            self.load[self.index[load["node"]]] += load["force"]
        self.ground: dict[str, Any] = GROUND | dict(scene.get("ground", {}))
        self.normal = unit(self.ground["normal"])
        self.contacts = np.array([self.index[name] for name in self.ground["contacts"]], int)
        self.radius = np.array([point[n][2] or self.ground["radius"] for n in self.ground["contacts"]])
        # The state at the start.
        still, quaternion, centre = np.zeros(3), [read_orientation(body) for body in bodies.values()], []
        for body, q, c in zip(bodies.values(), quaternion, self.centre, strict=True):
            half_way = np.add(body["from"], body["to"]) / 2 if "from" in body else still
            centre.append(body.get("centre", body.get("position", half_way) + turn(q) @ c))
        rest = [node["position"] for node in free.values()]
        rates = [[b.get(k, still) for b in bodies.values()] for k in ("centre_velocity", "angular_velocity")]
        moves = [node.get("velocity", still) for node in free.values()]
        parts = [centre, quaternion, rest, *rates, moves, np.zeros((len(self.contacts), 3))]
        self.start = np.concatenate([np.array(part, float).ravel() for part in parts])

    def split(self, y: Array) -> list[Array]:
        """Return r, q, x, r', omega, x', s of a state, one row each."""
        n, m = len(self.mass), len(self.node_mass)
        shapes = [(n, 3), (n, 4), (m, 3), (n, 3), (n, 3), (m, 3), (len(self.contacts), 3)]
        cuts = np.cumsum([rows * columns for rows, columns in shapes])[:-1]
        return [part.reshape(shape) for part, shape in zip(np.split(y, cuts), shapes, strict=True)]

    def move_points(self, y: Array, owner: Array, local: Array) -> tuple[Array, Array, Array, Array]:
        """Return positions, velocities, arms from the owner's centre and its spin of points, in the world."""
        r, q, x, v, omega, xdot, _ = self.split(y)
        still = np.zeros((len(x) + len(self.fixed), 3))
        axes = np.concatenate([turn(q), still[..., None] + np.eye(3)])
        spin = (axes @ np.vstack([omega, still])[..., None])[owner, :, 0]
        arm = (axes[owner] @ local[..., None])[..., 0]
        velocity = np.vstack([v, xdot, 0 * self.fixed])[owner] + np.cross(spin, arm)
        return np.vstack([r, x, self.fixed])[owner] + arm, velocity, arm, spin

    def tensions(self, position: Array, velocity: Array, rest_length: Array) -> tuple[Array, Array]:
        """Return the tensions, and unit vectors from the first end to the second."""
        way, rate = (a[self.ends[:, 1]] - a[self.ends[:, 0]] for a in (position, velocity))
        length = np.sqrt((way**2).sum(1))
        along = way / length[:, None]
        tension = self.stiffness * (length - rest_length) + self.damping * (rate * along).sum(1)
        pulls = ~self.is_cable | ((length.real > rest_length.real) & (tension.real > 0))
        return np.where(pulls, tension, 0.0), along

    def touch(self, position: Array, velocity: Array, s: Array) -> tuple[Array, Array]:
        """Return the forces of the ground on contacts at their lowest points, and the rates of s."""
        g, n = self.ground, self.normal
        depth = g["offset"] - position @ n
        closing = 1 - g["dissipation"] * (velocity @ n)
        closed = (depth.real > 0) & (closing.real > 0)
        normal = closed * g["stiffness"] * np.where(closed, depth, 1.0) ** g["exponent"] * closing
        if not g["friction"]:
            return normal[:, None] * n, np.zeros_like(s)
        slide = velocity - (velocity @ n)[:, None] * n - g["velocity"]
        trial = g["stick_stiffness"] * s + g["stick_damping"] * slide
        size, limit = np.sqrt((trial**2).sum(1)), g["friction"] * normal
        slips = size.real > limit.real
        friction = trial * np.where(slips, limit / np.where(slips, size, 1.0), 1.0 * closed)[:, None]
        return normal[:, None] * n - friction, (friction - g["stick_stiffness"] * s) / g["stick_damping"]

    def rates(self, y: Array, rest_length: Array | None = None, load: Array | None = None) -> Array:
        """Return y'; rest lengths and forces on points (n_points, 3) as of the scene if none are given."""
        _, q, _, v, omega, xdot, s = self.split(y)
        rest_length = self.rest_length if rest_length is None else rest_length
        load = self.load if load is None else load
        position, velocity, arm, spin = self.move_points(y, self.owner, self.local)
        tension, along = self.tensions(position, velocity, rest_length)
        at, foot, pull = self.contacts, -self.radius[:, None] * self.normal, tension[:, None] * along
        push, slip = self.touch(position[at] + foot, velocity[at] + np.cross(spin[at], foot), s)
        # Forces on owners, and their moments about the centres.
        (first, second), b, n = self.ends.T, len(self.mass), len(self.mass) + len(self.node_mass)
        force, moment = np.zeros((2, n + len(self.fixed), 3), dtype=np.result_type(y, rest_length, load))
        points = self.owner[np.concatenate([np.arange(len(arm)), first, second, at])]
        arms = np.vstack([arm, arm[first], arm[second], arm[at] + foot])
        forces = np.vstack([load, pull, -pull, push])
        np.add.at(force, points, forces)
        np.add.at(moment, points, np.cross(arms, forces))
        gyration = np.cross(omega, (self.inertia @ omega[..., None])[..., 0])
        torque = (np.swapaxes(turn(q), 1, 2) @ moment[:b, :, None])[..., 0] - gyration
        way = q[:, :1] * omega + np.cross(q[:, 1:], omega)
        turned = np.hstack([-(q[:, 1:] * omega).sum(1)[:, None], way]) / 2
        parts = [v, turned, xdot, force[:b] / self.mass[:, None] + self.gravity]
        parts += [np.linalg.solve(self.inertia, torque[..., None])[..., 0]]
        parts += [force[b:n] / self.node_mass[:, None] + self.gravity, slip]
        return np.concatenate([part.ravel() for part in parts])

    def integrate(self, times: Iterable[float], rtol: float = 1e-12, max_step: float = np.inf) -> Array:
        """Return the states (n_t, n) at these times from the start at 0, by DOP853."""
        states, now = [self.start], 0.0
        given: dict[str, Any] = {"rtol": rtol, "atol": rtol / 100, "max_step": max_step}
        for time in times:
            found = solve_ivp(lambda _, y: self.rates(y), (now, time), states[-1], "DOP853", **given)
            states, now = [*states, found.y[:, -1]], time
        return np.array(states[1:])
