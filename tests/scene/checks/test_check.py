from dataclasses import replace

import numpy as np
import pytest

from tensegrity_codegen.scene.checks.check import check_structure
from tensegrity_codegen.structure.actuators import Actuator, Sensor
from tensegrity_codegen.structure.limits import Limits
from tensegrity_codegen.structure.structure import ActuatedInput
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidNameError,
    InvalidValueError,
    NonFiniteError,
    StructureError,
)
from tests.scene.samples import ARCH, build, changed

STRUCTURE, _ = build(ARCH)

FLOATS = [
    "node_position",
    "node_velocity",
    "node_mass",
    "node_load",
    "gravity",
    "rest_length",
    "spring_constant",
    "axial_stiffness",
    "damping",
    "member_mass",
    "radius",
]


def refused(**changes):
    with pytest.raises(Exception) as caught:
        check_structure(STRUCTURE.with_changes(**changes), "mine")
    return caught.value


def with_value(key, value, row=0):
    array = np.array(getattr(STRUCTURE, key))
    array[row] = value
    return {key: array}


def test_a_sound_structure_passes():
    check_structure(STRUCTURE)


@pytest.mark.parametrize("key", [*FLOATS, "node_anchored", "is_bar", "tension_only", "connectivity"])
def test_wrong_shape_and_wrong_kind_of_number(key):
    array = getattr(STRUCTURE, key)
    for wrong in (array[:-1], array.astype(complex), array.astype(str)):
        error = refused(**{key: wrong})
        assert type(error) is InvalidValueError
        assert error.where == f"mine: {key}"
        assert str(array.shape) in error.allowed


def test_a_list_is_no_array():
    assert "list" in refused(node_mass=[1.0, 2.0, 3.0]).given


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("key", FLOATS)
def test_non_finite_numbers(key, value):
    error = refused(**with_value(key, value))
    assert type(error) is NonFiniteError
    assert error.where.startswith("mine: ")


@pytest.mark.parametrize(
    "key",
    ["node_mass", "spring_constant", "axial_stiffness", "damping", "member_mass", "radius", "rest_length"],
)
def test_negative_numbers(key):
    error = refused(**with_value(key, -1.0, row=1))
    assert type(error) is InvalidValueError
    assert error.given == -1.0
    owner = "nodes.b" if key == "node_mass" else "members.bc"
    assert error.where.startswith(f"mine: {owner}.")


@pytest.mark.parametrize("key", ["node_mass", "member_mass"])
def test_masses_that_nothing_can_be_divided_by(key):
    error = refused(**with_value(key, 1e-310, row=1))
    assert (type(error), error.given) == (InvalidValueError, 1e-310)
    assert error.allowed == "0, or 1e-250 kg and more"


def test_zero_rest_length():
    assert refused(**with_value("rest_length", 0.0)).where == "mine: members.ac.rest_length"


@pytest.mark.parametrize("pair", [(0, 3), (-1, 0)])
def test_node_index_out_of_range(pair):
    error = refused(**with_value("connectivity", pair))
    assert type(error) is InvalidValueError
    assert error.given == list(pair)
    assert error.allowed == "0 to 2"


def test_connectivity_is_checked():
    assert type(refused(**with_value("connectivity", (1, 1)))) is StructureError
    assert type(refused(**with_value("connectivity", (1, 2), row=0))) is DuplicateNameError


@pytest.mark.parametrize(
    ("key", "value", "row", "problem"),
    [
        ("spring_constant", 1.0, 0, "given twice"),
        ("spring_constant", 0.0, 1, "without stiffness"),
        ("tension_only", True, 0, "tension_only"),
    ],
)
def test_laws(key, value, row, problem):
    error = refused(**with_value(key, value, row))
    assert type(error) is InvalidValueError
    assert problem in error.problem


def test_names():
    assert type(refused(name="a b")) is InvalidNameError
    assert type(refused(node_name=("a", "b", "c;"))) is InvalidNameError
    assert type(refused(member_class=("strut", "string", "a b"))) is InvalidNameError
    assert type(refused(node_name=("a", "b", "a"))) is DuplicateNameError
    assert type(refused(member_name=("m", "m", "n"))) is DuplicateNameError
    assert type(refused(member_class=("strut",))) is InvalidValueError


@pytest.mark.parametrize("axes", [(), (1, 0), (0, 0), (3,), (0, 1, 2, 3)])
def test_axes(axes):
    assert refused(axes=axes).where == "mine: axes"


def test_free_nodes_velocity_and_plane():
    assert type(refused(node_anchored=np.ones((3, 3), dtype=bool))) is StructureError
    assert refused(**with_value("node_velocity", [1.0, 0, 0])).where == "mine: nodes.a.velocity"
    plane = {"axes": (0, 2), "inputs": ()}
    check_structure(STRUCTURE.with_changes(**plane))
    assert refused(**plane, **with_value("node_position", [0, 1.0, 0])).where.startswith("mine: nodes.")


@pytest.mark.parametrize("targets", [(), (3,), (-1,)])
def test_groups_and_inputs_point_into_the_structure(targets):
    assert refused(groups={"g": targets}).where == "mine: groups.g"
    for kind in ("rest_length", "force"):
        error = refused(inputs=(ActuatedInput("u", kind, targets, (1.0, 0.0, 0.0)),))
        assert type(error) is InvalidValueError
        assert error.where == "mine: inputs[0]"


@pytest.mark.parametrize("direction", [(0.0, 0.0, 0.0), (1.0, 1.0, 0.0), (np.nan, 0.0, 0.0), (1.0, 0.0)])
def test_directions_are_unit_vectors(direction):
    error = refused(inputs=(ActuatedInput("u", "force", (2,), direction),))
    assert isinstance(error, InvalidValueError)


def test_inputs_of_an_unknown_kind_or_with_one_name():
    assert "kind" in refused(inputs=(ActuatedInput("u", "torque", (0,)),)).problem
    one = ActuatedInput("u", "rest_length", (0,))
    assert type(refused(inputs=(one, one))) is DuplicateNameError


def test_inputs_on_rigid_bars():
    rigid = with_value("axial_stiffness", 0.0) | with_value("rest_length", STRUCTURE.member_length()[0])
    check_structure(STRUCTURE.with_changes(**rigid))
    error = refused(**rigid, inputs=(ActuatedInput("u", "rest_length", (0,)),))
    assert "rigid" in error.problem


def test_the_structure_is_not_modified():
    before = STRUCTURE.node_position.copy()
    check_structure(STRUCTURE)
    np.testing.assert_array_equal(STRUCTURE.node_position, before)


CONTROLLED = build(changed("actuators", to=[{"name": "m", "members": ["ab"]}]))[0]


def test_a_structure_of_a_scene_is_sound():
    check_structure(CONTROLLED)
    check_structure(CONTROLLED.with_changes(limits=Limits(clearance=0.1)))


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"inputs": CONTROLLED.inputs[::-1]}, "actuators"),
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
        check_structure(CONTROLLED.with_changes(**change))
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
    limits = replace(CONTROLLED.limits, most_tension=np.full(3, 5.0))
    with pytest.raises(error, match=r"limits\."):
        check_structure(CONTROLLED.with_changes(limits=replace(limits, **{key: np.array(value)})))


def test_sensors_have_names_of_their_own():
    twice = (Sensor("member_length", (0,), name="s"), Sensor("member_tension", (0,), name="s"))
    with pytest.raises(DuplicateNameError):
        check_structure(CONTROLLED.with_changes(sensors=twice))
