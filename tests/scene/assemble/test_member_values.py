import math
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.assemble.member_values import list_catalogue, resolve_values
from tensegrity_codegen.scene.read import read_scene
from tensegrity_codegen.scene.schema.part_schema import Member, MemberClass
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import InvalidValueError, SceneError, UnknownNameError

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


def make(strut: dict[str, Any], own: dict[str, Any] | None = None) -> Structure:
    """Return a bar of 2 m with a class `strut` and values of its own, beside a rope."""
    document = {
        "name": "bar",
        "classes": {"strut": {"kind": "bar"} | strut},
        "nodes": {"a": {"position": [0, 0, 0], "anchored": True}, "b": {"position": [2, 0, 0], "mass": 1.0}},
        "members": {"ab": {"class": "strut", "nodes": ["a", "b"]} | (own or {})},
    }
    return assemble(read_scene(document))[0]


@pytest.mark.parametrize("section", ["CHS 60.3x3.2", "CHS60.3x3.2", {"tube": [0.0603, 0.0032]}])
def test_a_tube_by_name_or_size(section: Any) -> None:
    """CHS 60.3x3.2: A = 5.74 cm2, I = 23.5 cm4, 4.51 kg/m (EN 10210-2, Annex B)."""
    bar = make({"section": section, "youngs_modulus": 210e9, "density": 7850.0})
    area = float(bar.section_area[0])
    assert round(area * 1e4, 2) == 5.74
    assert round(area * float(bar.gyration_square[0]) * 1e8, 1) == 23.5
    assert round(float(bar.member_mass[0]) / 2.0, 2) == 4.51
    np.testing.assert_allclose(bar.axial_stiffness, 210e9 * area, rtol=1e-15)


def test_a_rod_and_a_section_of_its_own() -> None:
    rod = make({"section": {"tube": [0.06, 0.003]}, "youngs_modulus": 1e9}, {"section": {"rod": 0.02}})
    np.testing.assert_allclose(rod.section_area, np.pi * 0.01**2, rtol=1e-15)
    assert rod.inner_radius is None
    np.testing.assert_allclose(rod.axial_stiffness, 1e9 * np.pi * 0.01**2, rtol=1e-15)


def test_own_stiffness_replaces_the_modulus_of_the_class() -> None:
    bar = make({"radius": 0.01, "youngs_modulus": 1e9}, {"axial_stiffness": 5.0})
    assert bar.axial_stiffness.tolist() == [5.0]


def test_the_catalogue_names_what_is_made() -> None:
    names = list_catalogue()
    assert len(names) == len(set(names))
    assert {"CHS 21.3x2.3", "CHS 114.3x6.3", "CHS 508x50"} <= set(names)
    assert not {"CHS 21.3x4", "CHS 88.9x8", "CHS 60.3x3.3"} & set(names)


@pytest.mark.parametrize(
    ("strut", "words"),
    [
        ({"section": "CHS 60.3x3.3"}, "no section of that name"),
        ({"section": "IPE 200"}, "no section of that name"),
        ({"section": {"tube": [0.06, 0.03]}}, "as thick as its radius"),
        ({"section": {"rod": 0.02}, "radius": 0.01}, "cannot be given together"),
        ({"youngs_modulus": 210e9}, "without a section"),
        ({"youngs_modulus": 210e9, "radius": 0.01, "axial_stiffness": 1.0}, "cannot be given together"),
    ],
)
def test_wrong_sections_are_named(strut: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidValueError, match=words):
        make(strut)


@pytest.mark.parametrize(
    "section", [{}, {"tube": [0.06]}, {"tube": [0.06, 0.003], "rod": 0.02}, {"rod": -1.0}, 5]
)
def test_malformed_sections_are_refused(section: Any) -> None:
    with pytest.raises(SceneError) as caught:
        make({"section": section})
    assert "section" in str(caught.value)


def test_a_cable_may_be_a_rod_and_no_tube() -> None:
    document: dict[str, Any] = {
        "name": "rope",
        "nodes": {"a": {"position": [0, 0, 0], "anchored": True}, "b": {"position": [2, 0, 0], "mass": 1.0}},
        "members": {
            "ab": {"kind": "cable", "nodes": ["a", "b"], "section": {"rod": 0.01}, "youngs_modulus": 165e9}
        },
    }
    rope = assemble(read_scene(document))[0]
    np.testing.assert_allclose(rope.axial_stiffness, 165e9 * np.pi * 0.005**2, rtol=1e-15)
    document["members"]["ab"]["section"] = {"tube": [0.01, 0.001]}
    with pytest.raises(InvalidValueError, match="a cable has no inner_radius"):
        assemble(read_scene(document))
