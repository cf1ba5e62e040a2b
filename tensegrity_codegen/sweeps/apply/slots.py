"""Slots that may differ between cases of one library: initial state, inputs, parameters, as arrays.

Everything else of a structure is constant in the code; its hash says whether two cases can share a library.
"""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np

from tensegrity_codegen.analyses.cases.quantities import GUST, OF_LOOPS, build_no_gust
from tensegrity_codegen.codegen.compilation.fingerprint import hash_request, hash_structure, hash_text
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.ground import CHANGEABLE, Ground
from tensegrity_codegen.structure.rigid_bars import find_rigid_bars
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.sweeps.apply.assembler import AssembledCase
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.request import ModelRequest, complete_options

STATE = ("coordinate", "velocity", "input")  # slots that are arguments of every library
WITHOUT_ROWS = (*STATE, *OF_LOOPS, "gravity")  # slots that are arguments as a whole
OF_MEMBERS = ("rest_length", "spring_constant", "axial_stiffness", "damping")
# Parts by which lengths of rigid bars differ that are the same but for rounding.
DIGITS = 12


def list_slots(case: AssembledCase) -> dict[str, FloatArray]:
    """Return the values that can differ between cases of one library, by argument.

    Parameters take all rows here, (n_members,), (n_nodes,) or (n_nodes, n_axes); zero where a row has no
    meaning.
    """
    subject = case.subject
    slots = {"input": case.inputs}
    if isinstance(subject, BodySystem):
        slots |= {"coordinate": subject.coordinate, "velocity": subject.velocity, "gravity": subject.gravity}
        slots |= {name: getattr(subject, name) for name in (*OF_MEMBERS, "node_load")}
    else:
        slots |= _slots_of_nodes(subject, case.request)
    slots["actuator_delay"] = np.array([item.delay for item in subject.actuators])
    slots["actuator_rate"] = np.array([item.rate for item in subject.actuators])
    slots["sensor_noise"] = np.array([item.noise for item in subject.sensors])
    slots |= case.gust or build_no_gust(subject)
    slots[GUST] = slots[GUST] if isinstance(subject, BodySystem) else slots[GUST][:, list(subject.axes)]
    return {name: np.asarray(slots[name], dtype=np.float64) for name in sorted(slots)}


def hash_constants(case: AssembledCase) -> str:
    """Return the hash of all that no argument of the library can change: equal hashes, one library."""
    subject, request = case.subject, case.request
    blank: dict[str, Any] = {
        name: np.zeros_like(getattr(subject, name)) for name in (*OF_MEMBERS, "node_load")
    }
    blank |= {"gravity": np.zeros(3)}
    # The rate of a motor with a lag is a constant of its equation.
    blank |= {
        "actuators": tuple(
            replace(item, delay=0.0, rate=item.rate if item.time_constant else np.inf)
            for item in subject.actuators
        )
    }
    blank |= {"sensors": tuple(replace(item, noise=0.0) for item in subject.sensors)}
    patterns = [subject.spring_constant > 0, subject.axial_stiffness > 0]
    extra: list[Any] = []
    if isinstance(subject, BodySystem):
        blank |= {"coordinate": np.zeros(subject.n_coordinates), "velocity": np.zeros(subject.n_coordinates)}
    else:
        position = np.zeros_like(subject.node_position)
        if not _moves_anchors(request.formulation):
            position[subject.node_anchored] = subject.node_position[subject.node_anchored]
        blank |= {"node_position": position, "node_velocity": np.zeros_like(subject.node_velocity)}
        blank |= {"node_mass": np.zeros(subject.n_nodes)}
        patterns.append(subject.node_mass > 0)
        if subject.ground is not None:
            blank["ground"] = _blank_ground(subject.ground)
            patterns.append(np.array([subject.ground.friction > 0]))
        rigid = find_rigid_bars(subject, request)
        extra = [f"{length:.{DIGITS}g}" for length in subject.member_length()[rigid]]
    shape = hash_structure(subject.with_changes(**blank))
    masks = ["".join("01"[int(x)] for x in pattern) for pattern in patterns]
    return hash_text(shape, hash_request(request), *masks, *extra)


def _blank_ground(ground: Ground) -> Ground:
    """Return the ground with one in place of each number that a library can change at run time."""
    changed: dict[str, Any] = dict.fromkeys(CHANGEABLE, 1.0)
    if ground.static_friction is not None or not ground.friction:
        changed["friction"] = ground.friction
    return replace(ground, **changed)


def name_changed(first: AssembledCase, second: AssembledCase) -> list[str]:
    """Return the names of the constants that differ between two cases, as `member_mass`."""
    variable = {*OF_MEMBERS, "node_load", "gravity", "coordinate", "velocity", "node_mass", "node_velocity"}
    variable |= {"node_position", "actuators", "sensors", "limits"}
    if type(first.subject) is not type(second.subject):
        return []
    return [
        item.name
        for item in fields(first.subject)
        if item.name not in variable
        and not _equal(getattr(first.subject, item.name), getattr(second.subject, item.name))
    ]


def _equal(first: Any, second: Any) -> bool:
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        return np.array_equal(first, second)
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        return first.keys() == second.keys() and all(_equal(first[key], second[key]) for key in first)
    return bool(first == second)


def _slots_of_nodes(structure: Structure, request: ModelRequest) -> dict[str, FloatArray]:
    axes = list(structure.axes)
    elastic = ~find_rigid_bars(structure, request)
    slots = {name: np.where(elastic, getattr(structure, name), 0.0) for name in OF_MEMBERS}
    slots |= {"gravity": structure.gravity[axes], "node_mass": structure.node_mass}
    slots |= {"node_load": structure.node_load[:, axes]}
    ground = structure.ground
    slots |= {} if ground is None else {"ground": np.array([getattr(ground, name) for name in CHANGEABLE])}
    if _moves_anchors(request.formulation):
        held = structure.node_anchored[:, axes]
        slots["anchor_position"] = np.where(held, structure.node_position[:, axes], 0.0)
    if find_formulation(request.formulation).in_nodes:
        node, axis = structure.coordinate_node_axis.T
        slots |= {
            "coordinate": structure.node_position[node, axis],
            "velocity": structure.node_velocity[node, axis],
        }
    else:
        slots |= _distances(structure, request)
    return slots


def _moves_anchors(formulation: str) -> bool:
    """Return whether positions of anchored nodes can be run-time parameters."""
    return find_formulation(formulation).in_nodes


def _distances(structure: Structure, request: ModelRequest) -> dict[str, FloatArray]:
    """Return the state in differences of node positions and centres of mass."""
    import casadi as ca  # which this formulation alone needs here

    from tensegrity_codegen.symbolic.inertia import Inertia
    from tensegrity_codegen.symbolic.pair_coordinates import PairCoordinates

    options = complete_options(request.formulation, request.options)
    inertia = Inertia(structure, [ca.SX(float(value)) for value in structure.node_mass])
    masses = inertia.weight_mass()
    layout = PairCoordinates(structure, options["pairs"], options["order"], masses)
    weight = np.array([float(value) for value in masses])
    return {
        "coordinate": layout.compute(structure.node_position, weight),
        "velocity": layout.compute(structure.node_velocity, weight),
    }
