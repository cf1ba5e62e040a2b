"""From a Scene of bodies to a BodySystem and a ModelRequest: references resolved, all checked."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np

from tensegrity_codegen.scene.assemble.actuators import build_actuators, build_sensors
from tensegrity_codegen.scene.assemble.assemble import build_request
from tensegrity_codegen.scene.assemble.bodies import BuiltBodies, build_bodies_of_scene
from tensegrity_codegen.scene.assemble.body_loads import (
    BodyFinder,
    build_body_inputs,
    build_body_loads,
    build_friction,
    three_numbers,
)
from tensegrity_codegen.scene.assemble.ground import build_ground
from tensegrity_codegen.scene.assemble.interference import find_bar_pairs
from tensegrity_codegen.scene.assemble.limits import build_limits
from tensegrity_codegen.scene.assemble.members import build_member_arrays
from tensegrity_codegen.scene.assemble.targets import Targets, build_parameters
from tensegrity_codegen.scene.checks.check_laws import check_laws
from tensegrity_codegen.scene.names import check_known, key_path
from tensegrity_codegen.scene.refuse import refuse
from tensegrity_codegen.scene.schema.body_schema import (
    Tendon,
)
from tensegrity_codegen.scene.schema.part_schema import Member, MemberClass
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.structure.bodies import (
    Bar,
    BodyInput,
    BodySystem,
    FixedBody,
)
from tensegrity_codegen.structure.kinematics import compute_node_position
from tensegrity_codegen.system.errors import (
    InvalidValueError,
    SceneError,
    StructureError,
)
from tensegrity_codegen.tables.formulations import FORMULATIONS
from tensegrity_codegen.tables.request import ModelRequest, complete_options

# What a scene of bodies gets that asks for no quantities.
BODIES = next(item.name for item in FORMULATIONS.values() if item.of_bodies)
DEFAULT_QUANTITIES = ("member_tension", "acceleration", "total_energy", "chart_margin")


def assemble_bodies(scene: Scene, where: str = "scene") -> tuple[BodySystem, ModelRequest]:
    """Return the body system that `scene` states and what it wants of it; `where` names the source in errors.

    Raises UnknownNameError, UnknownKeyError, DuplicateNameError, InvalidValueError or StructureError, with
    file and key.
    """
    _check_kind(scene, where)
    if scene.interference.stiffness is not None:
        raise InvalidValueError(
            "bars of a scene of bodies have no force where they touch",
            where=key_path(where, "interference", "stiffness"),
            given=scene.interference.stiffness,
            allowed="scenes of nodes and members",
            hint="remove the key: contacts are then detected",
        )
    built = build_bodies_of_scene(scene.bodies, where)
    if not built.coordinate.size:
        location, allowed = key_path(where, "bodies"), "at least one body of kind bar or rigid"
        raise StructureError(
            "nothing can move", where=location, given=", ".join(scene.bodies), allowed=allowed, hint="add one"
        )
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
    actuators = build_actuators(scene.actuators, [item.name for item in inputs], targets, rigid)
    system = system.with_changes(
        groups=targets.groups,
        node_load=load,
        loads=turning,
        friction=tuple(build_friction(item, k, find) for k, item in enumerate(scene.joint_friction)),
        inputs=(*inputs, *(BodyInput(item.name, "rest_length", item.members) for item in actuators)),
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
    """Raise InvalidValueError or UnknownKeyError for what a scene of nodes has and one of bodies has not."""
    foreign = {
        "nodes": bool(scene.nodes),
        "members": bool(scene.members),
        "shape": scene.shape is not None,
        "axes": scene.axes != "xyz",
    }
    for key, is_there in foreign.items():
        if is_there:
            problem, location = "a scene of bodies has no such key", key_path(where, key)
            allowed = "bodies and tendons, in all three axes"
            hint = "a fixed point is a body of kind fixed; a cable is a tendon"
            raise InvalidValueError(problem, where=location, given=key, allowed=allowed, hint=hint)
    if "formulation" in scene.model.model_fields_set and scene.model.formulation != BODIES:
        problem = f"bodies are modelled by the formulation {BODIES!r} only"
        location = key_path(where, "model", "formulation")
        raise InvalidValueError(
            problem, where=location, given=scene.model.formulation, allowed=BODIES, hint="remove the key"
        )
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
