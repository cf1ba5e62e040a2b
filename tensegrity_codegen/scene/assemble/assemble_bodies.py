"""From a Scene of bodies to a BodySystem and a ModelRequest: references resolved, all checked."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np

from tensegrity_codegen.scene.assemble.assemble import build_request
from tensegrity_codegen.scene.assemble.bodies import BuiltBodies, build_bodies_of_scene
from tensegrity_codegen.scene.assemble.contacts import build_ground, find_bar_pairs
from tensegrity_codegen.scene.assemble.control import build_actuators, build_limits, build_sensors
from tensegrity_codegen.scene.assemble.members import build_member_arrays
from tensegrity_codegen.scene.assemble.targets import (
    Targets,
    build_parameters,
    check_new_name,
    find_gain,
    normalise,
)
from tensegrity_codegen.scene.checks.check_members import check_laws
from tensegrity_codegen.scene.names import check_known, key_path
from tensegrity_codegen.scene.refuse import refuse
from tensegrity_codegen.scene.schema.body_schema import (
    BodyTorque,
    JointFrictionTable,
    PointForceInput,
    PointLoad,
    Tendon,
    TorqueInput,
)
from tensegrity_codegen.scene.schema.part_schema import Member, MemberClass, RestLengthInput, TemperatureInput
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.structure.bodies import (
    Bar,
    BodyInput,
    BodyLoad,
    BodySystem,
    FixedBody,
    Frame,
    JointFriction,
    RigidBody,
    Vector3,
)
from tensegrity_codegen.structure.kinematics import compute_node_position
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError, SceneError, StructureError
from tensegrity_codegen.tables.formulations import FORMULATIONS
from tensegrity_codegen.tables.request import ModelRequest, complete_options


class BodyFinder:
    """Finds bodies and points by name; errors name file and key."""

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
            problem, location = "a torque on a fixed body moves nothing", key_path(self.where, *place)
            allowed = "bodies of kind bar or rigid"
            value = self.built.bodies[body].name
            raise InvalidValueError(problem, where=location, given=value, allowed=allowed)
        return body

    def _look(
        self, table: Mapping[str, int], name: str, problem: str, allowed: str, place: tuple[str | int, ...]
    ) -> int:
        check_known(name, table, problem, allowed, self.where, *place)
        return table[name]


def build_body_loads(scene: Scene, find: BodyFinder) -> tuple[FloatArray, tuple[BodyLoad, ...]]:
    """Return the forces of constant direction (n_nodes, 3) [N], and the loads that have no potential."""
    total, turning = np.zeros((len(find.built.node_name), 3)), []
    for number, load in enumerate(scene.loads):
        keys = ("loads", number)
        if isinstance(load, PointLoad):
            node = find.point(load.point, *keys, "point")
            force = three_numbers(load.force, find.where, *keys, "force")
            frame = find.frame(load.frame, int(find.built.node_body[node]), *keys, "frame")
            if frame == "inertial":
                total[node] += force
            else:
                turning.append(BodyLoad("force", node, force, frame))
        elif isinstance(load, BodyTorque):
            body = find.moving(find.body(load.body, *keys, "body"), *keys, "body")
            frame = find.frame(load.frame, body, *keys, "frame")
            turning.append(
                BodyLoad("torque", body, three_numbers(load.torque, find.where, *keys, "torque"), frame)
            )
        else:
            problem, location = "a scene of bodies has no nodes", key_path(find.where, *keys, "node")
            allowed, hint = "point and force, or body and torque", 'point = "body.point"'
            raise InvalidValueError(problem, where=location, given=load.node, allowed=allowed, hint=hint)
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
    """Return the actuated inputs."""
    built: list[BodyInput] = []
    for number, entry in enumerate(scene.inputs):
        keys: tuple[str | int, ...] = ("inputs", number)
        check_new_name(entry.name, built, "inputs", key_path(find.where, *keys, "name"))
        if isinstance(entry, RestLengthInput | TemperatureInput):
            members = targets.find_members(entry.members, *keys, "members")
            expanded = system.rest_length, system.thermal_expansion
            gain = find_gain(entry, members, targets, keys, *expanded)
            built.append(BodyInput(entry.name, entry.kind, members, gain=gain))
        elif isinstance(entry, PointForceInput):
            nodes = [find.point(name, *keys, "points") for name in entry.points]
            frames = [find.frame(entry.frame, int(find.built.node_body[n]), *keys, "frame") for n in nodes]
            unit = _unit(entry.direction, find.where, *keys, "direction")
            built.append(BodyInput(entry.name, "force", tuple(dict.fromkeys(nodes)), unit, frames[0]))
        elif isinstance(entry, TorqueInput):
            bodies = [find.moving(find.body(n, *keys, "bodies"), *keys, "bodies") for n in entry.bodies]
            frames = [find.frame(entry.frame, body, *keys, "frame") for body in bodies]
            unit = _unit(entry.direction, find.where, *keys, "direction")
            built.append(BodyInput(entry.name, "torque", tuple(dict.fromkeys(bodies)), unit, frames[0]))
        else:
            problem, location = "a scene of bodies has no nodes", key_path(find.where, *keys, "kind")
            allowed = "rest_length, temperature, point_force, torque"
            hint = 'kind = "point_force" with points = ["body.point"]'
            raise InvalidValueError(problem, where=location, given=entry.kind, allowed=allowed, hint=hint)
    return tuple(built)


def three_numbers(vector: Sequence[float], where: str, *place: str | int) -> Vector3:
    """Return a vector of three numbers; InvalidValueError for another size."""
    if len(vector) != 3:
        problem, location = "a vector of the wrong size", key_path(where, *place)
        raise InvalidValueError(problem, where=location, given=list(vector), allowed="3 numbers")
    x, y, z = (float(number) for number in vector)
    return (x, y, z)


def _unit(direction: Sequence[float], where: str, *place: str | int) -> Vector3:
    vector = np.array(three_numbers(direction, where, *place))
    return normalise(vector, direction, key_path(where, *place))


# Quantities of a scene of bodies that names none.
BODIES = next(item.name for item in FORMULATIONS.values() if item.of_bodies)
DEFAULT_QUANTITIES = ("member_tension", "acceleration", "total_energy", "chart_margin")


def assemble_bodies(scene: Scene, where: str = "scene") -> tuple[BodySystem, ModelRequest]:
    """Return the body system and the request of `scene`; `where` names the source in errors.

    Raises UnknownNameError, UnknownKeyError, DuplicateNameError, InvalidValueError or StructureError, with
    file and key.
    """
    _check_kind(scene, where)
    if scene.interference.stiffness is not None:
        problem = "bars of a scene of bodies have no force where they touch"
        location, allowed = key_path(where, "interference", "stiffness"), "scenes of nodes and members"
        hint = "remove the key: contacts are then detected"
        value = scene.interference.stiffness
        raise InvalidValueError(problem, where=location, given=value, allowed=allowed, hint=hint)
    built = build_bodies_of_scene(scene.bodies, where)
    if not built.coordinate.size:
        location, allowed = key_path(where, "bodies"), "at least one body of kind bar or rigid"
        names = ", ".join(scene.bodies)
        raise StructureError("nothing can move", where=location, given=names, allowed=allowed, hint="add one")
    if not scene.tendons:
        problem, allowed = "there is no tendon", "at least one tendon between two points of bodies"
        hint = "it may be slack: a rest_length longer than any length that it reaches"
        raise StructureError(problem, where=key_path(where, "tendons"), allowed=allowed, hint=hint)
    system = BodySystem(
        name=scene.name,
        bodies=built.bodies,
        coordinate=built.coordinate,
        velocity=built.velocity,
        gravity=np.array(
            three_numbers(scene.gravity, where, "gravity") if scene.gravity else (0.0, 0.0, 0.0)
        ),
        node_name=built.node_name,
        node_body=built.node_body,
        node_local=built.node_local,
        node_load=np.zeros((len(built.node_name), 3)),
        member_name=(),
        member_class=(),
        connectivity=np.zeros((0, 2), dtype=np.int64),
        tension_only=np.zeros(0, dtype=np.bool_),
        rest_length=np.zeros(0),
        spring_constant=np.zeros(0),
        axial_stiffness=np.zeros(0),
        damping=np.zeros(0),
        radius=np.zeros(0),
    )
    system = _with_tendons(system, scene.classes, scene.tendons, built, where)
    targets = Targets(
        system.node_name, system.member_name, system.member_class, scene.classes, scene.groups, where
    )
    find = BodyFinder(scene, built, where)
    load, turning = build_body_loads(scene, find)
    inputs = build_body_inputs(scene, targets, find, system)
    rigid = np.zeros(system.n_members, dtype=np.bool_)
    actuators = build_actuators(scene.actuators, [entry.name for entry in inputs], targets, rigid)
    system = system.with_changes(
        groups=targets.groups,
        node_load=load,
        loads=turning,
        friction=tuple(build_friction(entry, k, find) for k, entry in enumerate(scene.joint_friction)),
        inputs=(*inputs, *(BodyInput(entry.name, "rest_length", entry.members) for entry in actuators)),
        actuators=actuators,
        sensors=build_sensors(scene.sensors, targets, find.point),
        interference=_watch_bars(scene, system, where),
    )
    system = system.with_changes(
        limits=build_limits(scene.limits, system, scene.classes, where),
        ground=build_ground(scene.ground, system, built.node, where),
    )
    return system, _request(scene, system, targets)


def _watch_bars(scene: Scene, system: BodySystem, where: str) -> tuple[tuple[int, int], ...] | None:
    """Return the bodies whose distance the scene wants watched, None for all of them."""
    bars = {body.name: k for k, body in enumerate(system.bodies) if isinstance(body, Bar)}
    radius = {body.name: body.radius for body in system.bodies if isinstance(body, Bar)}
    joints = {name: system.bar_joints(k) for name, k in bars.items()}
    return find_bar_pairs(scene.interference, bars, radius, joints, where)


def _check_kind(scene: Scene, where: str) -> None:
    """Raise InvalidValueError or UnknownKeyError for keys of scenes of nodes."""
    foreign = {
        "nodes": bool(scene.nodes),
        "members": bool(scene.members),
        "shape": scene.shape is not None,
        "axes": scene.axes != "xyz",
    }
    for key, is_there in foreign.items():
        if is_there:
            problem, location = "a scene of bodies with angles has no such key", key_path(where, key)
            allowed = "bodies and tendons, in all three axes"
            hint = (
                "a fixed point is a body of kind fixed, a cable is a tendon; beside nodes and members stand "
                'bodies of kind rigid alone, without tendons and without formulation = "bodies"'
            )
            raise InvalidValueError(problem, where=location, given=key, allowed=allowed, hint=hint)
    if "formulation" in scene.model.model_fields_set and scene.model.formulation != BODIES:
        problem = f"bodies are modelled by the formulation {BODIES!r} only"
        location = key_path(where, "model", "formulation")
        value = scene.model.formulation
        raise InvalidValueError(problem, where=location, given=value, allowed=BODIES, hint="remove the key")
    complete_options(BODIES, scene.model.options, key_path(where, "model", "options"))


def _with_tendons(
    system: BodySystem,
    classes: Mapping[str, MemberClass],
    tendons: Mapping[str, Tendon],
    built: BuiltBodies,
    where: str,
) -> BodySystem:
    """Return the system with its tendons, whose lengths at the start come from the bodies."""
    members = {}
    for name, tendon in tendons.items():
        shared = classes.get(tendon.class_name or "")
        if shared is not None and shared.kind != "cable":
            raise InvalidValueError(
                "a tendon is a cable",
                where=key_path(where, "tendons", name, "class"),
                given=tendon.class_name,
                allowed='a class of kind "cable"',
                hint="a bar is a body",
            )
        values = {key: getattr(tendon, key) for key in type(tendon).model_fields if key != "points"}
        values["kind"] = None if tendon.class_name else "cable"
        for point in tendon.points:
            problem, allowed = (
                "the tendon joins a point that does not exist",
                '"body.point"; a bar has A and B',
            )
            check_known(point, built.node, problem, allowed, where, "tendons", name, "points")
        nodes = tuple(system.node_name[built.node[point]] for point in tendon.points)
        members[name] = Member.model_construct(**values, nodes=nodes)
    position = compute_node_position(system)
    with _in_words_of_tendons():
        arrays = build_member_arrays(classes, members, system.node_name, position, where)
        for key in ("member_mass", "segments"):
            refuse(
                arrays[key] > (key == "segments"), InvalidValueError, "a tendon has no mass and no segments",
                section="members", names=arrays["member_name"], where=where, given=arrays[key],
                allowed="cables with mass in scenes of nodes and members",
            )  # fmt: skip
        for key in ("is_bar", "member_mass", "inner_radius", "ring_nodes", "segments"):
            del arrays[key]
        system = system.with_changes(**arrays)
        check_laws(system, where)
    return system


@contextmanager
def _in_words_of_tendons() -> Iterator[None]:
    """Say tendons and points where the checks of members say members and nodes."""
    try:
        yield
    except SceneError as error:
        error.where = error.where.replace(": members.", ": tendons.")
        if error.where.endswith(".nodes"):
            error.where = f"{error.where.removesuffix('nodes')}points"
        error.problem = error.problem.replace("member", "tendon").replace("node", "point")
        error.allowed = error.allowed.replace("node", "point")
        error.hint = error.hint.replace("node", "point")
        raise


def _request(scene: Scene, system: BodySystem, targets: Targets) -> ModelRequest:
    for key in ("node_mass", "anchor_position", "ground"):
        if getattr(scene.parameters, key) is not None:
            problem = "bodies have no such run-time parameter"
            location = key_path(targets.where, "parameters", key)
            allowed = "rest_length, spring_constant, axial_stiffness, damping, node_load, gravity"
            raise InvalidValueError(problem, where=location, given=key, allowed=allowed, hint="remove it")
    held = np.array([isinstance(system.bodies[int(k)], FixedBody) for k in system.node_body], dtype=np.bool_)
    parameters = build_parameters(
        scene.parameters,
        targets,
        spring_constant=system.spring_constant,
        axial_stiffness=system.axial_stiffness,
        anchored=np.repeat(held[:, None], 3, axis=1),
        axes=system.axes,
    )
    return build_request(scene, scene.model.quantities or DEFAULT_QUANTITIES, parameters, BODIES)
