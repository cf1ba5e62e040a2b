import math

import pytest

from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.scene.subject import assemble_scene
from tensegrity_codegen.system.errors import (
    InvalidNameError,
    InvalidValueError,
    NonFiniteError,
    SceneError,
    UnknownKeyError,
    UnknownNameError,
)

from .samples import ARCH, REMOVE, WHERE, changed


def refused_document(document):
    with pytest.raises(SceneError) as caught:
        parse_scene(document, WHERE)
    return caught.value


@pytest.mark.parametrize(
    ("path", "near"),
    [
        (("nodes", "c", "mas"), "mass"),
        (("classes", "string", "spring_konstant"), "spring_constant"),
        (("members", "ab", "clas"), "class"),
        (("grvity",), "gravity"),
        (("model", "quantitys"), "quantities"),
        (("parameters", "restlength"), "rest_length"),
        (("loads", 0, "forse"), "force"),
        (("inputs", 1, "node"), "nodes"),
        (("inputs", 0, "member"), "members"),
    ],
)
def test_unknown_key_names_the_place_and_the_close_key(path, near):
    error = refused_document(changed(*path, to=1))
    assert type(error) is UnknownKeyError
    assert error.where.startswith(f"{WHERE}: {path[0]}")
    assert error.where.endswith(str(path[-1]))
    assert error.given == path[-1]
    assert near in error.allowed.split(", ")
    assert repr(near) in error.hint


def test_unknown_key_of_a_shape_lists_the_keys_of_that_shape():
    error = refused_document(
        {"name": "x", "shape": {"kind": "prism", "bottom_radius": 1, "height": 1, "twists": 1}}
    )
    assert type(error) is UnknownKeyError
    assert error.where == f"{WHERE}: shape.twists"
    assert "'twist'" in error.hint


def test_misspelt_key_is_reported_before_the_key_that_is_missing_because_of_it():
    error = refused_document(changed("nodes", "c", to={"postion": [0, 0, 0]}))
    assert type(error) is UnknownKeyError
    assert "'position'" in error.hint
    assert "nodes.c.position" in error.hint


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    ("path", "place"),
    [
        (("nodes", "c", "mass"), "nodes.c.mass"),
        (("nodes", "c", "position", 1), "nodes.c.position[1]"),
        (("gravity", 2), "gravity[2]"),
        (("classes", "string", "spring_constant"), "classes.string.spring_constant"),
        (("classes", "string", "prestress"), "classes.string.prestress"),
        (("members", "ab", "rest_length"), "members.ab.rest_length"),
        (("members", "ac", "strain"), "members.ac.strain"),
        (("members", "ac", "damping"), "members.ac.damping"),
        (("loads", 0, "force", 0), "loads[0].force[0]"),
        (("inputs", 1, "direction", 2), "inputs[1].direction[2]"),
    ],
)
def test_nan_and_infinity_are_refused_everywhere(path, place, value):
    error = refused_document(changed(*path, to=value))
    assert type(error) is NonFiniteError
    assert error.where == f"{WHERE}: {place}"
    assert repr(error.given) == repr(value)


@pytest.mark.parametrize("value", [0, -1.5])
@pytest.mark.parametrize(
    "path",
    [
        ("nodes", "c", "mass"),
        ("classes", "strut", "mass"),
        ("classes", "strut", "axial_stiffness"),
        ("classes", "string", "spring_constant"),
        ("members", "ab", "rest_length"),
        ("members", "ac", "radius"),
        ("members", "ac", "density"),
    ],
)
def test_zero_and_negative_values_are_refused(path, value):
    error = refused_document(changed(*path, to=value))
    assert type(error) is InvalidValueError
    assert error.where == f"{WHERE}: {'.'.join(path)}"
    assert error.given == value
    assert "greater than 0" in error.allowed


def test_negative_damping_is_refused_and_zero_is_not():
    assert refused_document(changed("classes", "strut", "damping", to=-1)).given == -1
    assert parse_scene(changed("classes", "strut", "damping", to=0)).classes["strut"].damping == 0


@pytest.mark.parametrize("value", [True, "1", [1], {"a": 1}, 10**400, None])
def test_only_numbers_pass_as_numbers(value):
    document = changed("classes", "string", "spring_constant", to=value)
    if value is None:
        assert parse_scene(document).classes["string"].spring_constant is None
        return
    error = refused_document(document)
    assert type(error) is InvalidValueError
    assert "number" in error.allowed
    assert ("too large" in error.problem) == (value == 10**400)


@pytest.mark.parametrize("value", [1, 0, "yes", "zx", "", [True], "xyzz"])
def test_anchored_takes_truth_values_and_axes_only(value):
    error = refused_document(changed("nodes", "c", "anchored", to=value))
    assert type(error) is InvalidValueError
    assert error.where == f"{WHERE}: nodes.c.anchored"


@pytest.mark.parametrize("name", ["a;b", "../x", "a\nb", 'a"b', "a'b", "1a", "", "while", "x" * 64, "é"])
@pytest.mark.parametrize("section", ["nodes", "members", "classes", "groups", None])
def test_names_that_are_no_c_identifiers_are_refused(section, name):
    if section is None:
        error = refused_document(changed("name", to=name))
    else:
        value = next(iter(ARCH[section].values()))
        error = refused_document(changed(section, name, to=value))
        assert error.where.startswith(f"{WHERE}: {section}")
    assert type(error) is InvalidNameError
    assert error.given == name
    assert "letter" in error.allowed


def test_input_name_that_is_no_c_identifier():
    error = refused_document(changed("inputs", 0, "name", to="u 1"))
    assert type(error) is InvalidNameError
    assert error.where == f"{WHERE}: inputs[0].name"


@pytest.mark.parametrize(
    ("key", "value", "known"),
    [
        ("quantities", ["member_tensoin"], "member_tension"),
        ("integrators", ["rk5"], "rk4"),
        ("formulation", "node_positions", "node_position"),
        ("emitter", "rolled", "unrolled"),
        ("precision", "singel", "single"),
        ("precision", "float32", "double"),
        ("flags", "natve", "native"),
        ("flags", "-O3", "reference"),
    ],
)
def test_unknown_words_of_the_model_list_the_known_ones(key, value, known):
    error = refused_document(changed("model", key, to=value))
    assert type(error) is UnknownNameError
    assert f"model.{key}" in error.where
    assert known in error.allowed
    assert repr(known) in error.hint


@pytest.mark.parametrize(
    ("document", "place", "allowed"),
    [
        (changed("classes", "strut", "kind", to="rod"), "classes.strut.kind", "'bar' or 'cable'"),
        (changed("axes", to="zx"), "axes", "'xz'"),
        (changed("parameters", "gravity", to=["all"]), "parameters.gravity", "'all'"),
        (changed("parameters", "rest_length", to="ab"), "parameters.rest_length", "'all'"),
        (changed("inputs", 0, "kind", to="push"), "inputs[0].kind", "'force'"),
        (changed("inputs", 0, "kind", to=REMOVE), "inputs[0]", "force"),
        (changed("members", "ab", "nodes", to=["a"]), "members.ab.nodes", "at least 2"),
        (changed("groups", "strings", to=[]), "groups.strings", "at least 1"),
        (changed("nodes", "c", "position", to=REMOVE), "nodes.c.position", "[m]"),
        (changed("nodes", to=[1]), "nodes", "table"),
        (changed("loads", to={"a": 1}), "loads", "list"),
        (changed("members", "ac", "strain", to=-1), "members.ac.strain", "greater than -1"),
    ],
)
def test_other_wrong_values_name_place_and_range(document, place, allowed):
    error = refused_document(document)
    assert type(error) is InvalidValueError
    assert error.where == f"{WHERE}: {place}"
    assert allowed in error.allowed


@pytest.mark.parametrize("path", [("[key]",), ("nodes", "c", "[key]")])
def test_a_key_called_as_the_validator_marks_keys_is_an_unknown_key(path):
    error = refused_document(changed(*path, to=None))
    assert type(error) is UnknownKeyError
    assert error.given == "[key]"


def test_several_errors_report_the_first_and_list_five_others():
    nodes = {f"n{number}": {"position": [0, 0, 0], "mass": -1} for number in range(9)}
    error = refused_document(changed("nodes", to=nodes))
    assert error.where == f"{WHERE}: nodes.n0.mass"
    assert "8 more problems" in error.problem
    assert "nodes.n5.mass" in error.hint
    assert "nodes.n6.mass" not in error.hint
    assert "and 3 more" in error.hint


def test_a_deep_or_long_value_is_shown_short():
    deep = value = {}
    for _ in range(200):
        value["a"] = value = {}
    for wrong in (deep, list(range(10**6)), "x" * 10**6):
        error = refused_document(changed("nodes", "c", "mass", to=wrong))
        assert type(error) is InvalidValueError
        assert len(str(error)) < 500


@pytest.mark.parametrize(
    ("section", "entry", "hint"),
    [
        ("loads", {"node": "bar1.B", "force": [0, 0, 1]}, 'point = "body.point"'),
        (
            "inputs",
            {"kind": "force", "name": "u", "nodes": ["bar1.B"], "direction": [0, 0, 1]},
            'kind = "point_force" with points = ["body.point"]',
        ),
    ],
)
def test_points_of_bodies_where_nodes_are_named(section: str, entry: dict[str, object], hint: str) -> None:
    bodies: dict[str, object] = {"base": {"kind": "fixed", "points": {"o": [0, 0, 0]}}}
    bodies["bar1"] = {"kind": "bar", "length": 1.0, "mass": 1.0, "anchor": "base.o", "direction": [1, 0, 0]}
    tendons = {"t": {"points": ["base.o", "bar1.B"], "spring_constant": 1.0, "rest_length": 1.0}}
    scene = parse_scene({"name": "a", "bodies": bodies, "tendons": tendons, section: [entry]})
    with pytest.raises(InvalidValueError) as caught:
        assemble_scene(scene)
    assert hint in caught.value.hint
