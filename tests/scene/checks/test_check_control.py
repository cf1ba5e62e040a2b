"""Actuators, sensors and limits of structures that were not read from a scene."""

from dataclasses import replace

import numpy as np
import pytest

from tensegrity_codegen.scene.checks.check import check_structure
from tensegrity_codegen.structure.actuators import Actuator, Sensor
from tensegrity_codegen.structure.limits import Limits
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError, NonFiniteError
from tests.scene.samples import build, changed

STRUCTURE = build(changed("actuators", to=[{"name": "m", "members": ["ab"]}]))[0]


def test_a_structure_of_a_scene_is_sound():
    check_structure(STRUCTURE)
    check_structure(STRUCTURE.with_changes(limits=Limits(clearance=0.1)))


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"inputs": STRUCTURE.inputs[::-1]}, "actuators"),
        ({"inputs": ()}, "actuators"),
        ({"actuators": (Actuator("m", (1,)),)}, "actuators"),
        ({"actuators": (Actuator("m", (2,), rate=0.0),)}, "actuators[0].rate"),
        ({"actuators": (Actuator("m", (2,), rate=np.nan),)}, "actuators[0].rate"),
        ({"actuators": (Actuator("m", (2,), range=(0.1, np.inf)),)}, "actuators[0].range"),
        ({"actuators": (Actuator("m", (2,), range=(0.2, 0.1)),)}, "actuators[0].range"),
        ({"actuators": (Actuator("m", (2,), delay=np.inf),)}, "actuators[0].delay"),
        ({"sensors": (Sensor("member_length", (3,)),)}, "sensors[0]"),
        ({"sensors": (Sensor("member_length", ()),)}, "sensors[0]"),
        ({"sensors": (Sensor("length", (0,)),)}, "sensors[0]"),
        ({"sensors": (Sensor("node_position", (0,), noise=np.nan),)}, "sensors[0]"),
        ({"limits": Limits(clearance=np.nan)}, "limits.clearance"),
        ({"limits": Limits(least_stiffness=-1.0)}, "limits.least_stiffness"),
    ],
)
def test_wrong_values(change, key):
    with pytest.raises(InvalidValueError) as caught:
        check_structure(STRUCTURE.with_changes(**change))
    assert caught.value.where == f"structure: {key}"


@pytest.mark.parametrize(
    ("key", "value", "error"),
    [
        ("least_tension", [0.0, 0.0], InvalidValueError),
        ("least_tension", [0.0, np.nan, 0.0], NonFiniteError),
        ("least_tension", [0.0, -1.0, 0.0], InvalidValueError),
        ("least_tension", [0.0, np.inf, 0.0], InvalidValueError),
        ("most_tension", [np.inf, -np.inf, 1.0], InvalidValueError),
        ("buckling", [1, 1, 1], InvalidValueError),
    ],
)
def test_wrong_limits(key, value, error):
    limits = replace(STRUCTURE.limits, most_tension=np.full(3, 5.0))
    with pytest.raises(error, match=r"limits\."):
        check_structure(STRUCTURE.with_changes(limits=replace(limits, **{key: np.array(value)})))


def test_sensors_have_names_of_their_own():
    twice = (Sensor("member_length", (0,), name="s"), Sensor("member_tension", (0,), name="s"))
    with pytest.raises(DuplicateNameError):
        check_structure(STRUCTURE.with_changes(sensors=twice))
