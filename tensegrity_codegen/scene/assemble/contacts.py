"""Contacts of a scene: pairs of bars that may touch, and the ground of a structure or body system."""

import math
from collections.abc import Collection, Mapping

import numpy as np

from tensegrity_codegen.scene.assemble.members import spread_vectors
from tensegrity_codegen.scene.assemble.targets import normalise
from tensegrity_codegen.scene.checks.check_ground import check_contacts, check_normal
from tensegrity_codegen.scene.names import check_known, key_path
from tensegrity_codegen.scene.schema.part_schema import GroundTable, Interference
from tensegrity_codegen.structure.collision import EXPONENTS, Collision
from tensegrity_codegen.structure.contact_estimates import (
    Subject,
    compute_contact_mass,
    compute_slope,
    compute_weight,
    find_bar_radius,
    find_dissipation,
    find_surface_nodes,
)
from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    StructureError,
    name_list,
)


def find_bar_pairs(
    wanted: Interference,
    bars: Mapping[str, int],
    radius: Mapping[str, float],
    joints: Mapping[str, Collection[int]],
    where: str,
) -> tuple[tuple[int, int], ...] | None:
    """Return the chosen pairs as indices of bars, None for all of them.

    bars: index of every bar by name; radius: of every bar [m]; joints: the nodes that each bar ends at.
    """
    if wanted.pairs == "all":
        return None
    pairs: dict[frozenset[int], tuple[int, int]] = {}
    for number, names in enumerate(wanted.pairs):
        location = key_path(where, "interference", "pairs", number)
        for name in names:
            check_known(name, bars, "the name is no bar", "names of bars", location)
            if not radius[name] > 0:
                problem = "the bar has no radius, so that its distance to others is not known"
                allowed, hint = "bars with a radius", "give it a radius [m]"
                raise InvalidValueError(problem, where=location, given=name, allowed=allowed, hint=hint)
        bar_a, bar_b = names
        if set(joints[bar_a]) & set(joints[bar_b]):
            problem = "these bars share a node, so that they always touch"
            allowed, hint = "two bars that share no node", "take the pair out of the list"
            raise InvalidValueError(problem, where=location, given=list(names), allowed=allowed, hint=hint)
        pair = bars[bar_a], bars[bar_b]
        if frozenset(pair) in pairs:
            problem = "the pair of bars is listed twice"
            raise DuplicateNameError(problem, where=location, given=list(names), allowed="each pair once")
        pairs[frozenset(pair)] = pair
    return tuple(pairs.values())


def build_collision(stated: Interference, where: str) -> Collision | None:
    """Return the force between bars that touch, None if the scene states no stiffness."""
    impact = stated.restitution
    damping = {key: getattr(stated, key) for key in ("restitution", "dissipation")}
    idle = [key for key, value in damping.items() if value is not None]
    is_idle = stated.stiffness is None and bool(idle or stated.exponent != 1.0)

    def require(is_met: bool, problem: str, key: str, allowed: str) -> None:
        if not is_met:
            value, location = getattr(stated, key), key_path(where, "interference", key)
            value = value.model_dump() if key == "restitution" else value
            raise InvalidValueError(problem, where=location, given=value, allowed=allowed)

    require(stated.exponent in EXPONENTS, "not an exponent of the contact force", "exponent", "1 or 1.5")
    alternatives = "one of restitution and dissipation"
    require(len(idle) < 2, "the damping of impacts is given twice", "dissipation", alternatives)
    problem = "bars without a stiffness have no force that this could change"
    require(not is_idle, problem, idle[0] if idle else "exponent", "with stiffness [N/m]")
    if stated.stiffness is None:
        return None
    dissipation = find_dissipation(impact.value, impact.speed) if impact else stated.dissipation or 0.0
    return Collision(stated.stiffness, stated.exponent, dissipation)


# Part of a belt's speed along the normal that counts as rounding of the scene's numbers, and is removed.
MAX_NORMAL_PART = 1e-6
ROUNDING = 4 * np.finfo(float).eps


@np.errstate(all="ignore")  # a number that is not finite is refused by Ground
def build_ground(
    stated: GroundTable | None, subject: Subject, node_of: Mapping[str, int] | None, where: str
) -> Ground | None:
    """Return the ground of a structure or body system, None if the scene states none.

    node_of: index of each node by the name that the scene uses, "body.point" in scenes of bodies; None: names
    of nodes.
    """
    if stated is None:
        return None
    if node_of is None:
        node_of = {name: row for row, name in enumerate(subject.node_name)}
    table = _Table(stated, where)
    table.check_alternatives()
    normal = table.find_normal(subject.axes)
    names = {row: name for name, row in node_of.items()}
    node = table.find_contacts(subject, normal, node_of)
    check_contacts(subject, normal, stated.offset, node, names, where)
    weight = compute_weight(subject, normal)
    stiffness = table.find_stiffness(weight / len(node))
    stick_stiffness = table.find_stick_stiffness(stiffness, weight / len(node))
    mass = float(compute_contact_mass(subject, node).mean())
    critical = 2.0 * math.sqrt(stick_stiffness) * math.sqrt(mass)
    impact = stated.restitution
    dissipation = find_dissipation(impact.value, impact.speed) if impact else stated.dissipation or 0.0
    static = stated.static_friction
    velocity, radius = table.find_velocity(normal, subject.axes), table.find_radius(subject)[node]
    try:
        return Ground(
            normal=normal,
            offset=stated.offset,
            velocity=velocity,
            node=node,
            radius=radius,
            stiffness=stiffness,
            exponent=stated.exponent,
            dissipation=dissipation,
            friction=stated.friction,
            static_friction=None if static == stated.friction else static,
            stick_stiffness=stick_stiffness,
            stick_damping=critical if stated.stick_damping is None else stated.stick_damping,
        )
    except InvalidValueError as error:
        error.where = f"{where}: {error.where}"
        raise


class _Table:
    """The table [ground], value by value."""

    def __init__(self, stated: GroundTable, where: str) -> None:
        self.stated, self.where = stated, where

    def require(self, is_met: bool, problem: str, key: str, allowed: str, hint: str = "") -> None:
        """Raise InvalidValueError about one key unless a condition is met."""
        if not is_met:
            location = key_path(self.where, "ground", key)
            value = getattr(self.stated, key)
            raise InvalidValueError(problem, where=location, given=value, allowed=allowed, hint=hint)

    def check_alternatives(self) -> None:
        """Raise InvalidValueError for keys that exclude each other, lack each other or are out of range."""
        stated, static = self.stated, self.stated.static_friction
        has_stiffness, has_depth = stated.stiffness is not None, stated.penetration is not None
        damped_twice = stated.restitution is not None and stated.dissipation is not None
        turned_twice = stated.slope_deg is not None and stated.normal is not None
        low = static is not None and static < stated.friction
        need, alternatives = self.require, "one of stiffness [N/m] and penetration [m], the depth at rest"
        need(has_stiffness or has_depth, "the ground has no stiffness", "stiffness", alternatives)
        need(not (has_stiffness and has_depth), "the stiffness is given twice", "penetration", alternatives)
        alternatives = "one of restitution = { value, speed } and dissipation [s/m]"
        need(not damped_twice, "the damping of impacts is given twice", "dissipation", alternatives)
        need(not turned_twice, "the normal is given twice", "slope_deg", "one of normal and slope_deg")
        need(stated.exponent in EXPONENTS, "not an exponent of the contact force", "exponent", "1 or 1.5")
        range_text = f"at least {stated.friction:g}, the friction"
        need(not low, "the static friction is below the friction", "static_friction", range_text)
        without = bool(static) and not stated.friction
        need(not without, "static friction without friction", "static_friction", "with friction > 0")

    def find_normal(self, axes: tuple[int, ...]) -> FloatArray:
        """Return the unit vector out of the ground, (3,)."""
        stated, normal = self.stated, np.zeros(3)
        if stated.normal is None:
            angle = math.radians(stated.slope_deg or 0.0)
            is_flat = stated.slope_deg is None or len(axes) > 1
            self.require(is_flat, "a scene of one axis has no slope", "slope_deg", "scenes of two or three")
            normal[axes[0]] = math.sin(angle)
            normal[axes[-1]] = math.cos(angle)
            return normal
        keys = ("ground", "normal")
        vector: FloatArray = spread_vectors([stated.normal], axes, [keys], self.where)[0]
        check_normal(vector, axes, self.where)
        if abs(float(np.linalg.norm(vector)) - 1.0) <= ROUNDING:  # as it is written: reads back bit-equal
            return vector
        return np.array(normalise(vector, stated.normal, key_path(self.where, *keys)))

    def find_velocity(self, normal: FloatArray, axes: tuple[int, ...]) -> FloatArray:
        """Return the velocity of a belt without its rounding error along the normal, (3,) [m/s]."""
        stated, keys = self.stated.velocity, ("ground", "velocity")
        velocity: FloatArray = spread_vectors([stated], axes, [keys], self.where)[0]
        outside = [axis for axis in range(3) if axis not in axes and velocity[axis] != 0]
        if outside:
            letter = "xyz"[outside[0]]
            problem = f"a velocity along {letter}, an axis that the scene does not model"
            location, allowed = key_path(self.where, *keys), f"0 along {letter}"
            raise StructureError(problem, where=location, given=list(stated or ()), allowed=allowed)
        largest = float(np.abs(velocity).max())
        unit = velocity / largest if largest else velocity
        speed, normal_speed = float(np.linalg.norm(unit)), float(unit @ normal)
        along: FloatArray = (unit - normal_speed * normal) * largest
        shown = ", ".join(f"{along[axis]:.9g}" for axis in axes)
        is_along, allowed = abs(normal_speed) <= MAX_NORMAL_PART * speed, "a velocity along the plane"
        problem, hint = "the belt moves along the normal", f"the part along the plane: velocity = [{shown}]"
        self.require(is_along, f"{problem} of the ground", "velocity", allowed, hint)
        return along if abs(normal_speed) > ROUNDING * speed else velocity

    def find_contacts(self, subject: Subject, normal: FloatArray, node_of: Mapping[str, int]) -> IntArray:
        """Return the nodes that can touch the ground, ascending."""
        names = self.stated.contacts
        if names == "all":
            node = find_surface_nodes(subject, normal)
            self.check_bodies(subject)
            problem = "no node can move along the normal of the ground"
            self.require(node.size > 0, problem, "contacts", "nodes that can")
            return node
        of_bodies = any("." in name for name in node_of)
        allowed = '"body.point"; a bar has A and B' if of_bodies else "names of nodes"
        for number, name in enumerate(names):
            keys = ("ground", "contacts", number)
            check_known(name, node_of, "the contact is not defined", allowed, self.where, *keys)
            if name in names[:number]:
                location = key_path(self.where, *keys)
                raise DuplicateNameError("the contact is listed twice", where=location, given=name)
        return np.array(sorted(node_of[name] for name in names), dtype=np.int64)

    def check_bodies(self, subject: Subject) -> None:
        """Raise InvalidValueError for a body that has no point that could touch the ground."""
        for body in subject.bodies if isinstance(subject, Structure) else ():
            if np.isnan(body.point_radius).all():
                raise InvalidValueError(
                    'a body without a point that can touch the ground, where contacts = "all"',
                    where=key_path(self.where, "bodies", body.name, "points"),
                    given=name_list([subject.node_name[k] for k in body.point]) or "no points",
                    allowed="a point with a radius: { position = [x, y, z], radius = r }, 0 for a sharp one",
                    hint="give a radius to points of the body, or list the contacts of the ground",
                )

    def find_radius(self, subject: Subject) -> FloatArray:
        """Return the radius of the ball about each node, (n_nodes,) [m]."""
        bodies = subject.bodies if isinstance(subject, Structure) else ()
        if self.stated.radius != "bar":
            radius = np.full(subject.n_nodes, self.stated.radius, dtype=np.float64)
        else:
            radius = find_bar_radius(subject)
            allowed = "a radius [m], or bars with a radius"
            is_met = bool(radius.any()) or bool(bodies)
            self.require(is_met, "no bar has a radius", "radius", allowed)
        for body in bodies:
            stated = ~np.isnan(body.point_radius)
            radius[np.array(body.point, dtype=np.int64)[stated]] = body.point_radius[stated]
        return radius

    def find_stiffness(self, force: float) -> float:
        """Return k of N = k d^p, from the penetration where a contact carries `force` [N]."""
        if self.stated.penetration is None:
            return float(self.stated.stiffness or 0.0)
        self.need_weight(force, "penetration", "stiffness [N/m] in place of penetration")
        return float(np.float64(force) / np.float64(self.stated.penetration) ** self.stated.exponent)

    def find_stick_stiffness(self, stiffness: float, force: float) -> float:
        """Return the tangential stiffness [N/m], by default the slope of the normal force at `force` [N]."""
        if self.stated.stick_stiffness is not None:
            return self.stated.stick_stiffness
        if self.stated.friction and self.stated.exponent > 1:
            self.need_weight(force, "exponent", "stick_stiffness [N/m]")
        return compute_slope(stiffness, self.stated.exponent, force)

    def need_weight(self, force: float, key: str, hint: str) -> None:
        """Raise InvalidValueError unless a weight acts into the ground."""
        problem = "no weight acts into the ground, so that no stiffness follows from the depth at rest"
        self.require(force > 0, problem, key, "with gravity into the ground", f"give {hint}, or gravity")
