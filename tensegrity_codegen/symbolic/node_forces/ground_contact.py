"""Contact of nodes with the ground: a normal force with dissipation, and friction that really sticks.

d = offset + radius - n . x,  v = velocity of the node relative to the belt, in the plane
N = k d^p max(0, 1 + a d') where d > 0, else 0                      (Hunt and Crossley 1975)
T = kt s + ct v,  F = T min(1, mu N / |T|),  s' = (F - kt s) / ct   on the node: N n - F

The internal state s is the deflection of a bristle, a spring and a damper side by side, in series with a
slider of Coulomb friction. The contact sticks exactly where |T| <= mu N; where it slips |F| = mu N, and out
of contact s decays. Forces are continuous, so that events are kinks of them. With v = (T - kt s) / ct

F . v - kt s . s' = ct s' . s' + |F| (|T| - |F|) / ct >= 0          is lost by friction
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.arguments import SymbolicArguments
from tensegrity_codegen.symbolic.free_bodies import BodyFrame
from tensegrity_codegen.symbolic.geometry import Scalar, Vector, cross, dot
from tensegrity_codegen.symbolic.node_forces.node_force import NodeForce, NormalForce
from tensegrity_codegen.system.arrays import FloatArray

ContactLaw = Any  # the fields of a Ground, numbers or symbols


def build_ground_contact(structure: Structure, arguments: SymbolicArguments) -> "GroundContact | None":
    """Return the contacts of a structure with its ground, None if it has no ground."""
    return None if structure.ground is None else GroundContact(structure, structure.ground, arguments)


class GroundContact(NodeForce):
    """All contacts of a structure with the ground."""

    def __init__(self, structure: Structure, ground: Ground, arguments: SymbolicArguments) -> None:
        self.ground = ground
        self.names = structure.contact_name
        self.contacts: list[Contact] = []
        self.rolling: dict[int, tuple[BodyFrame, Vector]] = {}  # contact -> body, arm from node to contact
        frames = {node: frame for frame in arguments.body_frames for node in frame.body.point}
        for k, (node, radius) in enumerate(zip(ground.node.tolist(), ground.radius.tolist(), strict=True)):
            at, rate = arguments.position[node], arguments.velocity[node]
            tangents = range(1, count_bristles(structure) + 1)
            if ground.stick_point is None:
                bristle = [arguments.internal[f"{self.names[k]}_stick{i}"] for i in tangents]
            else:
                basis = ground.tangents(structure.axes)[: len(tangents), list(structure.axes)]
                stuck = zip(basis, ground.stick_point[k].tolist(), strict=True)
                place = at
                if ground.stick_arm is not None and node in frames:
                    body = frames[node].body
                    local = body.point_local[body.point.index(node)] + ground.stick_arm[k]
                    place = frames[node].place(local)[0]
                bristle = [_along(tangent, place) - stick for tangent, stick in stuck]
            slips = arguments.internal.get(f"{self.names[k]}_slips")
            law = put_numbers(ground, arguments.ground)
            slip = rate
            if radius and node in frames:  # the surface of a ball moves by the spin of its body
                frame = frames[node]
                arm = frame.components([ca.SX(-radius * n) for n in ground.normal])
                self.rolling[k] = frame, arm
                slip = [v + w for v, w in zip(rate, frame.rate_of(arm), strict=True)]
            contact = build_contact(ground, law, structure.axes, (at, rate, slip), radius, bristle, slips)
            self.contacts.append(contact)

    def forces(self) -> Mapping[int, Vector]:
        """Return node -> force of the ground on it [N]."""
        return self._collect(lambda contact: contact.force, lambda contact: contact.friction_force)

    def static_forces(self) -> Mapping[int, Vector]:
        """Return node -> force of the ground on it at rest, k d^p n - kt s [N]."""
        return self._collect(Contact.static_force, Contact.static_friction_force)

    def body_moments(self) -> Mapping[int, list[Vector]]:
        """Return first corner of a body -> moments of friction about the centres of its balls [N m]."""
        moments: dict[int, list[Vector]] = {}
        for k, (frame, _) in self.rolling.items() if self.ground.friction else ():
            arm = [-self.contacts[k].radius * float(n) for n in self.ground.normal]
            moment = cross(arm, self.contacts[k].friction_force)
            moments.setdefault(frame.body.corner[0], []).append(moment)
        return moments

    def _collect(
        self, force: Callable[["Contact"], Vector], friction: Callable[["Contact"], Vector]
    ) -> dict[int, Vector]:
        """Return node -> force; friction at the surface of a ball turns its body by forces on corners."""
        forces = dict(zip(self.ground.node.tolist(), map(force, self.contacts), strict=True))
        for k, (frame, arm) in self.rolling.items() if self.ground.friction else ():
            for node, part in frame.couple(arm, friction(self.contacts[k])).items():
                forces[node] = [x + y for x, y in zip(forces.get(node, [0.0] * 3), part, strict=True)]
        return forces

    def static_stiffness(self) -> Mapping[int, ca.SX]:
        """Return node -> p k d^(p-1) n n^T where the ground presses [N/m]."""
        nodes = zip(self.ground.node.tolist(), self.contacts, strict=True)
        return {node: c.normal_force.static_stiffness() * np.outer(c.normal, c.normal) for node, c in nodes}

    def internal_rates(self) -> Mapping[str, Scalar]:
        """Return the rates of the bristles [m/s]; whether one slips changes at events."""
        contacts = zip(self.names, self.contacts, strict=True)
        return {
            f"{name}_stick{i}": rate
            for name, contact in contacts
            for i, rate in enumerate(contact.bristle_rate, start=1)
        }

    def stored_energy(self) -> Scalar:
        """Return the energy of compressed ground and deflected bristles [J]."""
        return sum((contact.energy() for contact in self.contacts), ca.SX(0.0))

    def powers(self) -> Mapping[str, Scalar]:
        """Return minus the losses of impacts and friction, and the power of a belt [W]."""
        powers = [contact.powers() for contact in self.contacts]
        return {name: sum((power[name] for power in powers), ca.SX(0.0)) for name in powers[0]}

    def builders(self) -> dict[str, Callable[[], ca.SX]]:
        """Return the builders of forces, penetrations and margins."""
        contacts = self.contacts
        quantities: dict[str, Callable[[], ca.SX]] = {
            "penetration": lambda: ca.vertcat(*[c.depth for c in contacts]),
            "contact_force": lambda: ca.horzcat(*[ca.vertcat(*c.force) for c in contacts]),
            "contact_margin": lambda: ca.vertcat(*[c.contact_margin() for c in contacts]),
        }
        if self.contacts and self.contacts[0].bristle:
            quantities["stick_margin"] = lambda: ca.vertcat(*[c.stick_margin() for c in contacts])
        return quantities


def count_bristles(structure: Structure) -> int:
    """Return the number of bristles of each contact: one a tangent, none without friction."""
    ground = structure.ground
    return len(structure.axes) - 1 if ground is not None and ground.friction else 0


def put_numbers(ground: Ground, changed: Mapping[str, Scalar]) -> "ContactLaw":
    """Return the numbers of a ground, some of them replaced by symbols."""
    stated = {field.name: getattr(ground, field.name) for field in fields(ground)}
    return SimpleNamespace(**stated | dict(changed))


def build_contact(
    ground: Ground,
    law: ContactLaw,
    axes: tuple[int, ...],
    motion: tuple[Vector, Vector, Vector],
    radius: Scalar,
    bristle: Vector,
    slips: Scalar | None = None,
) -> "Contact":
    """Return one contact; law: see put_numbers; motion: position and velocity of its node, and that of slip.

    These are over the modelled axes; bristle: one a tangent.

    slips: 1 if it slips and 0 if it sticks, with a static friction.
    """
    chosen = list(axes)
    basis = ground.tangents(axes)[: len(bristle), chosen]
    normal, belt = ground.normal[chosen], ground.velocity[chosen]
    return Contact(law, normal, basis, belt, *motion, radius, bristle, slips)


@dataclass
class Contact:
    """One node on the ground; normal, basis, belt: over the modelled axes; bristle: its deflection s."""

    ground: ContactLaw
    normal: FloatArray
    basis: FloatArray
    belt: FloatArray
    position: Vector
    velocity: Vector
    surface_velocity: Vector
    radius: Scalar
    bristle: Vector
    slips: Scalar | None = None

    @cached_property
    def depth(self) -> Scalar:
        """Penetration d [m], negative above the ground."""
        return (self.ground.offset + self.radius) - _along(self.normal, self.position)

    @cached_property
    def depth_rate(self) -> Scalar:
        """Rate of penetration d' [m/s]."""
        return -_along(self.normal, self.velocity)

    @cached_property
    def normal_force(self) -> NormalForce:
        """N [N], with its energy, power and margin."""
        return NormalForce(self.ground, self.depth, self.depth_rate)

    @cached_property
    def slip_velocity(self) -> Vector:
        """Velocity v relative to the belt, along the basis of the plane [m/s]."""
        belt = self.basis @ self.belt
        speeds = zip(self.basis, belt, strict=True)
        return [_along(t, self.surface_velocity) - float(b) for t, b in speeds]

    @cached_property
    def trial_force(self) -> Vector:
        """T: the friction, were it not limited [N]."""
        kt, ct = self.ground.stick_stiffness, self.ground.stick_damping
        return [kt * s + ct * v for s, v in zip(self.bristle, self.slip_velocity, strict=True)]

    @cached_property
    def trial_size(self) -> Scalar:
        """|T| [N]."""
        trial = self.trial_force
        return ca.fabs(trial[0]) if len(trial) == 1 else ca.sqrt(dot(trial, trial))

    @cached_property
    def friction_limit(self) -> Scalar:
        """Largest friction mu N [N]."""
        friction: Scalar = self.ground.friction
        if self.slips is not None:
            friction = ca.if_else(self.slips > 0.5, friction, self.ground.static_friction)
        return friction * self.normal_force.force

    @cached_property
    def friction(self) -> Vector:
        """F along the basis [N]; |T| divides only if the contact slips, and is not zero.

        An open contact whose T is zero has the derivatives of any open one: its factor is 0, as its limit.
        """
        if not self.bristle:
            return []
        slips = self.trial_size > self.friction_limit
        ratio = self.friction_limit / ca.if_else(slips, self.trial_size, 1)
        factor = ca.if_else(slips, ratio, self.friction_limit > 0)
        return [factor * t for t in self.trial_force]

    @cached_property
    def bristle_rate(self) -> Vector:
        """s' [m/s]."""
        kt, ct = self.ground.stick_stiffness, self.ground.stick_damping
        return [(f - kt * s) / ct for f, s in zip(self.friction, self.bristle, strict=True)]

    @cached_property
    def force(self) -> Vector:
        """Force on the node N n - F, over the modelled axes [N]."""
        return self._pull([self.normal_force.force * float(n) for n in self.normal], self.friction)

    @property
    def friction_force(self) -> Vector:
        """Friction on the node -F, over the modelled axes [N]."""
        return self._pull([ca.SX(0.0)] * len(self.normal), self.friction)

    def _pull(self, result: Vector, friction: Vector) -> Vector:
        """Return a force less the friction along the basis."""
        for f, tangent in zip(friction, self.basis, strict=True):
            result = [r - f * float(t) for r, t in zip(result, tangent, strict=True)]
        return result

    def static_force(self) -> Vector:
        """Force on the node at rest, its bristle below the limit, over the modelled axes [N]."""
        normal = [self.normal_force.elastic_force * float(n) for n in self.normal]
        return self._pull(normal, [self.ground.stick_stiffness * s for s in self.bristle])

    def static_friction_force(self) -> Vector:
        """Return the part of the force at rest along the plane, over the modelled axes [N]."""
        friction = [self.ground.stick_stiffness * s for s in self.bristle]
        return self._pull([ca.SX(0.0)] * len(self.normal), friction)

    def energy(self) -> Scalar:
        """Return the energy of compressed ground and deflected bristle [J]."""
        bristle = sum(self.ground.stick_stiffness / 2.0 * s * s for s in self.bristle)
        return self.normal_force.energy() + bristle

    def powers(self) -> Mapping[str, Scalar]:
        """Return minus the losses of impact and friction, and the power of a belt [W]."""
        friction = belt = ca.SX(0.0)
        speeds, bristles = self.basis @ self.belt, zip(self.bristle, self.bristle_rate, strict=True)
        for speed, (s, rate), f, v in zip(speeds, bristles, self.friction, self.slip_velocity, strict=True):
            friction = friction + self.ground.stick_stiffness * s * rate - f * v
            belt = belt - f * float(speed)
        return {"impact": self.normal_force.power(), "friction": friction, "belt": belt}

    def contact_margin(self) -> Scalar:
        """Return a length that is positive where the ground presses."""
        return self.normal_force.margin()

    def stick_margin(self) -> Scalar:
        """Return (mu N - |T|) / kt [m], -1 out of contact: there nothing sticks."""
        margin = (self.friction_limit - self.trial_size) / self.ground.stick_stiffness
        return ca.if_else(self.normal_force.force > 0, margin, -1)


def _along(direction: FloatArray, vector: Vector) -> Scalar:
    """Return the component of a vector along a constant direction."""
    terms = [float(n) * x for n, x in zip(direction, vector, strict=True) if n != 0.0]
    return sum(terms, ca.SX(0.0)) if np.any(direction) else ca.SX(0.0)
