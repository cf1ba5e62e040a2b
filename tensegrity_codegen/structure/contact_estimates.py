"""Estimates about contacts with the ground, from numbers of the scene: mass, weight, depth, frequency."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.structure.bodies import Bar, BodySystem, FixedBody, RigidBody
from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.structure.kinematics import compute_node_position
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import BoolArray, FloatArray, IntArray
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.system.root import find_root

Subject = Structure | BodySystem

LEVEL = 1e-6  # of the size: nodes that are so much higher than the lowest ones are as low
ALONG = 1e-12  # component of a unit vector below which it counts as zero
SERIES_RANGE = 0.1  # of u, below which (ln(1 + u) - u) / u^2 comes from its series
SERIES = [(-1.0) ** (n + 1) / n for n in range(2, 20)]  # error below 1e-17 in this range


@dataclass(frozen=True)
class ContactEstimates:
    """What the numbers of a ground mean for a structure that rests on it.

    mass (n_contacts,) [kg]: mass at each contact: of a node with half of each of its members, of a point of a
        body the mass of the body over the number of its contacts.
    weight [N]: weight of what can move, along the normal into the ground; 0 if gravity does not act into
        it.
    penetration [m]: of each contact, where all carry equal parts of the weight.
    largest_penetration [m]: where one contact carries the whole weight.
    stiffness [N/m]: slope of the normal force at `penetration`.
    frequency [Hz]: of the lightest contact alone on the ground, sqrt(stiffness / mass) / (2 pi).
    stick_offset [m]: largest tangential offset of a contact that sticks under its part of the weight, mu N /
        kt.
    """

    mass: FloatArray
    weight: float
    penetration: float
    largest_penetration: float
    stiffness: float
    frequency: float
    stick_offset: float


def require_ground(structure: Any, name: str) -> Structure:
    """Return a structure that stands on a ground; FormulationError for anything else."""
    if isinstance(structure, Structure) and structure.ground is not None:
        return structure
    raise FormulationError(
        "nothing to stand on",
        where=f"{name}: ground",
        given="a library that was loaded alone" if structure is None else "no ground, or a scene of bodies",
        allowed="nodes and members with a ground",
        hint="add a section [ground] to the scene",
    )


def find_edge(subject: Subject, ground: Ground) -> list[int]:
    """Return the lowest nodes of a structure that nothing else holds where they are on a line, else []."""
    if isinstance(subject, BodySystem) or subject.node_anchored.any() or ground.n_contacts <= 2:
        return []
    position = subject.node_position[ground.node]
    height = position @ ground.normal - ground.radius
    low = np.flatnonzero(height <= height.min() + LEVEL * np.ptp(position, axis=0).max())
    spread = np.linalg.svd(position[low] - position[low].mean(axis=0), compute_uv=False)
    on_line = len(low) < 3 or spread[1] <= LEVEL * spread[0]
    return ground.node[low].tolist() if on_line and len(subject.axes) == 3 else []


@np.errstate(all="ignore")  # numbers of any size are scenes
def estimate_contacts(subject: Subject, ground: Ground) -> ContactEstimates:
    """Return the rest of a structure or body system on the ground: depth, frequency, weight."""
    mass = compute_contact_mass(subject, ground.node)
    weight = compute_weight(subject, ground.normal)
    force = weight / ground.n_contacts
    slope = compute_slope(ground.stiffness, ground.exponent, force)
    offset = ground.friction * force / ground.stick_stiffness if ground.friction else 0.0
    return ContactEstimates(
        mass=mass,
        weight=weight,
        penetration=(force / ground.stiffness) ** (1 / ground.exponent),
        largest_penetration=(weight / ground.stiffness) ** (1 / ground.exponent),
        stiffness=slope,
        frequency=math.sqrt(slope / float(mass.min())) / (2 * math.pi),
        stick_offset=offset,
    )


def compute_slope(stiffness: float, exponent: float, force: float) -> float:
    """Return dN/dd [N/m] of the normal force N = k d^p at N = `force` [N]: p k^(1/p) N^(1 - 1/p)."""
    return float(exponent * np.power(stiffness, 1 / exponent) * np.power(force, 1 - 1 / exponent))


def compute_gap(subject: Subject, ground: Ground) -> FloatArray:
    """Return the distance of each contact's ball from the ground at the start, (n_contacts,) [m]."""
    gap: FloatArray = find_position(subject)[ground.node] @ ground.normal - ground.offset - ground.radius
    return gap


def find_position(subject: Subject) -> FloatArray:
    """Return the positions of all nodes at the start, (n_nodes, 3) [m]."""
    return subject.node_position if isinstance(subject, Structure) else compute_node_position(subject)


def find_movable(subject: Subject, normal: FloatArray) -> BoolArray:
    """Return which nodes can move along a normal (3,), (n_nodes,)."""
    if isinstance(subject, Structure):
        axes = [axis for axis in subject.axes if abs(normal[axis]) > ALONG]
        held: BoolArray = np.all(subject.node_anchored[:, axes], axis=1)
        return ~held
    joint_of = find_joints(subject)

    def moves(node: int) -> bool:
        while node in joint_of:
            node = joint_of[node]
        return not isinstance(subject.bodies[int(subject.node_body[node])], FixedBody)

    return np.array([moves(node) for node in range(subject.n_nodes)], dtype=np.bool_)


def find_joints(system: BodySystem) -> dict[int, int]:
    """Return the nodes at which bars are held, points of other bodies, by the node of the bar's held end."""
    bars = [(k, body) for k, body in enumerate(system.bodies) if isinstance(body, Bar) and body.held]
    return {system.bar_ends(k)["AB".index(body.held)]: body.anchor for k, body in bars}


def find_surface_nodes(subject: Subject, normal: FloatArray) -> IntArray:
    """Return the nodes that touch the ground where a scene names none, ascending.

    All that can move along the normal (3,), of free bodies the points with a radius. Of bodies with angles
    neither centres of mass, nor ends of bars that a point of another body holds: that point touches in their
    place.
    """
    chosen = find_movable(subject, normal)
    if isinstance(subject, BodySystem):
        chosen[list(find_joints(subject))] = False
        rigid = np.array([isinstance(subject.bodies[int(k)], RigidBody) for k in subject.node_body])
        chosen &= ~rigid | subject.node_local.any(axis=1)
        return np.flatnonzero(chosen)
    for free in subject.bodies:
        chosen[list(free.corner)] = False
        chosen[list(free.point)] = ~np.isnan(free.point_radius)
    return np.flatnonzero(chosen)


def find_bar_radius(subject: Subject) -> FloatArray:
    """Return the largest radius of the bars that end at each node, 0 if none has one, (n_nodes,) [m]."""
    radius = np.zeros(subject.n_nodes)
    if isinstance(subject, Structure):
        for end in (0, 1):
            np.maximum.at(radius, subject.connectivity[:, end], np.where(subject.is_bar, subject.radius, 0.0))
        return radius
    for k, body in enumerate(subject.bodies):
        if isinstance(body, Bar):
            ends = list(subject.bar_joints(k))
            radius[ends] = np.maximum(radius[ends], body.radius)
    return radius


def compute_contact_mass(subject: Subject, node: IntArray) -> FloatArray:
    """Return the mass at each contact `node` (n_contacts,) [kg], see ContactEstimates."""
    if isinstance(subject, Structure):
        lumped: FloatArray = subject.effective_mass[node]
        return lumped
    body = subject.node_body[node]
    share: FloatArray = compute_body_mass(subject)[body] / np.bincount(body, minlength=1)[body]
    return share


def compute_body_mass(system: BodySystem) -> FloatArray:
    """Return the mass of each body, 0 of fixed ones, (n_bodies,) [kg]."""
    return np.array([0.0 if isinstance(body, FixedBody) else body.mass for body in system.bodies])


def compute_weight(subject: Subject, normal: FloatArray) -> float:
    """Return the weight [N] of movable nodes along a normal (3,) into the ground, 0 or more."""
    if isinstance(subject, Structure):
        mass = float(subject.lumped_mass[find_movable(subject, normal)].sum())
    else:
        mass = float(compute_body_mass(subject).sum())
    return max(0.0, -mass * float(subject.gravity @ normal))


def find_dissipation(value: float, speed: float) -> float:
    """Return the dissipation a of Hunt and Crossley that gives a restitution at one speed.

    value: speed after the impact over speed before it, between 0 and 1; speed [m/s]: speed before the impact,
    v.

    A mass on which only the contact force k d^p (1 + a d') acts leaves with the speed w for which, with
    any k, p and mass, w/a + ln(1 - a w)/a^2 = -(v/a - ln(1 + a v)/a^2), w < 1/a. With x = a v and e = w/v
    this is e^2 h(-e x) = h(x), h(u) = (ln(1 + u) - u)/u^2, with one root x > 0. For small e, a w is near 1.
    """

    def excess(x: float) -> float:
        return value * value * _reduced_log(-value * x) - _reduced_log(x)

    largest = (1.0 - 2.0**-50) / value
    if value < 0.01 or excess(largest) >= 0.0:  # 1 - a w is below the rounding error of 1
        return largest / speed
    return find_root(excess, 0.0, largest, 0.0) / speed


def _reduced_log(u: float) -> float:
    """Return (ln(1 + u) - u) / u^2 for u > -1; -1/2 at 0."""
    if abs(u) < SERIES_RANGE:
        return float(np.polynomial.polynomial.polyval(u, SERIES))
    return (math.log1p(u) - u) / (u * u)
