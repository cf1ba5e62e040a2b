"""Export to MJCF, the models of MuJoCo: bodies for nodes and rigid bars, spatial tendons for members.

A node is a body with a slide joint for each axis along which it is free, and a site of its name. A member
is a spatial tendon, of a cable with a dead band from 0 to its rest length. The own mass m of an elastic bar
has the kinetic energy m/6 (vi.vi + vi.vj + vj.vj): point masses m/6 at its ends, and for each axis a fixed
tendon over vi + vj with the armature m/6. A rigid bar is a body with the masses of its ends, a rigid
body one with its inertia, parts and points.
"""

from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Comment, Element

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.export.exporter import Exported, Exporter, ExportSource
from tensegrity_codegen.export.rigid_parts import (
    RigidPart,
    add,
    find_free_bodies,
    find_rods,
    find_shared_nodes,
    number,
    numbers,
    write_elements,
)
from tensegrity_codegen.scene.describe import find_quaternion
from tensegrity_codegen.structure.collision import require_no_collision
from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.structure.outline import hide_bodies
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, check_choice, name_list

BALL = 1e-3  # m, by which balls of feet are larger, since those of MuJoCo cannot be points
STEP = 1e-4  # s, a step of MuJoCo for stiff bars; its own default is 2e-3
INTEGRATORS = ("RK4", "implicitfast", "implicit", "Euler")

# Nodes as a forest of bodies: which node's body carries which other node's body.
#
# MuJoCo's mass matrix couples bodies only along one branch of its tree, while the own mass of an elastic bar
# couples its two ends. So the nodes of such bars stand on one branch: the child's joints measure its
# displacement relative to its parent. An axis that is held at the child must be held at the parent too.


@dataclass(frozen=True)
class NodeTree:
    """A forest of nodes."""

    parent: tuple[int, ...]  # parent of each node, -1 of a root
    order: tuple[int, ...]  # the nodes, parents before their children
    fixed: NDArray[np.bool_]  # (n_nodes, 3): axes along which each node does not move

    def ancestors(self, node: int) -> list[int]:
        """Return the node and its ancestors up to the root."""
        nodes = [node]
        while self.parent[nodes[-1]] >= 0:
            nodes.append(self.parent[nodes[-1]])
        return nodes

    def children(self, node: int) -> list[int]:
        """Return the children of a node, -1: the roots."""
        return [child for child in self.order if self.parent[child] == node]

    def couples(self, i: int, j: int) -> bool:
        """Return whether the tree can couple two nodes along every axis along which both move."""
        on_branch = i in self.ancestors(j) or j in self.ancestors(i)
        return on_branch or bool((self.fixed[i] | self.fixed[j]).all())


def build_node_tree(structure: Structure, carried: NDArray[np.bool_]) -> NodeTree:
    """Return a forest in which as many elastic bars with own mass as possible join nodes of one branch."""
    fixed = structure.node_anchored.copy()
    fixed[:, [axis for axis in range(3) if axis not in structure.axes]] = True
    heavy = (structure.member_mass > 0) & structure.is_bar & ~structure.is_rigid
    neighbours: list[list[int]] = [[] for _ in range(structure.n_nodes)]
    for i, j in structure.connectivity[heavy]:
        neighbours[i].append(int(j))
        neighbours[j].append(int(i))
    parent, order = [-1] * structure.n_nodes, []
    seen = carried | fixed.all(axis=1)  # fixed nodes need no coupling
    order += [int(node) for node in np.flatnonzero(seen)]
    for root in sorted(range(structure.n_nodes), key=lambda node: -int(fixed[node].sum())):
        if seen[root]:
            continue
        stack = [(root, -1)]
        while stack:  # depth first: each remaining edge joins a node and one of its ancestors
            node, above = stack.pop()
            if seen[node]:
                continue
            seen[node], parent[node] = True, above
            order.append(node)
            stack += [
                (neighbour, node)
                for neighbour in reversed(neighbours[node])
                if not seen[neighbour] and not (fixed[neighbour] & ~fixed[node]).any()
            ]
    return NodeTree(tuple(parent), tuple(order), fixed)


WORLD_SITE = "world.origin"  # names with a point differ from all names of a scene
THIN = 1e-6  # inertia of a rigid bar about itself over that across it: MuJoCo requires one
THIN_WITH_FEET = 1e-3  # the same of bars on the ground, whose feet turn them about themselves


@dataclass
class ModelParts:
    """The parts of a model, filled one after the other."""

    structure: Structure
    tree: NodeTree
    point_mass: FloatArray  # (n_nodes,) [kg]: masses of the nodes' own bodies
    force: FloatArray  # (n_nodes, 3) [N]: constant forces on nodes
    carried: NDArray[np.bool_]
    world: Element = field(default_factory=lambda: Element("worldbody"))
    tendon: Element = field(default_factory=lambda: Element("tendon"))
    qpos: list[float] = field(default_factory=list)  # state at the start, in the order of the joints
    qvel: list[float] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def build_parts(structure: Structure) -> ModelParts:
    """Return bodies and tendons of a structure; raises FormulationError for elements unknown to MuJoCo."""
    _check_rigid(structure)
    carried = np.zeros(structure.n_nodes, dtype=bool)
    carried[structure.connectivity[structure.is_rigid].ravel()] = True
    carried[structure.is_attached] = True
    tree = build_node_tree(structure, carried)
    model = ModelParts(structure, tree, structure.node_mass.copy(), structure.node_load.copy(), carried)
    add(model.world, "site", name=WORLD_SITE, pos="0 0 0", size="0.001")
    coupled = _spread_masses(model)
    _check_masses(model)
    for body in find_free_bodies(structure):
        _add_free_body(model, body)
    for member in np.flatnonzero(find_rods(structure)):
        _add_rigid_bar(model, int(member))
    for root in tree.children(-1):
        if not carried[root]:
            _add_node(model, model.world, root, np.zeros(3))
    for member in np.flatnonzero(~structure.is_rigid):
        _add_tendon(model, int(member))
    for heavy in coupled:
        _add_coupling(model, heavy)
    return model


def _check_rigid(structure: Structure) -> None:
    """Raise FormulationError for rigid bars that meet, or are held on some axes."""
    ends = structure.connectivity[find_rods(structure)]
    shared = find_shared_nodes(structure)
    if shared:
        raise FormulationError(
            "rigid bars that share a node cannot be expressed: MuJoCo would join them by soft constraints",
            where=structure.name,
            given=f"rigid bars at {name_list(shared)}",
            hint="give the bars a stiffness, as spring_constant or axial_stiffness",
        )
    held = structure.node_anchored[ends]
    partly = held.any(axis=2) & ~held.all(axis=2)
    if partly.any():
        node = structure.node_name[ends[partly][0]]
        raise FormulationError(
            "the end of a rigid bar is anchored on some axes, which cannot be expressed",
            where=structure.name,
            given=node,
            allowed="ends that are free, or anchored on all axes",
            hint="give the bar a stiffness",
        )


def _spread_masses(parts: ModelParts) -> list[int]:
    """Add the own masses of elastic members to point masses, weights to forces; return the bars to couple."""
    structure = parts.structure
    coupled: list[int] = []
    lumped: list[int] = []
    for member in np.flatnonzero((structure.member_mass > 0) & ~structure.is_rigid):
        i, j = (int(node) for node in structure.connectivity[member])
        mass = float(structure.member_mass[member])
        bar = bool(structure.is_bar[member])  # half of the mass of a cable stands at each of its ends
        exact = bar and parts.tree.couples(i, j) and not (parts.carried[i] or parts.carried[j])
        fraction = mass / 6 if exact else mass / 2
        for node in (i, j):
            parts.point_mass[node] += fraction
            parts.force[node] += (mass / 2 - fraction) * structure.gravity
        if bar:
            (coupled if exact else lumped).append(int(member))
    if lumped:
        names = name_list([structure.member_name[member] for member in lumped])
        parts.notes.append(
            f"the own mass of {names} stands half at each end: the inertia differs from that of a bar"
        )
    return coupled


def _check_masses(parts: ModelParts) -> None:
    """Raise FormulationError for a node that can move and has no mass."""
    moves = ~parts.tree.fixed.all(axis=1) & ~parts.carried
    bad = [parts.structure.node_name[node] for node in np.flatnonzero(moves & ~(parts.point_mass > 0))]
    if bad:
        raise FormulationError(
            "a node that can move has no mass, which MuJoCo requires",
            where=parts.structure.name,
            given=name_list(bad),
            hint="give nodes a mass, or bars a mass or density",
        )


def _add_node(parts: ModelParts, above: Element, node: int, origin: FloatArray) -> None:
    """Add the body of a node, and those that it carries, to the element `above`, which stands at `origin`."""
    structure, tree = parts.structure, parts.tree
    position, name = structure.node_position[node], structure.node_name[node]
    body = add(above, "body", name=name, pos=numbers(position - origin))
    up = tree.parent[node]
    rate = structure.node_velocity[node] - (structure.node_velocity[up] if up >= 0 else 0.0)
    for axis in np.flatnonzero(~tree.fixed[node]):
        direction = " ".join("01"[int(axis == k)] for k in range(3))
        add(body, "joint", name=_joint(name, int(axis)), type="slide", axis=direction)
        parts.qpos.append(0.0)
        parts.qvel.append(float(rate[axis]))
    if not tree.fixed[node].all():
        mass = number(parts.point_mass[node])
        add(body, "inertial", pos="0 0 0", mass=mass, diaginertia=" ".join([mass] * 3))
    add(body, "site", name=name, pos="0 0 0", size="0.001")
    for child in tree.children(node):
        _add_node(parts, body, child, position)


def _add_rigid_bar(parts: ModelParts, member: int) -> None:
    """Add a rigid bar as one body: free, turning about an anchored end, or fixed."""
    structure = parts.structure
    ends = structure.connectivity[member]
    held = structure.node_anchored[ends].all(axis=1)
    mass, tips = float(structure.member_mass[member]), structure.node_position[ends]
    point, total = parts.point_mass[ends], float(mass + parts.point_mass[ends].sum())
    if not total > 0 and not held.all():
        raise FormulationError(
            "a rigid bar has no mass, which MuJoCo requires",
            where=structure.name,
            given=structure.member_name[member],
            hint="give the bar or its ends a mass",
        )
    centre = (mass * tips.mean(axis=0) + point @ tips) / total if total > 0 else tips.mean(axis=0)
    length = float(np.linalg.norm(tips[1] - tips[0]))
    direction = (tips[1] - tips[0]) / length
    origin = tips[int(held.argmax())] if held.any() else centre
    along = (tips - origin) @ direction  # places on the bar's axis, which is the body's z axis
    middle = float((centre - origin) @ direction)
    across = mass * (length**2 / 12 + (float(along.mean()) - middle) ** 2) + point @ (along - middle) ** 2
    quaternion = _turn_to(direction)
    pose = {"pos": numbers(origin), "quat": numbers(quaternion)}
    body = add(parts.world, "body", name=f"{structure.member_name[member]}.body", **pose)
    spin = _compute_spin(structure, ends, direction, length)
    local = _rotate_back(quaternion, spin)
    if not held.any():
        add(body, "freejoint", name=f"{structure.member_name[member]}.joint")
        fraction = float((centre - tips[0]) @ direction) / length
        speeds = structure.node_velocity[ends]
        parts.qpos += [*centre.tolist(), *quaternion.tolist()]
        parts.qvel += [*((1 - fraction) * speeds[0] + fraction * speeds[1]).tolist(), *local.tolist()]
    elif not held.all():
        add(body, "joint", name=f"{structure.member_name[member]}.joint", type="ball")
        parts.qpos += [1.0, 0.0, 0.0, 0.0]  # the rotation from the body's own orientation
        parts.qvel += local.tolist()
    if not held.all():
        thin = THIN if structure.ground is None else THIN_WITH_FEET
        inertia = numbers(np.array([across, across, thin * across]))
        add(body, "inertial", pos=f"0 0 {number(middle)}", mass=number(total), diaginertia=inertia)
    for node, distance in zip(ends, along, strict=True):
        add(body, "site", name=structure.node_name[node], pos=f"0 0 {number(distance)}", size="0.001")


def _add_free_body(parts: ModelParts, part: RigidPart) -> None:
    """Add a rigid body with its frame, its inertia, its parts as pictures, and sites at its points."""
    quaternion = find_quaternion(part.rotation)
    body = add(parts.world, "body", name=part.name, pos=numbers(part.origin), quat=numbers(quaternion))
    add(body, "freejoint", name=f"{part.name}.joint")
    inertia = part.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    entries = {"mass": number(part.mass), "fullinertia": numbers(inertia)}
    add(body, "inertial", pos=numbers(part.centre), **entries)
    for shape in part.shapes:
        half = np.array((shape.size[0], shape.size[-1]) if shape.kind == "tube" else shape.size)
        half[(0 if shape.kind == "box" else 1) :] /= 2.0
        kind = {"ball": "sphere", "tube": "cylinder"}.get(shape.kind, shape.kind)
        pose = {"pos": numbers(shape.position), "quat": numbers(find_quaternion(shape.axes))}
        picture = {"mass": "0", "contype": "0", "conaffinity": "0"}
        add(body, "geom", type=kind, size=numbers(half), **pose, **picture)
    for name, place in part.points.items():
        add(body, "site", name=name, pos=numbers(place), size="0.001")
    parts.qpos += [*part.origin.tolist(), *quaternion]
    parts.qvel += [*part.velocity.tolist(), *part.spin.tolist()]


def _add_tendon(parts: ModelParts, member: int) -> None:
    structure = parts.structure
    length = number(structure.rest_length[member])
    tendon = add(
        parts.tendon,
        "spatial",
        **{"class": "bar" if structure.is_bar[member] else "cable"},
        name=structure.member_name[member],
        stiffness=number(structure.mu[member]),
        damping=number(structure.damping[member]),
        springlength=f"0 {length}" if structure.tension_only[member] else length,
    )
    for node in structure.path(member):
        add(tendon, "site", site=structure.node_name[node])


def _add_coupling(parts: ModelParts, member: int) -> None:
    """Add the coupling of the ends of a bar with own mass: a fixed tendon for each axis."""
    structure, tree = parts.structure, parts.tree
    i, j = (int(node) for node in structure.connectivity[member])
    armature = number(structure.member_mass[member] / 6)
    for axis in range(3):
        coefficients: dict[int, float] = {}
        for end in (i, j):
            if not tree.fixed[end, axis]:
                for node in tree.ancestors(end):
                    if not tree.fixed[node, axis]:
                        coefficients[node] = coefficients.get(node, 0.0) + 1.0
        if coefficients:
            name = f"{structure.member_name[member]}.mass.{'xyz'[axis]}"
            tendon = add(parts.tendon, "fixed", name=name, armature=armature)
            for node, factor in coefficients.items():
                joint = _joint(structure.node_name[node], axis)
                add(tendon, "joint", joint=joint, coef=number(factor))


def _joint(node: str, axis: int) -> str:
    return f"{node}.{'xyz'[axis]}"


def _turn_to(direction: FloatArray) -> FloatArray:
    """Return the unit quaternion (w, x, y, z) of the shortest rotation from the z axis to `direction`."""
    w = 1.0 + float(direction[2])
    if w < 1e-9:  # downwards: half a turn about x
        return np.array([0.0, 1.0, 0.0, 0.0])
    quaternion = np.array([w, -direction[1], direction[0], 0.0])
    return np.asarray(quaternion / np.linalg.norm(quaternion))


def _rotate_back(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    """Return a vector of the world in the frame of a body with that orientation."""
    w, axis = quaternion[0], -quaternion[1:]
    cross = np.cross(axis, vector)
    return np.asarray(vector + 2 * (w * cross + np.cross(axis, cross)))


def _compute_spin(
    structure: Structure, ends: NDArray[np.int64], direction: FloatArray, length: float
) -> FloatArray:
    """Return the angular velocity of a rigid bar without rotation about itself (3,) [rad/s]."""
    velocity = structure.node_velocity[ends[1]] - structure.node_velocity[ends[0]]
    return np.asarray(np.cross(direction, velocity) / length)


# The whole model.


def build_mjcf(
    structure: Structure, step: float = STEP, integrator: str = "RK4"
) -> tuple[Element, list[str]]:
    """Return the model of a structure as the element `mujoco`, and notes on its limits.

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
    # Classes, bodies, tendons, actuators, and the state at the start.
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
    """Return a sentence for each fact of the structure that the model lacks or states differently."""
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
        (
            any(part.kind == "tube" for body in structure.bodies for part in body.parts),
            "tubes are drawn as cylinders",
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
    """Write a scene of nodes and members as MJCF; raises as build_mjcf."""
    structure = source.structure
    if not isinstance(structure, Structure):
        raise FormulationError(
            "scenes of bodies are not exported to MJCF",
            where=str(source.path),
            allowed="scenes with the sections nodes and members, or a shape",
        )
    root, notes = build_mjcf(structure, step, integrator)
    write_elements(root, path)
    shown = hide_bodies(structure)
    return Exported({"n_nodes": shown.n_nodes, "n_members": shown.n_members}, tuple(notes))


EXPORTER = Exporter(
    name="mjcf", title="model of MuJoCo (MJCF)", endings=(".xml",), write=write_mjcf, order=20
)
