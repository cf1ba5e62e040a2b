"""From a Scene to a Structure and a ModelRequest: references resolved, laws applied, all checked."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from pydantic import ValidationError

from tensegrity_codegen.scene.assemble.contacts import build_collision, build_ground, find_bar_pairs
from tensegrity_codegen.scene.assemble.control import build_actuators, build_limits, build_sensors
from tensegrity_codegen.scene.assemble.free_bodies import add_corners, add_points, place_free_bodies
from tensegrity_codegen.scene.assemble.member_values import resolve_values
from tensegrity_codegen.scene.assemble.members import (
    build_member_arrays,
    build_node_arrays,
    build_node_load,
    spread_vectors,
)
from tensegrity_codegen.scene.assemble.segments import cut_at_rings, cut_cables
from tensegrity_codegen.scene.assemble.targets import (
    Targets,
    build_inputs,
    build_parameters,
    find_ground_numbers,
)
from tensegrity_codegen.scene.checks.check import check_structure
from tensegrity_codegen.scene.checks.check_members import check_freedom
from tensegrity_codegen.scene.names import key_path
from tensegrity_codegen.scene.schema.part_schema import ForceInput, Load, RestLengthInput, TemperatureInput
from tensegrity_codegen.scene.schema.schema import Scene, SceneParts
from tensegrity_codegen.scene.shapes import expand_shape
from tensegrity_codegen.scene.translate import translate
from tensegrity_codegen.structure.inertia_plan import find_massless
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError
from tensegrity_codegen.tables.body_places import join_bodies
from tensegrity_codegen.tables.formulations import choose_formulation, find_formulation
from tensegrity_codegen.tables.request import ModelRequest, complete_options
from tensegrity_codegen.tables.strands import list_strands

INPUTS = RestLengthInput | TemperatureInput | ForceInput
SCENE = "a Scene, as read_scene(...) returns it"
# Quantities of a scene that names none; the second if a free node has no mass.
DEFAULT_QUANTITIES = ("member_tension", "acceleration", "total_energy")
MASSLESS_QUANTITIES = ("node_residual", "potential_energy")  # after the tension


def assemble(scene: Scene, where: str = "scene") -> tuple[Structure, ModelRequest]:
    """Return the structure and the request of `scene`; `where` names the source in errors.

    Raises UnknownNameError, DuplicateNameError, InvalidValueError or StructureError, with file and key.
    """
    check_instance(scene, Scene, "scene", SCENE)
    loads, inputs = _of_nodes(scene, where)
    expanded = list_parts(scene, where)
    axes = tuple("xyz".index(letter) for letter in scene.axes)
    bodies = place_free_bodies(scene.bodies, axes, where)
    node = add_points(build_node_arrays(expanded.nodes, axes, where), bodies, where)
    member = build_member_arrays(
        scene.classes, expanded.members, node["node_name"], node["node_position"], where
    )
    gravity = spread_vectors([scene.gravity], axes, [("gravity",)], where)[0]
    cut = cut_cables(node, member, expanded.groups, gravity, axes, where)
    cut, sliding = cut_at_rings(cut, scene, expanded.members, where)
    node, member = cut.node, cut.member
    point_names = node["node_name"]
    node, member, free_bodies = add_corners(node, member, bodies, where)
    names = (*point_names, *node["node_name"][len(point_names) :])  # points as the scene writes them
    node["node_load"] = build_node_load(names, loads, axes, where, len(names) - len(point_names))
    targets = Targets(
        names,
        member["member_name"],
        member["member_class"],
        scene.classes,
        cut.groups,
        where,
        share=np.concatenate([cut.share, np.ones(len(member["member_name"]) - len(cut.share))]),
    )
    rigid = (member["spring_constant"] == 0) & (member["axial_stiffness"] == 0)
    ends = list_strands(member["connectivity"], member["ring_nodes"]).ends
    joined = join_bodies(ends, [body.place() for body in free_bodies])
    check_freedom(joined, node["node_anchored"], axes, names, where)
    acting = build_inputs(inputs, targets, member, axes)
    actuators = build_actuators(scene.actuators, [entry.name for entry in acting], targets, rigid)
    structure = Structure(
        name=scene.name,
        axes=axes,
        gravity=gravity,
        groups=targets.groups,
        inputs=(*acting, *(ActuatedInput(entry.name, "rest_length", entry.members) for entry in actuators)),
        actuators=actuators,
        sensors=build_sensors(scene.sensors, targets, bodies=[body.name for body in bodies]),
        sliding=sliding,
        is_large=scene.large,
        bodies=free_bodies,
        notes=tuple(body.note for body in bodies if body.note),
        **node,
        **member,
    )
    structure = structure.with_changes(
        interference=_watch_bars(scene, structure, where),
        limits=build_limits(scene.limits, structure, scene.classes, where, cut.cables),
        ground=build_ground(scene.ground, structure, {name: row for row, name in enumerate(names)}, where),
        collision=build_collision(scene.interference, where),
    )
    check_structure(structure, where)
    request = _build_request(scene, structure, targets)
    complete_options(request.formulation, request.options, key_path(where, "model", "options"))
    return structure, request


def _of_nodes(
    scene: Scene, where: str
) -> tuple[list[Load], list[RestLengthInput | TemperatureInput | ForceInput]]:
    """Return loads and inputs of a scene without bodies; InvalidValueError for keys of bodies."""
    loads = [entry for entry in scene.loads if isinstance(entry, Load)]
    inputs = [entry for entry in scene.inputs if isinstance(entry, INPUTS)]
    foreign = [
        ("tendons", bool(scene.tendons)),
        ("joint_friction", bool(scene.joint_friction)),
        ("loads", len(loads) < len(scene.loads)),
        ("inputs", len(inputs) < len(scene.inputs)),
    ]
    for section, is_there in foreign:
        if is_there:
            problem, location = "this belongs to a scene of bodies with angles", key_path(where, section)
            allowed = 'loads and forces on nodes and on points of bodies, node = "body.point"'
            hint = "name points of bodies as nodes; a torque is two opposite forces on points of the body"
            raise InvalidValueError(problem, where=location, given=section, allowed=allowed, hint=hint)
    if find_formulation(scene.model.formulation).of_bodies:
        problem = f"formulation {scene.model.formulation!r} needs bodies"
        location, allowed = key_path(where, "model", "formulation"), "a scene with a table [bodies.<name>]"
        hint = 'formulation = "node_position"'
        value = scene.model.formulation
        raise InvalidValueError(problem, where=location, given=value, allowed=allowed, hint=hint)
    return loads, inputs


def _watch_bars(scene: Scene, structure: Structure, where: str) -> tuple[tuple[int, int], ...] | None:
    """Return the members whose distance the scene wants watched, None for all of them."""
    bars = {structure.member_name[e]: int(e) for e in np.flatnonzero(structure.is_bar)}
    radius = {name: float(structure.radius[e]) for name, e in bars.items()}
    joints = {name: structure.connectivity[e].tolist() for name, e in bars.items()}
    return find_bar_pairs(scene.interference, bars, radius, joints, where)


def list_parts(scene: Scene, where: str) -> SceneParts:
    """Return the nodes, members and groups of the scene's shape, then those of the scene itself."""
    if scene.shape is None:
        return scene
    document = expand_shape(scene.shape, key_path(where, "shape"))
    try:
        made = SceneParts.model_validate(document)
    except ValidationError as error:
        raise translate(error, key_path(where, "shape")) from None
    for section in ("nodes", "members", "groups"):
        twice = getattr(made, section).keys() & getattr(scene, section).keys()
        if twice:
            name = min(twice)
            problem = f"the shape also generates {section} with this name"
            location, allowed = key_path(where, section, name), "a name that the shape does not use"
            raise DuplicateNameError(problem, where=location, given=name, allowed=allowed, hint="rename it")
    return SceneParts.model_construct(
        nodes={**made.nodes, **scene.nodes},
        members={**made.members, **scene.members},
        groups={**made.groups, **scene.groups},
    )


def find_mass_per_length(scene: Scene, structure: Structure, where: str) -> FloatArray:
    """Return the masses for each metre of members that state them so, (n_members,) [kg/m]; nan of others.

    Of the rest lengths of cables, by mass_per_length, and of the lengths of bars, by density.
    """
    members = list_parts(scene, where).members
    values = resolve_values(scene.classes, members, where)[0]
    stated = ~np.isnan(values["mass_per_length"]) | ~np.isnan(values["density"])
    row = {name: e for e, name in enumerate(structure.member_name)}
    names = [name for name, is_stated in zip(members, stated, strict=True) if is_stated]
    # Of a cable in segments the pieces are a group of its name.
    rows = [e for name in names for e in ([row[name]] if name in row else structure.groups[name])]
    length = np.where(structure.is_bar, structure.member_length(), structure.rest_length)
    per_length = np.full(structure.n_members, np.nan)
    per_length[rows] = structure.member_mass[rows] / length[rows]
    return per_length


def _build_request(scene: Scene, structure: Structure, targets: Targets) -> ModelRequest:
    parameters = build_parameters(
        scene.parameters,
        targets,
        spring_constant=structure.spring_constant,
        axial_stiffness=structure.axial_stiffness,
        anchored=structure.node_anchored,
        axes=structure.axes,
        bodies=structure.bodies,
    )
    parameters |= find_ground_numbers(scene.parameters.ground, structure.ground, targets.where)
    # A scene that names no formulation gets the one that has its bars
    formulation = scene.model.formulation
    if "formulation" not in scene.model.model_fields_set and structure.is_rigid.any():
        formulation = choose_formulation(rigid_bars=True).name
    # A scene that names no quantities gets those of motions, or of statics where a node has no mass
    quantities = scene.model.quantities or DEFAULT_QUANTITIES
    if not scene.model.quantities and find_massless(structure).any():
        quantities = (find_formulation(formulation).massless_tension, *MASSLESS_QUANTITIES)
    request = build_request(scene, quantities, parameters, formulation)
    return replace(request, options=scene.model.options)


def build_request(
    scene: Scene, quantities: tuple[str, ...], parameters: Mapping[str, tuple[int, ...]], formulation: str
) -> ModelRequest:
    """Return the request of a scene, without options of its formulation."""
    return ModelRequest(
        quantities=quantities,
        parameters=parameters,
        integrators=tuple(dict.fromkeys(scene.model.integrators)),
        solvers=tuple(dict.fromkeys(scene.model.solvers)),
        formulation=formulation,
        emitter=scene.model.emitter,
        precision=scene.model.precision,
        events=scene.model.events,
        keep=scene.model.keep,
        flags=scene.model.flags,
        checks=scene.model.checks,
        batch_width=scene.model.batch_width,
        interfaces=tuple(dict.fromkeys(scene.model.interfaces)),
    )
