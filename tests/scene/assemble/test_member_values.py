import math

import pytest

from tensegrity_codegen.scene.assemble.member_values import resolve_values
from tensegrity_codegen.scene.schema.part_schema import Member, MemberClass
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError

CLASSES = {
    "strut": MemberClass(kind="bar", mass=2.0, axial_stiffness=5.0),
    "string": MemberClass(kind="cable", spring_constant=3.0, prestress=1.0, damping=0.5),
}


def member(**values):
    return Member.model_validate({"nodes": ["a", "b"], **values})


def test_members_inherit_what_they_do_not_state():
    members = {
        "one": member(**{"class": "string"}),
        "two": member(**{"class": "string", "strain": 0.1, "damping": 0}),
        "three": member(**{"class": "strut", "density": 7}),
        "four": member(kind="cable", spring_constant=1),
    }
    values, is_bar, tension_only = resolve_values(CLASSES, members, "f")
    assert is_bar.tolist() == [False, False, True, False]
    assert tension_only.tolist() == [True, True, False, True]
    expected = {
        "spring_constant": [3, 3, None, 1],
        "axial_stiffness": [None, None, 5, None],
        "prestress": [1, None, None, None],
        "strain": [None, 0.1, None, None],
        "damping": [0.5, 0, None, None],
        "mass": [None, None, None, None],
        "density": [None, None, 7, None],
    }
    for key, row in expected.items():
        assert [None if math.isnan(value) else value for value in values[key]] == row, key


def test_no_members():
    values, is_bar, tension_only = resolve_values(CLASSES, {}, "f")
    assert {len(column) for column in values.values()} == {0}
    assert is_bar.shape == tension_only.shape == (0,)


def test_classes_are_checked_even_where_no_member_uses_them():
    with pytest.raises(InvalidValueError) as caught:
        resolve_values({"spare": MemberClass(kind="cable", spring_constant=1, density=1)}, {}, "f")
    assert caught.value.where == "f: classes.spare.density"


def test_unknown_class():
    with pytest.raises(UnknownNameError, match="not defined"):
        resolve_values(CLASSES, {"m": member(**{"class": "rope"})}, "f")
