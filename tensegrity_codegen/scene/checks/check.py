"""Checks of a structure as bare arrays, for those who build one themselves, and doubts about a sound one."""

from collections.abc import Mapping
from dataclasses import fields
from functools import partial
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.checks.check_ground import check_ground, check_indices
from tensegrity_codegen.scene.checks.check_members import check_connectivity, check_freedom, check_laws
from tensegrity_codegen.scene.names import check_name, check_names, check_scene_name, key_path
from tensegrity_codegen.scene.refuse import refuse
from tensegrity_codegen.structure.actuators import (
    BODY_SENSORS,
    MEMBER_SENSORS,
    NODE_SENSORS,
    REST_LENGTH_KINDS,
    UNLIMITED,
    Actuator,
    Sensor,
)
from tensegrity_codegen.structure.limits import MEMBER_LIMITS
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.system.checks import check_instance
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, StructureError

# A rigid bar's rest length may differ from its length by this part of it.
RIGID_TOLERANCE = 1e-9
LEAST_MASS = 1e-250  # [kg], above 0: stiffness over mass is finite for all that is smaller than 1e58 N/m

_MEMBER_NUMBERS = ("rest_length", "spring_constant", "axial_stiffness", "damping", "member_mass", "radius")
_SHAPE: dict[str, tuple[str | int, ...]] = {
    **dict.fromkeys(("node_position", "node_velocity"), ("n_nodes", 3)),
    "node_mass": ("n_nodes",),
    **dict.fromkeys(("node_anchored", "node_load"), ("n_nodes", 3)),
    "gravity": (3,),
    "connectivity": ("n_members", 2),
    **dict.fromkeys(("is_bar", "tension_only", *_MEMBER_NUMBERS), ("n_members",)),
}
_BOOLEAN = ("node_anchored", "is_bar", "tension_only")


def check_structure(structure: Structure, where: str = "structure") -> None:
    """Raise unless the arrays of `structure` make sense, one by one and together."""
    check_instance(structure, Structure, where, "a Structure")
    _check_kinds(structure, where)
    _check_arrays(structure, where)
    _check_names(structure, where)
    _check_values(structure, where)
    _check_laws(structure, where)
    _check_rings(structure, where)
    check_connectivity(
        structure.strands,
        structure.member_name,
        structure.node_name,
        structure.node_position,
        np.where(structure.tension_only, structure.rest_length, np.nan),
        where,
        structure.is_attached,
    )
    _check_masses_on_bodies(structure, where)
    check_freedom(structure.joined, structure.node_anchored, structure.axes, structure.node_name, where)
    _check_rigid_bars(structure, where)
    _check_anchored_velocity(structure, where)
    _check_plane(structure, where)
    for group, members in structure.groups.items():
        check_indices(members, structure.n_members, key_path(where, "groups", group))
    for number, entry in enumerate(structure.inputs):
        _check_input(structure, number, entry, where)
    check_control(structure, where)
    check_ground(structure, where)


def _check_kinds(structure: Structure, where: str) -> None:
    """Check the kinds of all that is no array: texts, numbers of axes, groups, inputs, actuators, sensors."""

    def hold(key: str, kind: Any, values: Any, allowed: str) -> None:
        if not isinstance(values, tuple | list) or not all(isinstance(value, kind) for value in values):
            shown = type(values).__name__ if not isinstance(values, tuple | list) else values
            raise InvalidValueError("wrong type", where=key_path(where, key), given=shown, allowed=allowed)

    for key in ("node_name", "member_name", "member_class"):
        hold(key, str, getattr(structure, key), "a tuple of texts")
    hold("axes", Integral, structure.axes, "0, 1, 2 or some, in order")
    for key, kind in (("inputs", ActuatedInput), ("actuators", Actuator), ("sensors", Sensor)):
        hold(key, kind, getattr(structure, key), f"a tuple of {kind.__name__}")
    for key in ("groups", "law_parameter"):
        check_instance(getattr(structure, key), Mapping, key_path(where, key), "a dictionary")
    for name, members in structure.groups.items():
        hold("groups", str, [name], "names of groups")
        hold("groups", Integral, members, "indices of members by the name of a group")
    pairs = structure.interference
    hold("interference", tuple | list, () if pairs is None else pairs, "None, or pairs of indices of bars")
    for pair in pairs or ():
        hold("interference", Integral, pair, "None, or pairs of indices of bars")
        if len(pair) != 2 or not all(0 <= e < structure.n_members and structure.is_bar[e] for e in pair):
            location = key_path(where, "interference")
            problem = "no pair of bars"
            raise InvalidValueError(problem, where=location, given=pair, allowed="indices of two bars")


def _check_masses_on_bodies(structure: Structure, where: str) -> None:
    """Raise InvalidValueError for masses at points of bodies, which have the mass of their body alone."""
    at_points = structure.is_attached
    refuse(
        at_points & (structure.node_mass > 0), InvalidValueError, "a point of a body has no mass of its own",
        section="nodes", names=structure.node_name, where=where, key="mass", given=structure.node_mass,
        allowed="0", hint="add the mass to the body, as one of its parts",
    )  # fmt: skip
    refuse(
        at_points[structure.connectivity].any(axis=1) & (structure.member_mass > 0), InvalidValueError,
        "a member with mass ends at a point of a body", section="members", names=structure.member_name,
        where=where, key="mass", given=structure.member_mass, allowed="members without mass at bodies",
        hint="add half of its mass to the body, as one of its parts, and half to its other node",
    )  # fmt: skip


def _check_rings(structure: Structure, where: str) -> None:
    """Check the nodes that members pass between their ends: one tuple a member, of cables that only pull."""
    rings, location = structure.ring_nodes, key_path(where, "ring_nodes")
    if rings and len(rings) != structure.n_members:
        problem, allowed = "one tuple for each member is needed", f"{structure.n_members}, or none at all"
        raise InvalidValueError(problem, where=location, given=len(rings), allowed=allowed)
    for number, nodes in ((number, nodes) for number, nodes in enumerate(rings) if nodes):
        check_indices(nodes, structure.n_nodes, f"{location}[{number}]")
    passes = structure.passes_rings
    report = partial(refuse, section="members", names=structure.member_name, where=where)
    is_bad, problem = passes & ~structure.tension_only, "only a cable that cannot push passes rings"
    allowed = "two nodes, or a cable with tension_only = true"
    hint = "split the member at the nodes between its ends"
    report(is_bad, InvalidValueError, problem, key="nodes", allowed=allowed, hint=hint)
    is_bad, problem = passes & (structure.member_mass > 0), "a cable through rings has no mass of its own"
    allowed = "masses of nodes, or a cable with mass between two nodes"
    report(is_bad, InvalidValueError, problem, key="mass", given=structure.member_mass, allowed=allowed)


def _check_arrays(structure: Structure, where: str) -> None:
    """Check the axes, and shape and kind of numbers of every array."""
    if not structure.axes or list(structure.axes) != sorted({0, 1, 2} & set(structure.axes)):
        problem, allowed = "wrong axes", "0, 1, 2 or some, in order"
        raise InvalidValueError(problem, where=key_path(where, "axes"), given=structure.axes, allowed=allowed)
    size = {"n_nodes": structure.n_nodes, "n_members": structure.n_members}
    for field in fields(structure):
        if field.name not in _SHAPE:
            continue
        value = getattr(structure, field.name)
        shape = tuple(
            size[size_name] if isinstance(size_name, str) else size_name for size_name in _SHAPE[field.name]
        )
        kind = "b" if field.name in _BOOLEAN else "i" if field.name == "connectivity" else "f"
        if not isinstance(value, np.ndarray) or value.shape != shape or value.dtype.kind != kind:
            shown = f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
            dtype_name = {"b": "bool", "i": "int64", "f": "float64"}[kind]
            problem = "an array of the wrong shape or kind of number"
            allowed = f"{dtype_name} array of shape {shape}"
            raise InvalidValueError(problem, where=key_path(where, field.name), given=shown, allowed=allowed)
    _check_optional_arrays(structure, where)
    if len(structure.member_class) != structure.n_members:
        problem, location = "one class name for each member is needed", key_path(where, "member_class")
        allowed = str(structure.n_members)
        raise InvalidValueError(problem, where=location, given=len(structure.member_class), allowed=allowed)


def _check_optional_arrays(structure: Structure, where: str) -> None:
    inner, expansion = structure.inner_radius, structure.thermal_expansion
    of_numbers = isinstance(inner, np.ndarray) and inner.dtype.kind == "f"
    if inner is not None and not (
        of_numbers and inner.shape == (structure.n_members,) and (inner <= structure.radius).all()
    ):
        problem = "inner radii that members cannot have"
        value = inner.shape if of_numbers else type(inner).__name__
        allowed = f"None, or an array of shape ({structure.n_members},) with values up to radius"
        raise InvalidValueError(problem, where=key_path(where, "inner_radius"), given=value, allowed=allowed)
    is_array = expansion is not None and expansion.shape == (structure.n_members,)
    if expansion is not None and not (is_array and np.isfinite(expansion).all()):
        problem = "coefficients of thermal expansion that members cannot have"
        location = key_path(where, "thermal_expansion")
        allowed = f"None, or an array of shape ({structure.n_members},) of finite numbers"
        raise InvalidValueError(problem, where=location, given=expansion.shape, allowed=allowed)


def _check_names(structure: Structure, where: str) -> None:
    check_scene_name(structure.name, key_path(where, "name"))
    check_names(structure.node_name, "nodes", where)
    check_names(structure.member_name, "members", where)
    check_names(tuple(structure.groups), "groups", where)
    check_names([entry.name for entry in structure.inputs], "inputs", where)
    for name in set(structure.member_class) - {""}:
        check_name(name, key_path(where, "classes"))


def _check_values(structure: Structure, where: str) -> None:
    """Check that all numbers are finite and in range, each by itself."""
    if not np.isfinite(structure.gravity).all():
        problem = "not a finite number"
        raise NonFiniteError(problem, where=key_path(where, "gravity"), given=structure.gravity.tolist())
    for key, shape in _SHAPE.items():
        value = getattr(structure, key)
        if value.dtype.kind != "f" or key == "gravity":
            continue
        of_nodes = shape[0] == "n_nodes"
        section = "nodes" if of_nodes else "members"
        names = structure.node_name if of_nodes else structure.member_name
        finite: NDArray[np.bool_] = np.all(np.isfinite(value.reshape(len(names), -1)), axis=1)
        report = partial(refuse, section=section, names=names, where=where, given=value)
        short = key.removeprefix("node_").removeprefix("member_")
        report(~finite, NonFiniteError, "not a finite number", key=short, allowed="finite numbers")
        if key == "rest_length":
            report(value <= 0, InvalidValueError, "not positive", key=short, allowed="more than 0")
        elif value.ndim == 1:
            report(value < 0, InvalidValueError, "a negative value", key=short, allowed="0 or more")
        if short == "mass":  # divided by in every acceleration
            tiny = (value > 0) & (value < LEAST_MASS)
            least = f"0, or {LEAST_MASS:g} kg and more"
            report(tiny, InvalidValueError, "too small to divide by", key=short, allowed=least)
    used = structure.connectivity
    lost: NDArray[np.bool_] = np.any((used < 0) | (used >= structure.n_nodes), axis=1)
    report = partial(refuse, section="members", names=structure.member_name, where=where, key="nodes")
    problem, allowed = "a node index out of range", f"0 to {structure.n_nodes - 1}"
    report(lost, InvalidValueError, problem, given=used, allowed=allowed)


def _check_laws(structure: Structure, where: str) -> None:
    """Check that every member has one law that its kind can have."""
    spring, axial, bar = structure.spring_constant > 0, structure.axial_stiffness > 0, structure.is_bar
    report = partial(refuse, section="members", names=structure.member_name, where=where)
    allowed = "one of spring_constant [N/m], axial_stiffness [N]"
    report(spring & axial, InvalidValueError, "stiffness given twice", allowed=allowed)
    report(~spring & ~axial & ~bar, InvalidValueError, "a cable without stiffness", allowed=allowed)
    is_bad = bar & structure.tension_only
    report(is_bad, InvalidValueError, "a bar cannot be tension_only", key="tension_only")
    check_laws(structure, where)


def _check_rigid_bars(structure: Structure, where: str) -> None:
    length = structure.member_length()
    differs = np.abs(structure.rest_length - length) > RIGID_TOLERANCE * length
    report = partial(refuse, section="members", names=structure.member_name, where=where, key="rest_length")
    problem = "a rigid bar whose rest length is not the distance of its nodes"
    allowed, hint = "the distance of the two nodes", "leave rest_length out, or give the bar a stiffness"
    is_bad, value = structure.is_rigid & differs, structure.rest_length
    report(is_bad, StructureError, problem, given=value, allowed=allowed, hint=hint)


def _check_anchored_velocity(structure: Structure, where: str) -> None:
    report = partial(refuse, section="nodes", names=structure.node_name, where=where, key="velocity")
    is_bad = (structure.node_anchored & (structure.node_velocity != 0)).any(axis=1)
    problem, value = "a velocity on an anchored axis", structure.node_velocity
    report(is_bad, StructureError, problem, given=value, allowed="0 on anchored axes")


def _check_plane(structure: Structure, where: str) -> None:
    """Check that nothing leaves the modelled axes."""
    for axis in sorted({0, 1, 2} - set(structure.axes)):
        letter = "xyz"[axis]
        report = partial(refuse, section="nodes", names=structure.node_name, where=where)
        coordinate = structure.node_position[:, axis]
        is_bad, position = coordinate != coordinate[0], structure.node_position
        problem = f"a planar scene without the axis {letter}, and the nodes differ in {letter}"
        allowed = f"{letter} = {coordinate[0]:g}, as the first node has it"
        hint = f"put {letter} into axes, or give all nodes one {letter}"
        report(is_bad, StructureError, problem, key="position", given=position, allowed=allowed, hint=hint)
        for key, value in (("velocity", structure.node_velocity), ("load", structure.node_load)):
            is_bad = value[:, axis] != 0
            problem = f"a {key} along {letter}, an axis that the scene does not model"
            report(is_bad, StructureError, problem, key=key, given=value, allowed=f"0 along {letter}")
        if structure.gravity[axis] != 0:
            problem = f"gravity along {letter}, an axis that the scene does not model"
            location, allowed = key_path(where, "gravity"), f"0 along {letter}"
            raise StructureError(problem, where=location, given=structure.gravity.tolist(), allowed=allowed)


def _check_input(structure: Structure, number: int, item: ActuatedInput, where: str) -> None:
    location = key_path(where, "inputs", number)
    if item.kind not in (*REST_LENGTH_KINDS, "force"):
        allowed = "rest_length, temperature, force"
        raise InvalidValueError("unknown kind of input", where=location, given=item.kind, allowed=allowed)
    force = item.kind == "force"
    check_indices(item.targets, structure.n_nodes if force else structure.n_members, location)
    if not force:
        if structure.is_rigid[list(item.targets)].any():
            problem = "a rigid bar has no rest length to change"
            raise InvalidValueError(problem, where=location, given=item.name)
        allowed = "one number for each member" + ("" if item.kind == "temperature" else ", or none")
        if len(item.gain) != len(item.targets) and (item.gain or item.kind == "temperature"):
            raise InvalidValueError("wrong number of gains", where=location, given=item.gain, allowed=allowed)
        if not np.isfinite(np.array(item.gain, dtype=float)).all():
            raise NonFiniteError("not a finite gain", where=location, given=item.gain, allowed=allowed)
        return
    direction = np.array(item.direction)
    if not np.isfinite(direction).all():
        raise NonFiniteError("not a finite number", where=location, given=item.direction)
    if direction.shape != (3,) or abs(np.linalg.norm(direction) - 1) > RIGID_TOLERANCE:
        problem = "the direction is no unit vector"
        raise InvalidValueError(problem, where=location, given=item.direction, allowed="length 1")
    dropped = sorted({0, 1, 2} - set(structure.axes))
    if direction[dropped].any():
        problem = "a force along an axis that the scene does not model"
        allowed = "0 along " + ", ".join("xyz"[axis] for axis in dropped)
        raise StructureError(problem, where=f"{location}.direction", given=item.direction, allowed=allowed)


def check_control(structure: Structure, where: str) -> None:
    """Raise unless the actuators are the last inputs and sound, and so are sensors and limits."""
    actuated = structure.inputs[len(structure.inputs) - len(structure.actuators) :]
    expected = [(entry.name, "rest_length", tuple(entry.members), ()) for entry in structure.actuators]
    if expected != [(entry.name, entry.kind, tuple(entry.targets), tuple(entry.gain)) for entry in actuated]:
        raise InvalidValueError(
            "the actuators are not the last inputs",
            where=key_path(where, "actuators"),
            given=[entry.name for entry in structure.actuators],
            allowed="one input of kind rest_length for each actuator, with its name and members, in order, "
            "after all other inputs",
        )
    for number, entry in enumerate(structure.actuators):
        _check_actuator(entry, key_path(where, "actuators", number))
    check_names([entry.name for entry in structure.sensors if entry.name], "sensors", where)
    for number, sensor in enumerate(structure.sensors):
        location = key_path(where, "sensors", number)
        valid_kinds = (*MEMBER_SENSORS, *NODE_SENSORS, *BODY_SENSORS)
        if sensor.kind not in valid_kinds:
            problem, allowed = "unknown kind of sensor", ", ".join(valid_kinds)
            raise InvalidValueError(problem, where=location, given=sensor.kind, allowed=allowed)
        size = structure.n_members if sensor.kind in MEMBER_SENSORS else structure.n_nodes
        size = len(structure.bodies) if sensor.kind in BODY_SENSORS else size
        check_indices(sensor.targets, size, location)
        if not 0 <= sensor.noise < np.inf:
            problem = "not a standard deviation"
            raise InvalidValueError(problem, where=location, given=sensor.noise, allowed="0 or more, finite")
    _check_limits(structure, where)


def _check_actuator(item: Actuator, place: str) -> None:
    rules = {
        "rate": (item.rate > 0, "more than 0 [m/s]; infinite without a limit"),
        "range": (
            tuple(item.range) == UNLIMITED or 0 < item.range[0] < item.range[1] < np.inf,
            "(least, largest) rest length [m], both positive and finite; (0, inf) without a limit",
        ),
        "delay": (0 <= item.delay < np.inf, "0 or more [s], finite"),
    }
    for key, (is_sound, allowed) in rules.items():
        if not is_sound:
            problem, location = f"the actuator {item.name} cannot have this {key}", f"{place}.{key}"
            raise InvalidValueError(problem, where=location, given=getattr(item, key), allowed=allowed)


def _check_limits(structure: Structure, where: str) -> None:
    limits, location = structure.limits, key_path(where, "limits")
    for key in MEMBER_LIMITS:
        values = getattr(limits, key)
        if values.shape != (structure.n_members,) or values.dtype.kind != "f":
            problem = "an array of the wrong shape or kind of number"
            allowed = f"float64 array of shape ({structure.n_members},)"
            raise InvalidValueError(
                problem, where=f"{location}.{key}", given=f"{values.dtype} {values.shape}", allowed=allowed
            )
        report = partial(
            refuse, section="limits.members", names=structure.member_name, where=where, key=key, given=values
        )
        report(np.isnan(values), NonFiniteError, "not a number", allowed="numbers; infinite without a limit")
        is_free = np.isneginf(values) & (key in ("least_tension", "buckling"))
        report((values < 0) & ~is_free, InvalidValueError, "a negative limit", allowed="0 or more")
    is_bad, problem = (
        limits.least_tension > limits.most_tension,
        "the least tension is above the largest tension",
    )
    report = partial(refuse, section="limits.members", names=structure.member_name, where=where)
    report(is_bad, InvalidValueError, problem, key="least_tension", given=limits.least_tension)
    for key in ("clearance", "least_stiffness"):
        value = getattr(limits, key)
        if np.isnan(value) or (value < 0 and not np.isneginf(value)) or np.isposinf(value):
            allowed = "0 or more, finite; -infinity without a limit"
            raise InvalidValueError("not a limit", where=f"{location}.{key}", given=value, allowed=allowed)
