"""Loads, joint friction and actuated inputs on bodies, from the scene's tables."""

from collections.abc import Mapping, Sequence

import numpy as np

from tensegrity_codegen.scene.assemble.bodies import BuiltBodies
from tensegrity_codegen.scene.assemble.targets import Targets, find_gain, normalise
from tensegrity_codegen.scene.names import check_known, key_path
from tensegrity_codegen.scene.schema.body_schema import (
    BodyTorque,
    JointFrictionTable,
    PointForceInput,
    PointLoad,
    TorqueInput,
)
from tensegrity_codegen.scene.schema.part_schema import RestLengthInput, TemperatureInput
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.structure.bodies import (
    BodyInput,
    BodyLoad,
    BodySystem,
    FixedBody,
    Frame,
    JointFriction,
    RigidBody,
    Vector3,
)
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError


class BodyFinder:
    """Finds bodies and points by name, and says where a name is wrong."""

    def __init__(self, scene: Scene, built: BuiltBodies, where: str) -> None:
        self.built, self.where = built, where
        self._body = {name: row for row, name in enumerate(scene.bodies)}

    def body(self, name: str, *place: str | int) -> int:
        """Return the index of a body."""
        return self._look(self._body, name, "the body is not defined", "names of bodies", place)

    def point(self, name: str, *place: str | int) -> int:
        """Return the node of "body.point"."""
        problem = "the point does not exist"
        return self._look(self.built.node, name, problem, '"body.point"; a bar has A and B', place)

    def frame(self, frame: Frame, body: int, *place: str | int) -> Frame:
        """Return the frame; of the bodies only rigid ones have axes of their own."""
        if frame == "body" and not isinstance(self.built.bodies[body], RigidBody):
            problem, location = "only a rigid body has axes of its own", key_path(self.where, *place)
            hint = "remove the key"
            raise InvalidValueError(problem, where=location, given=frame, allowed='"inertial"', hint=hint)
        return frame

    def moving(self, body: int, *place: str | int) -> int:
        """Return the body, refused if it is fixed."""
        if isinstance(self.built.bodies[body], FixedBody):
            raise InvalidValueError(
                "a torque on a fixed body moves nothing",
                where=key_path(self.where, *place),
                given=self.built.bodies[body].name,
                allowed="bodies of kind bar or rigid",
            )
        return body

    def _look(
        self, table: Mapping[str, int], name: str, problem: str, allowed: str, place: tuple[str | int, ...]
    ) -> int:
        check_known(name, table, problem, allowed, self.where, *place)
        return table[name]


def build_body_loads(scene: Scene, find: BodyFinder) -> tuple[FloatArray, tuple[BodyLoad, ...]]:
    """Return the forces of constant direction (n_nodes, 3) [N], and the loads that have no potential."""
    total, turning = np.zeros((len(find.built.node_name), 3)), []
    for number, item in enumerate(scene.loads):
        place = ("loads", number)
        if isinstance(item, PointLoad):
            node = find.point(item.point, *place, "point")
            force = three_numbers(item.force, find.where, *place, "force")
            frame = find.frame(item.frame, int(find.built.node_body[node]), *place, "frame")
            if frame == "inertial":
                total[node] += force
            else:
                turning.append(BodyLoad("force", node, force, frame))
        elif isinstance(item, BodyTorque):
            body = find.moving(find.body(item.body, *place, "body"), *place, "body")
            frame = find.frame(item.frame, body, *place, "frame")
            turning.append(
                BodyLoad("torque", body, three_numbers(item.torque, find.where, *place, "torque"), frame)
            )
        else:
            problem, location = "a scene of bodies has no nodes", key_path(find.where, *place, "node")
            allowed, hint = "point and force, or body and torque", 'point = "body.point"'
            raise InvalidValueError(problem, where=location, given=item.node, allowed=allowed, hint=hint)
    return total, tuple(turning)


def build_friction(item: JointFrictionTable, number: int, find: BodyFinder) -> JointFriction:
    """Return the friction of one joint; InvalidValueError unless its bodies can turn against each other."""
    a, b = (find.body(name, "joint_friction", number, "bodies") for name in item.bodies)
    if a == b or all(isinstance(find.built.bodies[k], FixedBody) for k in (a, b)):
        problem = "a joint is between two bodies that turn against each other"
        location = key_path(find.where, "joint_friction", number, "bodies")
        allowed = "two different bodies, at most one of them fixed"
        raise InvalidValueError(problem, where=location, given=list(item.bodies), allowed=allowed)
    return JointFriction((a, b), item.coefficient)


def build_body_inputs(
    scene: Scene, targets: Targets, find: BodyFinder, system: BodySystem
) -> tuple[BodyInput, ...]:
    """Return the actuated inputs.

    Raises DuplicateNameError, UnknownNameError or InvalidValueError, with file and key.
    """
    built: list[BodyInput] = []
    for number, item in enumerate(scene.inputs):
        place: tuple[str | int, ...] = ("inputs", number)
        if any(item.name == other.name for other in built):
            problem, location = "two inputs under one name", key_path(find.where, *place, "name")
            allowed, hint = "each name once", "rename one of the two"
            raise DuplicateNameError(problem, where=location, given=item.name, allowed=allowed, hint=hint)
        if isinstance(item, RestLengthInput | TemperatureInput):
            members = targets.find_members(item.members, *place, "members")
            expanded = system.rest_length, system.thermal_expansion
            gain = find_gain(item, members, targets, place, *expanded)
            built.append(BodyInput(item.name, item.kind, members, gain=gain))
        elif isinstance(item, PointForceInput):
            nodes = [find.point(name, *place, "points") for name in item.points]
            frames = [find.frame(item.frame, int(find.built.node_body[n]), *place, "frame") for n in nodes]
            unit = _unit(item.direction, find.where, *place, "direction")
            built.append(BodyInput(item.name, "force", tuple(dict.fromkeys(nodes)), unit, frames[0]))
        elif isinstance(item, TorqueInput):
            bodies = [find.moving(find.body(n, *place, "bodies"), *place, "bodies") for n in item.bodies]
            frames = [find.frame(item.frame, body, *place, "frame") for body in bodies]
            unit = _unit(item.direction, find.where, *place, "direction")
            built.append(BodyInput(item.name, "torque", tuple(dict.fromkeys(bodies)), unit, frames[0]))
        else:
            problem, location = "a scene of bodies has no nodes", key_path(find.where, *place, "kind")
            allowed = "rest_length, temperature, point_force, torque"
            hint = 'kind = "point_force" with points = ["body.point"]'
            raise InvalidValueError(problem, where=location, given=item.kind, allowed=allowed, hint=hint)
    return tuple(built)


def three_numbers(vector: Sequence[float], where: str, *place: str | int) -> Vector3:
    """Return a vector of three numbers; InvalidValueError for another size."""
    if len(vector) != 3:
        problem, location = "a vector of the wrong size", key_path(where, *place)
        raise InvalidValueError(problem, where=location, given=list(vector), allowed="3 numbers")
    x, y, z = (float(part) for part in vector)
    return (x, y, z)


def _unit(direction: Sequence[float], where: str, *place: str | int) -> Vector3:
    vector = np.array(three_numbers(direction, where, *place))
    return normalise(vector, direction, key_path(where, *place))
