"""Structures on the ground whose motions are known, for tests."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.structure.structure import Structure
from tests.models import simulator
from tests.runtime.build import bar, cable, make_structure, spring

Array = NDArray[np.float64]
GRAVITY = 9.81
METHODS = ("rk54", "rk853", "rodas", "radau")


def make_ground(nodes: int, **changes: Any) -> Ground:
    """Return a level ground for the first nodes, with friction."""
    values: dict[str, Any] = {
        "normal": np.array([0.0, 0.0, 1.0]),
        "offset": 0.0,
        "velocity": np.zeros(3),
        "node": np.arange(nodes),
        "radius": np.zeros(nodes),
        "stiffness": 1e5,
        "exponent": 1.0,
        "dissipation": 0.5,
        "friction": 0.5,
        "static_friction": None,
        "stick_stiffness": 1e5,
        "stick_damping": float(np.sqrt(1e5)),
    }
    return Ground(**{**values, **changes})


def make_block(position: Any, *, gravity: float = GRAVITY, load: Any = (0, 0, 0), **ground: Any) -> Structure:
    """Return a node of 1 kg above the ground; a cable that is always slack holds it to nothing."""
    structure = make_structure(
        [position, [0.0, 0.0, 1.0]],
        [cable(0, 1, 100.0)],
        anchored={1: "xyz"},
        gravity=(0.0, 0.0, -gravity),
        load={0: load},
    )
    return structure.with_changes(ground=make_ground(1, **ground))


def make_slope(angle: float, **ground: Any) -> tuple[Structure, Array]:
    """Return a block at its rest depth on a slope, and the unit vector downhill; angle [rad]."""
    normal = np.array([np.sin(angle), 0.0, np.cos(angle)])
    depth = GRAVITY * np.cos(angle) / 1e5
    structure = make_block(-depth * normal, normal=normal, **ground)
    return structure, np.array([np.cos(angle), 0.0, -np.sin(angle)])


def make_rod() -> Structure:
    """Return a uniform rigid rod of 1 m and 1 kg in the plane x z, 30 degrees from the ground."""
    angle = np.radians(30.0)
    ends = [[0.0, 0.0, 0.3], [np.cos(angle), 0.0, 0.3 + np.sin(angle)]]
    rod = make_structure(
        ends, [bar(0, 1, 1.0, 0.0, mass=1.0)], gravity=(0.0, 0.0, -GRAVITY), axes="xz", mass=0.0
    )
    return rod.with_changes(
        ground=make_ground(
            2, radius=np.full(2, 0.02), friction=0.4, stick_damping=100.0, dissipation=0.7163752666357
        )
    )


def make_prism(rotation: Array | None = None, order: Array | None = None, **ground: Any) -> Structure:
    """Return a prism of rigid bars whose lowest node is 0.5 m above the ground.

    rotation (3, 3): turns it; order (6,): number that each node has without it.
    """
    radius, height, twist = 0.2, 0.4, np.radians(150.0)
    angle = 2 * np.pi * np.arange(3) / 3
    low = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle], axis=1)
    high = np.stack([radius * np.cos(angle + twist), radius * np.sin(angle + twist), 0 * angle + height], 1)
    place = np.vstack([low, high])
    pairs = [[(k, 3 + k), (k, (k + 1) % 3), (3 + k, 3 + (k + 1) % 3), ((k + 1) % 3, 3 + k)] for k in range(3)]
    ends = [pair for group in pairs for pair in group]
    tension = find_selfstress(place, ends)
    members = []
    for (i, j), force in zip(ends, tension * 20.0 / tension.max(), strict=True):
        length = float(np.linalg.norm(place[i] - place[j]))
        rigid, soft = (
            bar(i, j, length, 0.0, mass=0.1),
            cable(i, j, length - force / 500.0, 500.0, damping=1.0),
        )
        members.append(rigid if force < 0 else soft)
    place = place if rotation is None else place @ rotation.T
    place = place + np.array([0.0, 0.0, 0.5 - place[:, 2].min()])
    if order is not None:
        number = np.argsort(order)
        place = place[order]
        members = [member | {"ends": tuple(number[list(member["ends"])])} for member in members[::-1]]
    prism = make_structure(place, members, gravity=(0.0, 0.0, -GRAVITY), mass=0.02)
    values = {"stiffness": 2e4, "stick_stiffness": 2e4, "stick_damping": 20.0, "dissipation": 0.3, **ground}
    return prism.with_changes(ground=make_ground(6, **values))


def find_selfstress(place: Array, ends: list[tuple[int, int]]) -> Array:
    """Return the tensions of the one self-stress, positive in the second member."""
    matrix = np.zeros((place.size, len(ends)))
    for e, (i, j) in enumerate(ends):
        direction = (place[i] - place[j]) / np.linalg.norm(place[i] - place[j])
        matrix[3 * i : 3 * i + 3, e], matrix[3 * j : 3 * j + 3, e] = direction, -direction
    stress = np.linalg.svd(matrix)[2][-1]
    return np.asarray(stress * np.sign(stress[1]))


def make_icosahedron() -> Structure:
    """Return six rigid bars of 0.5 m in 24 cables of 10 N, on one facet, without friction."""
    place = np.array(
        [np.roll([0.125 * a, 0.0, 0.25 * b], shift) for shift in range(3) for a in (1, -1) for b in (1, -1)]
    )
    members = []
    for i in range(12):
        for j in range(i):
            length = float(np.linalg.norm(place[i] - place[j]))
            if abs(length - 0.5) < 1e-9 and i // 4 == j // 4:
                members.append(bar(i, j, 0.5, 0.0))
            elif length < 0.31 and i // 4 != j // 4:
                members.append(cable(i, j, length - 10.0 / 200.0, 200.0, damping=5.0))
    down = np.ones(3) / np.sqrt(3.0)
    side = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    place = place @ np.stack([side, np.cross(-down, side), -down]).T
    place = place - [0.0, 0.0, place[:, 2].min() + 1e-4]
    small = make_structure(place, members, gravity=(0.0, 0.0, -GRAVITY), mass=0.05)
    return small.with_changes(ground=make_ground(12, friction=0.0, stiffness=2e4, dissipation=0.3))


def make_belt(speed: float, mass: float = 1.0, **ground: Any) -> Structure:
    """Return a block on a belt with the normal force 10 N, held by a spring of 100 N/m."""
    structure = make_structure(
        [[0.0, 0.0, -1e-4], [-1.0, 0.0, -1e-4]], [spring(0, 1, 1.0)], anchored={0: "yz", 1: "xyz"}, mass=mass
    )
    return structure.with_changes(
        ground=make_ground(
            1,
            velocity=np.array([speed, 0.0, 0.0]),
            **{"friction": 0.4, "stick_stiffness": 1e4, "stick_damping": 100.0, **ground},
        )
    )


def move(
    structure: Structure,
    method: str,
    times: Any,
    *,
    rtol: float = 1e-12,
    atol: float = 1e-14,
    integrators: tuple[str, ...] = METHODS,
    **more: Any,
) -> tuple[CompiledModel, Trajectory]:
    """Return the library and the motion over these times, with errors of steps alone.

    integrators: those of the library, one for all tests of a structure.
    """
    rigid = bool(structure.is_rigid.any())
    names = ("contact_force", "penetration") + (("stick_margin",) if structure.ground.friction else ())
    formulation = "rigid_bar" if rigid else "node_position"
    model = simulator(structure, *integrators, more=names, formulation=formulation)
    stepping = Stepping(atol=atol, control="steps")
    samples = np.array(times, dtype=float)
    end = float(samples[-1])
    return model, simulate(model, end, samples=samples, method=method, rtol=rtol, stepping=stepping, **more)


def compute_at(model: CompiledModel, trajectory: Trajectory, quantity: str, row: int) -> Array:
    """Return a quantity at one sample."""
    state: dict[str, Any] = {
        "coordinate": trajectory.coordinate[row],
        "velocity": trajectory.velocity[row],
    }
    if trajectory.internal is not None:
        state["internal"] = trajectory.internal[row]
    return np.asarray(model.compute(quantity, **state))
