"""Scenes of rigid bodies whose motions are known, random ones, and the map from the reference to states."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from tests.reference_bodies import BodyReference, turn
from tests.scene.samples import build

Array = Any  # NumPy arrays, real or complex
GRAVITY = 9.81
# Of the ground under robots.
LAW = {"stiffness": 2e4, "stick_stiffness": 2e4, "stick_damping": 40.0, "dissipation": 0.3, "friction": 0.6}


def make_middle_axis() -> dict[str, Any]:
    """Return a body that spins about its middle axis, not quite."""
    body = {
        "kind": "rigid",
        "mass": 1.0,
        "position": [0.0, 0.0, 0.0],
        "inertia": [1e-3, 2e-3, 3e-3],
        "angular_velocity": [0.02, 6.0, 0.01],
    }
    return {"name": "middle", "bodies": {"b": body | {"points": {"tip": [0.0, 0.0, 0.1]}}}}


def make_roller(slope: float, friction: float, ends: Sequence[float] = (0.0,), **body: Any) -> dict[str, Any]:
    """Return a body of balls along y at its rest depth on a slope [deg] that descends along x."""
    values: dict[str, Any] = {"mass": 1.0, "inertia": [0.004] * 3, "radius": 0.1} | body
    radius, tilt = values.pop("radius"), np.radians(slope)
    normal = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    height = radius - values["mass"] * GRAVITY * np.cos(tilt) / (1e5 * len(ends))
    points = {f"end{k}": {"position": [0.0, y, 0.0], "radius": radius} for k, y in enumerate(ends)}
    ground = {"stiffness": 1e5, "stick_stiffness": 1e5, "stick_damping": 300.0, "dissipation": 0.3}
    return {
        "name": "roller",
        "gravity": [0.0, 0.0, -GRAVITY],
        "bodies": {
            "b": {"kind": "rigid", "points": points, "position": (height * normal).tolist(), **values}
        },
        "ground": ground
        | {"normal": normal.tolist(), "contacts": [f"b.{k}" for k in points], "friction": friction},
    }


def make_rod_across() -> dict[str, Any]:
    """Return a rod that lies across a slope of 10 degrees."""
    return make_roller(10.0, 0.5, (0.15, -0.15), mass=0.4, inertia=[2e-3, 1.5e-4, 2e-3], radius=0.03)


def make_backspin() -> dict[str, Any]:
    """Return a ball that slides on level ground and spins backwards."""
    return make_roller(0.0, 0.3, centre_velocity=[1.5, 0.0, 0.0], angular_velocity=[0.0, -60.0, 0.0])


def make_three_rods(
    spins: Sequence[Sequence[float]] = ((0.5, -0.3, 4), (0, 0, -2), (0.2, 0.1, 1)),
) -> dict[str, Any]:
    """Return three rods of tube, balls and motors in nine cables off their axes, in flight."""
    bodies, members, half = {}, {}, 0.17
    weights = [
        ("ball", 0.024, (-half,), 0.02),
        ("ball", 0.024, (half,), 0.02),
        ("cylinder", 0.008, (-half, half), 0.06),
    ]
    weights += [
        ("cylinder", 0.018, (s * a * half, s * b * half), 0.07) for s, a, b in ((-1, 0.9, 0.5), (1, 0.5, 0.9))
    ]
    parts = [
        {"kind": kind, "radius": radius, "mass": mass}
        | (
            {"position": [0.0, 0.0, z[0]]}
            if len(z) == 1
            else {"from": [0.0, 0.0, z[0]], "to": [0.0, 0.0, z[1]]}
        )
        for kind, radius, z, mass in weights
    ]
    places = {"out": (0.02, 0.0), "in": (-0.02, 0.0), "side": (0.0, 0.02)}
    points = {
        f"{e}_{p}": [x, y, z * half]
        for e, z in (("low", -0.95), ("high", 0.95))
        for p, (x, y) in places.items()
    }
    for k in range(3):
        low, high = place_on_circle(k, 0.0, 0.0), place_on_circle(k, 150.0, 0.24)
        place = {"from": low, "to": high, "angular_velocity": list(spins[k])}
        bodies[f"rod{k}"] = {"kind": "rigid", "parts": parts, "points": points} | place
        following, before = (k + 1) % 3, (k + 2) % 3
        for name, ends, stiffness, rest in (
            ("bottom", (f"rod{k}.low_out", f"rod{following}.low_in"), 500.0, 0.16),
            ("top", (f"rod{k}.high_out", f"rod{following}.high_in"), 500.0, 0.16),
            ("vertical", (f"rod{k}.low_side", f"rod{before}.high_side"), 700.0, 0.19),
        ):
            cable = {"kind": "cable", "spring_constant": stiffness, "rest_length": rest, "damping": 3.0}
            members[f"{name}{k}"] = cable | {"nodes": list(ends)}
    return {"name": "flight", "bodies": bodies, "members": members}


def make_dropped_robot(lift: float = 0.32, **ground: Any) -> dict[str, Any]:
    """Return a robot of three rods that is dropped and thrown along x."""
    bodies, members = {}, {}
    points: dict[str, Any] = {
        n: {"position": [0.0, 0.0, z], "radius": 0.025} for n, z in (("low", -0.18), ("high", 0.18))
    }
    for end, z in (("low", -0.17), ("high", 0.17)):
        for name, x, y in (("out", 0.018, 0.0), ("in", -0.018, 0.0), ("side", 0.0, 0.018)):
            points[f"{end}_{name}"] = [x, y, z]
    for k in range(3):
        ends = {
            "from": place_on_circle(k, 0.0, lift - 0.11),
            "to": place_on_circle(k, 150.0, lift + 0.11),
        }
        body: dict[str, Any] = {
            "kind": "rigid",
            "mass": 0.25,
            "inertia": [2.6e-3, 2.6e-3, 5e-5],
            "points": points,
        }
        bodies[f"rod{k}"] = body | ends | {"centre_velocity": [0.6, 0.0, 0.0]}
        for name, first, second, stiffness, rest in (
            ("bottom", f"rod{k}.low_out", f"rod{(k + 1) % 3}.low_in", 400.0, 0.15),
            ("top", f"rod{k}.high_out", f"rod{(k + 1) % 3}.high_in", 400.0, 0.15),
            ("vertical", f"rod{k}.low_side", f"rod{(k + 2) % 3}.high_side", 600.0, 0.18),
        ):
            cable = {"kind": "cable", "spring_constant": stiffness, "rest_length": rest, "damping": 2.0}
            members[f"{name}{k}"] = cable | {"nodes": [first, second]}
    touching = [f"rod{k}.{end}" for k in range(3) for end in ("low", "high")]
    return {
        "name": "dropped",
        "gravity": [0.0, 0.0, -GRAVITY],
        "bodies": bodies,
        "members": members,
        "ground": {"contacts": touching} | LAW | ground,
    }


def make_standing_robot() -> dict[str, Any]:
    """Return six rods in 24 cables off their axes, on three feet, near equilibrium."""
    corners = [
        np.roll([0.125 * a, 0.0, 0.25 * b], shift) for shift in range(3) for a in (1, -1) for b in (1, -1)
    ]
    side, down = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0), np.ones(3) / np.sqrt(3.0)
    place = np.array(corners) @ np.stack([side, np.cross(-down, side), -down]).T
    place = place - [0.0, 0.0, place[:, 2].min() - 0.02 + 1e-4]
    points: dict[str, Any] = {}
    for end, z in (("a", 0.25), ("b", -0.25)):
        points |= {f"{end}{k}": [x, y, 0.95 * z] for k, (x, y) in enumerate(((0.012, 0.003), (-0.012, 0.0)))}
        points[f"foot_{end}"] = {"position": [0.0, 0.0, z], "radius": 0.02}
    rod: dict[str, Any] = {"kind": "rigid", "mass": 0.15, "inertia": [3e-3, 3.01e-3, 2e-5], "points": points}
    bodies = {
        f"rod{k}": rod | {"from": place[2 * k + 1].tolist(), "to": place[2 * k].tolist()} for k in range(6)
    }
    members: dict[str, Any] = {}
    used = [0] * 12
    for i in range(12):
        for j in range(i):
            length = float(np.linalg.norm(place[i] - place[j]))
            if i // 4 != j // 4 and length < 0.31:
                ends = [f"rod{n // 2}.{'ab'[n % 2]}{used[n] % 2}" for n in (i, j)]
                cable = {
                    "kind": "cable",
                    "spring_constant": 400.0,
                    "rest_length": 0.9 * length,
                    "damping": 1.0,
                }
                members[f"c{i}_{j}"] = cable | {"nodes": ends}
                used[i], used[j] = used[i] + 1, used[j] + 1
    feet = [f"rod{k}.foot_{end}" for k in range(6) for end in "ab"]
    return {
        "name": "standing",
        "gravity": [0.0, 0.0, -GRAVITY],
        "bodies": bodies,
        "members": members,
        "ground": {"contacts": feet} | LAW,
    }


def place_on_circle(k: int, twist: float, height: float) -> list[float]:
    """Return the k-th of three places on a circle of 0.12 m, turned by a twist [deg]."""
    angle = np.radians(120.0 * k + twist)
    return [0.12 * float(np.cos(angle)), 0.12 * float(np.sin(angle)), height]


def make_random(seed: int) -> dict[str, Any]:
    """Return bodies in any orientation, with members among points, nodes and an anchor, loads and inputs."""
    rng = np.random.default_rng(seed)
    bodies: dict[str, Any] = {}
    for b in range(int(rng.integers(1, 4))):
        points = {f"p{k}": rng.normal(size=3) * 0.2 for k in range(4)}
        spheres = {
            f"s{k}": {"position": rng.normal(size=3) * 0.2, "radius": rng.uniform(0.01, 0.05)}
            for k in range(2)
        }
        motion = {"centre_velocity": rng.normal(size=3), "angular_velocity": rng.normal(size=3) * 3.0}
        at = rng.normal(size=3) * 0.4
        place = {"kind": "rigid", "points": points | spheres, **motion, **_orient(rng, at)}
        bodies[f"b{b}"] = place | (_weigh(rng) if rng.random() < 0.6 else {"parts": _make_parts(rng)})
    nodes: dict[str, Any] = {
        "n0": {"position": rng.normal(size=3), "mass": 0.3, "velocity": rng.normal(size=3)}
    }
    nodes["fixed"] = {"position": rng.normal(size=3) + np.array([0.0, 0.0, 4.0]), "anchored": True}
    ends = [f"{b}.{p}" for b, body in bodies.items() for p in body["points"]] + list(nodes)
    names = sorted(
        {*(f"b{b}.s0" for b in range(len(bodies))), *(f"b{b}.s1" for b in range(len(bodies))), "n0"}
    )
    scene: dict[str, Any] = {
        "name": "random",
        "gravity": [0.3, -0.2, -9.81],
        "bodies": bodies,
        "nodes": nodes,
    }
    found = BodyReference(scene)
    position = found.move_points(found.start, found.owner, found.local)[0]
    members: dict[str, Any] = {}
    while len(members) < 3 * len(bodies) + 2:
        first, second = rng.choice(len(ends), 2, replace=False)
        pair = [["n0", "b0.p2"], ["b0.p3", "fixed"], [ends[first], ends[second]]][min(len(members), 2)]
        owners = [found.owner[found.index[name]] for name in pair]
        length = np.linalg.norm(np.subtract(*(position[found.index[name]] for name in pair)))
        is_new = sorted(pair) not in [sorted(member["nodes"]) for member in members.values()]
        if owners[0] != owners[1] and length > 0.05 and is_new:
            values = {"spring_constant": rng.uniform(50, 500), "rest_length": length * rng.uniform(0.7, 1.1)}
            kind = "bar" if rng.random() < 0.2 else "cable"
            members[f"m{len(members)}"] = {
                "kind": kind,
                "nodes": pair,
                "damping": 2.0 * rng.random(),
                **values,
            }
    scene["members"] = members
    scene["loads"] = [
        {"node": "b0.p0", "force": rng.normal(size=3)},
        {"node": "n0", "force": rng.normal(size=3)},
    ]
    scene["inputs"] = [
        {"kind": "rest_length", "name": "wind", "members": ["m0", "m2"]},
        {"kind": "force", "name": "push", "nodes": ["b0.p1"], "direction": [0.0, 0.6, 0.8]},
    ]
    normal = rng.normal(size=3) * 0.3 + [0.0, 0.0, 1.0]
    normal /= np.linalg.norm(normal)
    heights = np.sort([position[found.index[name]] @ normal for name in names])
    law = {
        "stiffness": 2e3,
        "stick_stiffness": 2e3,
        "stick_damping": 20.0,
        "dissipation": 0.2,
        "friction": 0.5,
    }
    offset = float(heights[len(names) // 2])
    scene["ground"] = {"contacts": names, "normal": normal, "offset": offset, **law}
    return dict(_plain(scene))


def _orient(rng: np.random.Generator, at: Array) -> dict[str, Any]:
    """Return a place and an orientation, said in one of five ways."""
    way, axis, quaternion = rng.integers(5), rng.normal(size=3), rng.normal(size=4)
    quaternion /= np.linalg.norm(quaternion)
    ways: list[dict[str, Any]] = [
        {"position": at, "quaternion": quaternion},
        {"centre": at, "axis": axis, "angle_deg": rng.uniform(-180, 180)},
        {"from": at, "to": at + axis * 0.3},
        {"position": at, "matrix": turn(quaternion)},
        {"centre": at},
    ]
    return ways[way]


def _weigh(rng: np.random.Generator) -> dict[str, Any]:
    """Return mass, centre and an inertia with off-diagonal entries, those of six random particles."""
    place, mass = rng.normal(size=(6, 3)) * 0.2, rng.uniform(0.05, 0.3, size=6)
    centre = mass @ place / mass.sum()
    arm = place - centre
    inertia = np.eye(3) * (mass @ (arm**2).sum(1)) - (arm.T * mass) @ arm
    return {"mass": mass.sum(), "centre_of_mass": centre, "inertia": (inertia + inertia.T) / 2}


def _make_parts(rng: np.random.Generator) -> list[dict[str, Any]]:
    """Return one part of each kind, with masses or densities."""
    ends = [{"from": rng.normal(size=3) * 0.1, "to": rng.normal(size=3) * 0.3} for _ in range(3)]
    parts: list[dict[str, Any]] = [
        {"kind": "ball", "radius": 0.05, "position": rng.normal(size=3) * 0.2},
        {"kind": "cylinder", "radius": 0.03, **ends[0]},
        {"kind": "tube", "radius": 0.04, "inner_radius": 0.03, **ends[1]},
        {"kind": "capsule", "radius": 0.04, **ends[2]},
        {
            "kind": "box",
            "size": rng.uniform(0.05, 0.2, size=3),
            "position": rng.normal(size=3) * 0.2,
            "quaternion": [0.5] * 4,
        },
    ]
    weights = [{"mass": rng.uniform(0.1, 0.3)} if rng.random() < 0.5 else {"density": 300.0} for _ in parts]
    return [part | weight for part, weight in zip(parts, weights, strict=True)]


def _plain(value: Any) -> Any:
    """Return a document of lists and numbers, without arrays."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(entry) for entry in value]
    return value.item() if isinstance(value, np.generic) else value


class MappedScene:
    """A scene as the package has it, four corners a body, beside the reference with quaternions."""

    def __init__(self, scene: dict[str, Any]) -> None:
        self.reference = BodyReference(scene)
        self.structure = build(_plain(scene))[0]
        places = self.structure.coordinate_node_axis
        self.node, self.axis = places.T
        # Nodes as points of the reference: corners of bodies, points by name.
        count = self.structure.n_nodes
        self.owner, self.local = np.zeros(count, dtype=int), np.zeros((count, 3))
        index = {name.replace(".", "_"): point for name, point in self.reference.index.items()}
        for node, name in enumerate(self.structure.node_name):
            if name in index:
                point = index[name]
                self.owner[node], self.local[node] = self.reference.owner[point], self.reference.local[point]
        for b, body in enumerate(self.structure.bodies):
            self.owner[list(body.corner)] = b
            self.local[list(body.corner)] = body.corner_local - self.reference.centre[b]
        # Deflections along the tangents of the ground.
        ground = self.structure.ground
        if ground is not None:
            at = [index[self.structure.node_name[node]] for node in ground.node]
            self.contact = [self.reference.contacts.tolist().index(point) for point in at]
            self.tangent = ground.tangents((0, 1, 2))

    def move_nodes(self, y: Array) -> tuple[Array, Array]:
        """Return positions and velocities of all nodes."""
        position, velocity, _, _ = self.reference.move_points(y, self.owner, self.local)
        return position, velocity

    def state(self, y: Array) -> Array:
        """Return the model's state (q, q', z) of a state of the reference."""
        position, velocity = self.move_nodes(y)
        parts = [position[self.node, self.axis], velocity[self.node, self.axis]]
        return np.concatenate([*parts, self.deflection(y)])

    def rates(self, y: Array, rates: Array) -> Array:
        """Return the rates of the model's state from those of the reference."""
        _, q, _, _, omega, _, _ = self.reference.split(y)
        _, _, _, push, turns, nodes, _ = self.reference.split(rates)
        still = np.zeros((self.reference.owner.max(initial=0) + 1 + len(self.reference.fixed), 3))[
            len(omega) :
        ]
        omega, turns = (np.vstack([part, still])[self.owner] for part in (omega, turns))
        whole = np.vstack([push, nodes, np.zeros_like(self.reference.fixed)])[self.owner]
        axes = np.concatenate([turn(q), still[..., None] + np.eye(3)])[self.owner]
        inner = np.cross(turns, self.local) + np.cross(omega, np.cross(omega, self.local))
        acceleration = whole + (axes @ inner[..., None])[..., 0]
        velocity = self.move_nodes(y)[1]
        parts = [velocity[self.node, self.axis], acceleration[self.node, self.axis]]
        return np.concatenate([*parts, self.deflection(rates)])

    def deflection(self, y: Array) -> Array:
        """Return the deflections of all contacts along the tangents of the ground."""
        if self.structure.ground is None or not self.structure.ground.friction:
            return np.zeros(0)
        return (self.reference.split(y)[-1][self.contact] @ self.tangent.T).ravel()

    def find_bodies(self, position: Array, velocity: Array) -> tuple[Array, Array, Array, Array]:
        """Return centres, rotations, velocities, angular velocities in the frames from those of all nodes."""
        found = []
        for b, body in enumerate(self.structure.bodies):
            corner = list(body.corner)
            base = np.hstack([np.ones((4, 1)), body.corner_local - self.reference.centre[b]])
            place, rate = (np.linalg.solve(base, values[corner]) for values in (position, velocity))
            spin = place[1:] @ rate[1:].T
            found.append((place[0], place[1:].T, rate[0], np.array([spin[2, 1], spin[0, 2], spin[1, 0]])))
        return tuple(np.array(part) for part in zip(*found, strict=True))  # type: ignore[return-value]
