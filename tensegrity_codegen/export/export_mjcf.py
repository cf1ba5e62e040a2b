"""Export to MJCF, the models of MuJoCo: bodies for nodes and rigid bars, spatial tendons for members."""

from pathlib import Path
from xml.etree.ElementTree import Comment, Element

import numpy as np

from tensegrity_codegen.export.exporter import Exported, Exporter, ExportSource
from tensegrity_codegen.export.mjcf_model import WORLD_SITE, ModelParts, build_parts
from tensegrity_codegen.export.rigid_parts import add, number, numbers, write_elements
from tensegrity_codegen.structure.collision import require_no_collision
from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, check_choice

BALL = 1e-3  # m, by which balls of feet are larger, since those of MuJoCo cannot be points
STEP = 1e-4  # s, a step of MuJoCo for stiff bars; its own default is 2e-3
INTEGRATORS = ("RK4", "implicitfast", "implicit", "Euler")


def build_mjcf(
    structure: Structure, step: float = STEP, integrator: str = "RK4"
) -> tuple[Element, list[str]]:
    """Return the model of a structure as the element `mujoco`, and what it cannot express.

    step [s], integrator: of MuJoCo. Raises FormulationError for structures that MuJoCo cannot express,
    InvalidValueError and UnknownNameError for other steps and integrators.
    """
    require_no_collision(structure, "MJCF")
    check_choice(integrator, INTEGRATORS, "integrator", "integrator")
    if not 0 < step < np.inf:
        raise InvalidValueError("the step is out of range", where="step", given=step, allowed="above 0 s")
    model = build_parts(structure)
    root = Element("mujoco", model=structure.name)
    root.append(Comment(" written by tensegrity_codegen; SI units "))
    gravity = numbers(structure.gravity)
    option = add(root, "option", timestep=number(step), integrator=integrator, gravity=gravity)
    if structure.ground is None:
        add(option, "flag", contact="disable")
    else:
        _add_ground(model, structure.ground)
    classes = add(root, "default")
    for kind in ("bar", "cable"):
        add(classes, "default", **{"class": kind})
    root.append(model.world)
    if len(model.tendon):
        root.append(model.tendon)
    actuator = _build_actuators(model)
    if len(actuator):
        root.append(actuator)
    if model.qpos:
        frame = add(root, "keyframe")
        state = {"qpos": " ".join(map(number, model.qpos)), "qvel": " ".join(map(number, model.qvel))}
        add(frame, "key", name="start", **state)
    return root, [*model.notes, *_list_losses(structure)]


def _add_ground(parts: ModelParts, ground: Ground) -> None:
    """Add the plane, BALL lower, and a ball at each node that can touch it."""
    friction = f"{number(ground.friction)} 0 0"
    about = {"friction": friction, "condim": "3" if ground.friction else "1", "margin": "0"}
    turned = {"pos": numbers((ground.offset - BALL) * ground.normal), "zaxis": numbers(ground.normal)}
    plane = {"type": "plane", "size": "10 10 1", "contype": "2", "conaffinity": "1"}
    add(parts.world, "geom", name="ground", **plane, **turned, **about)
    names = parts.structure.contact_name
    radius = dict(zip(names, ground.radius.tolist(), strict=True))
    for body in [parts.world, *parts.world.iter("body")]:
        for site in [element for element in body.findall("site") if element.get("name") in radius]:
            name = str(site.get("name"))
            ball = {"type": "sphere", "size": number(radius[name] + BALL), "contype": "1", "conaffinity": "2"}
            add(body, "geom", name=f"{name}.foot", pos=str(site.get("pos")), mass="0", **ball, **about)


def _build_actuators(parts: ModelParts) -> Element:
    """Return the constant forces on nodes, then the inputs of the scene."""
    structure, actuator = parts.structure, Element("actuator")
    for node in np.flatnonzero(parts.force.any(axis=1) & ~(parts.tree.fixed.all(axis=1) & ~parts.carried)):
        name = structure.node_name[node]
        constant = {"gainprm": "0", "biastype": "affine", "biasprm": "1"}
        pull = {"site": name, "refsite": WORLD_SITE, "gear": f"{numbers(parts.force[node])} 0 0 0"}
        add(actuator, "general", name=f"load.{name}", **pull, **constant)
    for scene_input in structure.inputs:
        for target in scene_input.targets if scene_input.kind == "force" else ():
            site = structure.node_name[target]
            gear = f"{numbers(np.array(scene_input.direction))} 0 0 0"
            pull = {"site": site, "refsite": WORLD_SITE, "gear": gear, "gainprm": "1"}
            add(actuator, "general", name=f"{scene_input.name}.{site}", **pull)
        for e, gain in scene_input.rest_length_gain.items():
            if not structure.is_rigid[e]:
                member = structure.member_name[e]
                tendon = {"tendon": member, "gainprm": number(gain * structure.mu[e])}
                add(actuator, "general", name=f"{scene_input.name}.{member}", **tendon)
    return actuator


def _list_losses(structure: Structure) -> list[str]:
    """Return what of the structure the model does not have, or has otherwise, a sentence each."""
    loose = structure.tension_only & ~structure.is_rigid
    fixed = structure.node_anchored.all(axis=1)
    ground = structure.ground
    facts = [
        (
            ground is not None,
            "MuJoCo has its own contact law: of the ground plane and friction are in the file; feet creep",
        ),
        (
            ground is not None and bool(ground.velocity.any() or ground.has_static_friction),
            "the belt and the static friction of the ground are not in the file",
        ),
        (
            structure.node_mass[fixed].any() or structure.node_load[fixed].any(),
            "masses and loads of anchored nodes are not in the file",
        ),
        (len(structure.axes) < 3, "axes that are not modelled are held, as those of anchored nodes"),
        ((loose & (structure.damping > 0)).any(), "cables keep their damping while slack"),
        (structure.has_switch.any(), "bilinear members have the slope before their switch only"),
        (structure.yields.any(), "plastic members stay elastic"),
        (bool(structure.sliding), "cables stick at rings with friction, and do not slip"),
        (structure.relaxes.any(), "viscous members keep their stiffness at once, and do not relax"),
        (
            any(scene_input.rest_length_gain for scene_input in structure.inputs),
            "inputs of rest lengths are forces mu u on tendons, which is exact while the cable is taut",
        ),
        (bool(structure.inputs), "an input is a control of each of its nodes or members, named input.target"),
        (bool(structure.actuators), "rates, ranges and delays of actuators are not in the file"),
        (bool(structure.sensors), "sensors are not in the file"),
        (structure.limits.is_stated, "limits are not in the file"),
        ((structure.radius > 0).any(), "radii of members and contacts of bars are not in the file"),
        (bool(structure.groups), "groups and classes are not in the file"),
    ]
    return [sentence for is_lost, sentence in facts if is_lost]


def write_mjcf(source: ExportSource, path: Path, *, step: float = STEP, integrator: str = "RK4") -> Exported:
    """Write a scene of nodes and members as MJCF; raises what build_mjcf raises."""
    structure = source.structure
    if not isinstance(structure, Structure):
        raise FormulationError(
            "scenes of bodies are not exported to MJCF",
            where=str(source.path),
            allowed="scenes with the sections nodes and members, or a shape",
        )
    root, notes = build_mjcf(structure, step, integrator)
    write_elements(root, path)
    return Exported({"n_nodes": structure.n_nodes, "n_members": structure.n_members}, tuple(notes))


EXPORTER = Exporter(
    name="mjcf", title="model of MuJoCo (MJCF)", endings=(".xml",), write=write_mjcf, order=20
)
