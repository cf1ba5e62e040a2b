"""Checks of the actuators, sensors and limits of a structure, for those who build one themselves."""

from functools import partial

import numpy as np

from tensegrity_codegen.scene.names import check_names, key_path
from tensegrity_codegen.scene.refuse import refuse
from tensegrity_codegen.structure.actuators import MEMBER_SENSORS, NODE_SENSORS, UNLIMITED, Actuator
from tensegrity_codegen.structure.limits import MEMBER_LIMITS
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError


def check_control(structure: Structure, where: str) -> None:
    """Raise unless the actuators are the last inputs and have sound values, and so have sensors and limits.

    Raises InvalidValueError, NonFiniteError or DuplicateNameError, with `where` and the key.
    """
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
        valid_kinds = (*MEMBER_SENSORS, *NODE_SENSORS)
        if sensor.kind not in valid_kinds:
            problem, allowed = "unknown kind of sensor", ", ".join(valid_kinds)
            raise InvalidValueError(problem, where=location, given=sensor.kind, allowed=allowed)
        size = structure.n_members if sensor.kind in MEMBER_SENSORS else structure.n_nodes
        check_indices(sensor.targets, size, location)
        if not 0 <= sensor.noise < np.inf:
            problem = "not a standard deviation"
            raise InvalidValueError(problem, where=location, given=sensor.noise, allowed="0 or more, finite")
    _check_limits(structure, where)


def check_indices(indices: tuple[int, ...], size: int, place: str) -> None:
    """Raise InvalidValueError for no index at all, or one that is not from 0 to size - 1."""
    if not indices or min(indices) < 0 or max(indices) >= size:
        problem = "empty, or an index out of range"
        raise InvalidValueError(problem, where=place, given=indices, allowed=f"0 to {size - 1}")


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
    refuse(
        limits.least_tension > limits.most_tension,
        InvalidValueError,
        "the least tension is above the largest tension",
        section="limits.members",
        names=structure.member_name,
        where=where,
        key="least_tension",
        given=limits.least_tension,
    )
    for key in ("clearance", "least_stiffness"):
        value = getattr(limits, key)
        if np.isnan(value) or (value < 0 and not np.isneginf(value)) or np.isposinf(value):
            allowed = "0 or more, finite; -infinity without a limit"
            raise InvalidValueError("not a limit", where=f"{location}.{key}", given=value, allowed=allowed)
