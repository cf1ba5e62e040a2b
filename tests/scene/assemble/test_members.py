import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegrity_codegen.scene.assemble.members import compute_rest_length, spread_vectors
from tensegrity_codegen.system.errors import InvalidValueError, StructureError, UnknownNameError
from tests.scene.samples import REMOVE, WHERE, build, changed

PLACES = [("nodes", "a", "position"), ("nodes", "b", "position")]


def test_vectors_are_spread_over_the_modelled_axes():
    table = spread_vectors([(1.0, 2.0, 3.0), None], (0, 1, 2), PLACES, "")
    assert table.tolist() == [[1, 2, 3], [0, 0, 0]]
    table = spread_vectors([(1.0, 2.0), (3.0, 4.0, 5.0)], (0, 2), PLACES, "")
    assert table.tolist() == [[1, 0, 2], [3, 4, 5]]
    assert spread_vectors([], (0,), [], "").shape == (0, 3)


@pytest.mark.parametrize(("axes", "allowed"), [((0, 1, 2), "3 numbers"), ((0, 2), "3 or 2 numbers")])
def test_a_vector_of_the_wrong_size(axes, allowed):
    with pytest.raises(InvalidValueError) as caught:
        spread_vectors([(1.0, 2.0, 3.0), (1.0,)], axes, PLACES, WHERE)
    assert caught.value.where == f"{WHERE}: nodes.b.position"
    assert caught.value.given == [1.0]
    assert caught.value.allowed == allowed


def test_anchors_and_masses():
    structure, _ = build(changed("loads", to=[]))
    assert structure.node_anchored.tolist() == [[True] * 3, [True, False, True], [False] * 3]
    assert structure.node_mass.tolist() == [0, 0, 0.5]


def test_loads_on_one_node_add_up():
    loads = [{"node": "c", "force": [1, 0, 0]}, {"node": "c", "force": [1, 2, 0]}]
    structure, _ = build(changed("loads", to=loads))
    np.testing.assert_array_equal(structure.node_load, [[0, 0, 0], [0, 0, 0], [2, 2, 0]])


@pytest.mark.parametrize("nodes", ["[bc]", ["c", "b"], ["*", "[!a]"]])
def test_a_load_on_each_node_of_a_pattern_or_list(nodes):
    every = nodes == ["*", "[!a]"]
    structure, _ = build(changed("loads", to=[{"node": nodes, "force": [1, 2, 0]}]))
    np.testing.assert_array_equal(structure.node_load, [[every, 2 * every, 0], [1, 2, 0], [1, 2, 0]])


@pytest.mark.parametrize(("nodes", "given"), [("d*", "d*"), (["c", "cc"], "cc")])
def test_a_load_on_no_node_at_all(nodes, given):
    with pytest.raises(UnknownNameError) as caught:
        build(changed("loads", 0, "node", to=nodes))
    assert (caught.value.where, caught.value.given) == (f"{WHERE}: loads[0].node", given)
    assert "'c'" in caught.value.hint


def test_a_load_on_an_unknown_node():
    with pytest.raises(UnknownNameError) as caught:
        build(changed("loads", 0, "node", to="cc"))
    assert caught.value.where == f"{WHERE}: loads[0].node"
    assert caught.value.given == "cc"
    assert "'c'" in caught.value.hint


def test_anchored_on_an_axis_that_is_not_modelled():
    document = changed("axes", to="xz")
    document["nodes"]["b"]["anchored"] = "yz"
    with pytest.raises(InvalidValueError) as caught:
        build(document)
    assert caught.value.where == f"{WHERE}: nodes.b.anchored"
    assert caught.value.given == "yz"
    assert "'xz'" in caught.value.allowed


POSITIVE = st.floats(1e-3, 1e6)


def value(structure, key, member):
    return getattr(structure, key)[structure.member_name.index(member)]


@given(POSITIVE, POSITIVE, st.floats(-0.9, 0.9))
def test_spring_law_gives_the_prestress_back(length, constant, part):
    tension = part * constant * length
    rest = compute_rest_length(*(np.array([x]) for x in (length, tension, constant, 0.0)))
    assert rest[0] > 0
    assert constant * (length - rest[0]) == pytest.approx(tension, abs=1e-12 * constant * length)


@given(POSITIVE, POSITIVE, st.floats(-0.9, 10))
def test_axial_law_gives_the_prestress_back(length, stiffness, part):
    tension = part * stiffness
    rest = compute_rest_length(*(np.array([x]) for x in (length, tension, 0.0, stiffness)))
    assert rest[0] > 0
    assert stiffness * (length - rest[0]) / rest[0] == pytest.approx(tension, abs=1e-11 * stiffness)


@given(POSITIVE, POSITIVE, st.floats(0, 10), st.booleans())
def test_scene_prestress_becomes_tension(length, stiffness, part, axial):
    key = "axial_stiffness" if axial else "spring_constant"
    tension = part * stiffness if axial else part / 10.1 * stiffness * length
    structure, _ = build(
        {
            "name": "pair",
            "nodes": {
                "a": {"position": [0, 0, 0], "anchored": True},
                "b": {"position": [length, 0, 0], "mass": 1},
            },
            "members": {"m": {"kind": "cable", key: stiffness, "prestress": tension, "nodes": ["a", "b"]}},
        }
    )
    spring = structure.spring_constant + structure.axial_stiffness / structure.rest_length
    got = spring * (structure.member_length() - structure.rest_length)
    assert got[0] == pytest.approx(tension, rel=1e-9, abs=1e-9 * stiffness)


def test_without_rest_length_prestress_or_strain_a_member_starts_without_tension():
    structure, _ = build(changed("classes", "string", "prestress", to=REMOVE))
    length = dict(zip(structure.member_name, structure.member_length(), strict=True))
    assert value(structure, "rest_length", "bc") == length["bc"]
    assert value(structure, "rest_length", "ac") == length["ac"]


def test_strain_is_relative_to_the_rest_length():
    structure, _ = build(changed("members", "bc", "strain", to=0.25))
    length = math.dist((2, 0, 0), (1, 0, 1.5))
    assert value(structure, "rest_length", "bc") == pytest.approx(length / 1.25)


def test_own_value_replaces_the_whole_choice_of_the_class():
    structure, _ = build(changed("members", "bc", "axial_stiffness", to=500.0))
    assert value(structure, "axial_stiffness", "bc") == 500
    assert value(structure, "spring_constant", "bc") == 0
    assert value(structure, "spring_constant", "ab") == 100
    assert value(structure, "rest_length", "ab") == 1.5


def test_own_density_replaces_the_mass_of_the_class():
    document = changed("members", "ac", "density", to=1800)
    document["members"]["ac"] |= {"radius": 0.004, "inner_radius": 0.003}
    structure, _ = build(document)
    length = math.dist((0, 0, 0), (1, 0, 1.5))
    expected = 1800 * math.pi * (0.004**2 - 0.003**2) * length
    assert value(structure, "member_mass", "ac") == pytest.approx(expected)
    assert value(structure, "radius", "ac") == 0.004
    assert value(structure, "member_mass", "bc") == 0


def test_kinds_and_slack():
    document = changed("members", "ab", "tension_only", to=False)
    structure, _ = build(document)
    assert structure.is_bar.tolist() == [True, False, False]
    assert structure.tension_only.tolist() == [False, True, False]
    document["classes"]["string"]["tension_only"] = False
    document["members"]["ab"]["tension_only"] = True
    assert build(document)[0].tension_only.tolist() == [False, False, True]


def test_member_without_class():
    document = changed("members", "ab", to={"kind": "bar", "spring_constant": 7, "nodes": ["a", "b"]})
    structure, _ = build(document)
    assert structure.member_class == ("strut", "string", "")
    assert structure.is_bar.tolist() == [True, False, True]
    assert value(structure, "spring_constant", "ab") == 7


def test_bar_without_stiffness_is_rigid():
    structure, _ = build(changed("classes", "strut", "axial_stiffness", to=REMOVE))
    assert structure.is_rigid.tolist() == [True, False, False]
    assert value(structure, "rest_length", "ac") == structure.member_length()[0]


def refused(document):
    with pytest.raises(Exception) as caught:
        build(document)
    return caught.value


def test_misspelt_class():
    error = refused(changed("members", "ab", "class", to="strnig"))
    assert type(error) is UnknownNameError
    assert error.where == f"{WHERE}: members.ab.class"
    assert error.given == "strnig"
    assert "'string'" in error.hint


def test_node_used_but_not_defined():
    error = refused(changed("members", "ab", "nodes", to=["a", "bb"]))
    assert type(error) is UnknownNameError
    assert error.where == f"{WHERE}: members.ab.nodes"
    assert error.given == "bb"
    assert "'b'" in error.hint


@pytest.mark.parametrize(
    ("path", "value", "place", "given", "allowed"),
    [
        (
            "classes.string.axial_stiffness",
            3.0,
            "classes.string",
            {"spring_constant": 100.0, "axial_stiffness": 3.0},
            "at most one",
        ),
        (
            "classes.string.rest_length",
            3.0,
            "classes.string",
            {"rest_length": 3.0, "prestress": 10.0},
            "at most one",
        ),
        ("members.ab.strain", 0.1, "members.ab", {"rest_length": 1.5, "strain": 0.1}, "at most one"),
        ("classes.strut.density", 3.0, "classes.strut", {"mass": 0.1, "density": 3.0}, "at most one"),
        ("classes.string.spring_constant", REMOVE, "members.bc", None, "axial_stiffness [N]"),
        ("classes.strut.tension_only", True, "", True, "cables"),
        ("members.ac.tension_only", True, "", True, "cables"),
        ("classes.string.density", 1.0, "", 1.0, "bars"),
        ("members.bc.density", 1.0, "", 1.0, "bars"),
        ("classes.strut.mass_per_length", 1.0, "", 1.0, "cables"),
        ("members.ac.segments", 2, "", 2.0, "cables"),
        ("members.bc.segments", 2, "", 2, "mass_per_length"),
        ("members.ac.density", 1.0, "", 1.0, "radius"),
        ("members.ac.inner_radius", 1.0, "", 1.0, "less than radius"),
        ("members.ac.kind", "bar", "", "bar", "either class or kind"),
        ("members.ac.class", REMOVE, "members.ac", None, "either class or kind"),
        ("members.bc.prestress", -1.0, "", -1.0, "0 or more"),
        ("members.bc.prestress", 1000.0, "", 1000.0, "= 180.278 N"),
        ("members.ac.prestress", -300000.0, "", -300000.0, "-200000 N"),
    ],
)
def test_values_that_do_not_go_together(path, value, place, given, allowed):
    """The place is that of the changed key where none is stated."""
    error = refused(changed(*path.split("."), to=value))
    assert type(error) is InvalidValueError
    assert error.where == f"{WHERE}: {place or path}"
    assert error.given == given
    assert allowed in error.allowed


@pytest.mark.parametrize("key", ["prestress", "strain"])
def test_a_rigid_bar_has_no_prestress(key):
    document = changed("classes", "strut", "axial_stiffness", to=REMOVE)
    document["members"]["ac"][key] = 0.5
    error = refused(document)
    assert type(error) is InvalidValueError
    assert error.where == f"{WHERE}: members.ac.{key}"


def test_a_rigid_bar_has_the_rest_length_of_its_nodes():
    document = changed("classes", "strut", "axial_stiffness", to=REMOVE)
    document["members"]["ac"]["rest_length"] = math.dist((0, 0, 0), (1, 0, 1.5))
    build(document)
    document["members"]["ac"]["rest_length"] = 1.0
    error = refused(document)
    assert type(error) is StructureError
    assert error.where == f"{WHERE}: members.ac.rest_length"
    assert error.given == 1.0


def test_bad_members_are_counted():
    document = changed("classes", "string", "spring_constant", to=REMOVE)
    assert "(also in ab)" in refused(document).problem
