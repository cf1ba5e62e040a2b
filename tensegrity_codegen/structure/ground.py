"""The ground: a plane that nodes can stand on, slide on and bounce on."""

from dataclasses import dataclass, fields, replace

import numpy as np

from tensegrity_codegen.structure.frozen import freeze_fields
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.errors import InvalidValueError

# Internal states [J], where they are asked for: what has changed the energy of a motion.
ENERGY_STATES = ("friction_work", "impact_work", "damping_work", "belt_work")
# Numbers that can be run-time parameters; their places are those of the request's parameter "ground".
CHANGEABLE = ("stiffness", "dissipation", "friction", "stick_stiffness", "stick_damping")


@dataclass(frozen=True, eq=False)
class Ground:
    """A plane that nodes (balls of a radius around them) touch, with friction.

    normal (3,): unit vector out of the ground.
    offset [m]: ``normal . x`` of the points x of the plane.
    velocity (3,) [m/s]: velocity of a belt, along the plane.
    node (n_contacts,): indices of the nodes that can touch the ground, ascending.
    radius (n_contacts,) [m]: radius of the ball about each of these.
    stiffness [N/m]: contact stiffness k; [N/m^1.5] with exponent 1.5.
    exponent: power p of the penetration, 1.0 or 1.5.
    dissipation [s/m]: factor a of the rate of penetration (Hunt and Crossley 1975).
    friction: coefficient of friction mu; 0 for no tangential force and no internal state.
    static_friction: coefficient up to which a contact sticks, at least `friction`; None: equal to `friction`.
    stick_stiffness [N/m]: tangential stiffness kt of a contact that sticks.
    stick_damping [N s/m]: tangential damping ct of a contact that sticks.
    balances_energy: whether motions integrate the work of friction, impacts, damping and a belt, as internal
        states of their own: their sum is the change of the total energy.
    stick_point (n_contacts, n_tangents) [m]: where along the tangents each contact sticks: bristles reach
        from there to their nodes, and are no internal states. None: they are.
    stick_arm (n_contacts, 3) [m]: from the centres of balls on bodies to what sticks, in the bodies' frames.

    A ball at x with penetration ``d = offset + radius - normal . x`` feels, with its velocity v relative to
    the belt in the plane and its internal state s, the deflection of a bristle::

        N = k d^p max(0, 1 + a d')  where d > 0, else 0        along the normal
        T = kt s + ct v,  F = T min(1, mu N / |T|)             -F in the plane
        s' = (F - kt s) / ct

    With a static friction mu is `static_friction` from when |T| falls to friction N until |T| exceeds
    static_friction N: where the contact slips is a state of its own, and F jumps when it begins.
    """

    normal: FloatArray
    offset: float
    velocity: FloatArray
    node: IntArray
    radius: FloatArray
    stiffness: float
    exponent: float
    dissipation: float
    friction: float
    static_friction: float | None
    stick_stiffness: float
    stick_damping: float
    balances_energy: bool = False
    stick_point: FloatArray | None = None
    stick_arm: FloatArray | None = None

    def __post_init__(self) -> None:
        freeze_fields(self)
        numbers = [field.name for field in fields(self) if getattr(self, field.name) is not None]
        for name in numbers:
            self._require(name, bool(np.isfinite(getattr(self, name)).all()), "finite numbers")
        positive = ["stiffness"] + (["stick_stiffness", "stick_damping"] if self.friction else [])
        for name in positive:
            self._require(name, getattr(self, name) > 0, "a positive number")
        self._require("friction", self.friction >= 0, "a number of 0 or more")
        self._require("dissipation", self.dissipation >= 0, "a number of 0 or more")
        self._require("exponent", self.exponent in (1.0, 1.5), "1 or 1.5")
        if self.static_friction is not None:
            self._require("static_friction", self.static_friction >= self.friction, "friction or more")
        length = float(np.linalg.norm(self.normal))
        self._require("normal", self.normal.shape == (3,) and abs(length - 1) < 1e-12, "a unit vector, (3,)")
        along = abs(float(self.velocity @ self.normal)) <= 1e-12 * float(np.linalg.norm(self.velocity))
        self._require("velocity", along, "a velocity along the plane")
        ascending = self.node.size > 0 and bool((np.diff(self.node) > 0).all())
        self._require("node", ascending, "ascending indices of one or more nodes")
        self._require("radius", self.radius.shape == self.node.shape, "one radius a node")
        self._require("radius", bool((self.radius >= 0).all()), "numbers of 0 or more")

    def _require(self, name: str, is_met: bool, allowed: str) -> None:
        if not is_met:
            problem, location = "invalid ground", f"ground.{name}"
            raise InvalidValueError(problem, where=location, given=repr(getattr(self, name)), allowed=allowed)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Ground) and all(
            np.array_equal(getattr(self, field.name), getattr(other, field.name)) for field in fields(self)
        )

    def __hash__(self) -> int:
        return hash((self.normal.tobytes(), self.offset, self.node.tobytes(), self.stiffness, self.friction))

    @property
    def n_contacts(self) -> int:
        """Number of nodes that can touch the ground."""
        return len(self.node)

    @property
    def has_static_friction(self) -> bool:
        """Whether a contact sticks up to a larger friction than that with which it slips."""
        return self.static_friction is not None and self.static_friction > self.friction

    def stiffen(self, factor: float) -> "Ground":
        """Return the ground with all stiffnesses times a factor, and the same damping ratio along it."""
        return replace(
            self,
            stiffness=factor * self.stiffness,
            stick_stiffness=factor * self.stick_stiffness,
            stick_damping=factor**0.5 * self.stick_damping,
        )

    def compute_depth(self, position: FloatArray) -> FloatArray:
        """Return the penetrations (n_contacts,) [m] at positions of all nodes (n_nodes, 3)."""
        depth: FloatArray = self.offset + self.radius - position[self.node] @ self.normal
        return depth

    def tangents(self, axes: tuple[int, ...]) -> FloatArray:
        """Return an orthonormal basis of the plane within the modelled axes.

        axes: modelled axes, a subset of (0, 1, 2); the normal lies in them. Returns (len(axes) - 1, 3): unit
        vectors along the plane. They are the modelled axes without the one closest to the normal, turned with
        the normal from that axis (Householder 1958), so that they depend on the normal continuously. Raises
        InvalidValueError for a normal that has a component outside of the modelled axes.
        """
        outside = [axis for axis in range(3) if axis not in axes]
        if np.abs(self.normal[outside]).max(initial=0.0) > 1e-12:
            problem = "the ground's normal leaves the axes that the scene models"
            allowed = "a vector within the axes " + ", ".join("xyz"[axis] for axis in axes)
            value = repr(self.normal.tolist())
            raise InvalidValueError(problem, where="ground.normal", given=value, allowed=allowed)
        main = int(np.argmax(np.abs(self.normal)))
        # The reflection that swaps the main axis and minus the normal on its side; its other columns lie in
        # the plane.
        mirror = self.normal.copy()
        mirror[main] += np.copysign(1.0, self.normal[main])
        reflection = np.eye(3) - 2.0 * np.outer(mirror, mirror) / float(mirror @ mirror)
        tangents: FloatArray = reflection[[axis for axis in axes if axis != main]]
        return tangents
