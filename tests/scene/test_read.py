import math
import os
import time
import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tensegrity_codegen.errors import (
    DuplicateNameError,
    InvalidNameError,
    InvalidValueError,
    NonFiniteError,
    SceneError,
    SceneSyntaxError,
    StructureError,
    TensegrityError,
    UnknownKeyError,
    UnknownNameError,
)
from tensegrity_codegen.scene import read
from tensegrity_codegen.scene.read import parse_scene, read_document, read_scene

from .samples import ARCH, REMOVE, WHERE, changed

GOOD = """
name = "pair"
[classes.string]
kind = "cable"
spring_constant = 10
[nodes]
a = { position = [0, 0, 0], anchored = true }
b = { position = [1, 0, 0], mass = 1 }
[members]
m = { class = "string", nodes = ["a", "b"] }
"""


@pytest.fixture
def scene_file(tmp_path):
    def write(content):
        path = tmp_path / "pair.toml"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def refused(path):
    with pytest.raises(TensegrityError) as caught:
        read_scene(path)
    return caught.value


def test_reads_a_file(scene_file):
    scene = read_scene(scene_file(GOOD))
    assert scene.name == "pair"
    assert scene.nodes["a"].anchored is True
    assert scene.members["m"].nodes == ("a", "b")
    assert scene.members["m"].class_name == "string"
    assert scene.model.formulation == "node_position"
    assert scene == read_scene(str(scene_file(GOOD)))


def test_reads_windows_line_ends_and_a_byte_order_mark(scene_file):
    assert read_scene(scene_file(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())).name == "pair"


def test_a_file_that_is_not_there(tmp_path):
    error = refused(tmp_path / "none.toml")
    assert type(error) is SceneError
    assert "none.toml" in str(error)
    assert error.hint


def test_a_folder_and_a_path_with_a_null_character(tmp_path):
    assert type(refused(tmp_path)) is SceneError
    assert type(refused("a\0b.toml")) is SceneError


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root reads everything")
def test_a_file_without_permission(scene_file):
    path = scene_file(GOOD)
    path.chmod(0)
    assert "permission" in str(refused(path)).lower()


def test_not_utf8(scene_file):
    error = refused(scene_file(b'name = "x"\nb = "\xff"\n'))
    assert isinstance(error, SceneSyntaxError)
    assert "pair.toml: line 2" in str(error)
    assert "UTF-8" in str(error)


def test_too_large(scene_file, monkeypatch):
    path = scene_file(GOOD)
    monkeypatch.setattr(read, "LARGEST_FILE", len(GOOD) - 1)
    assert "too large" in str(refused(path))
    monkeypatch.setattr(read, "LARGEST_FILE", len(GOOD))
    assert read_scene(path).name == "pair"


def test_syntax_error_gives_line_and_text(scene_file):
    error = refused(scene_file(GOOD.replace("mass = 1 }", "mass = = 1 }")))
    assert isinstance(error, SceneSyntaxError)
    assert "line 8" in error.where
    assert "mass = = 1" in error.given


def test_syntax_error_at_the_end(scene_file):
    error = refused(scene_file("name = [\n\n"))
    assert isinstance(error, SceneSyntaxError)
    assert "line 1" in error.where
    assert error.given == "name = ["


@pytest.mark.parametrize(
    ("text", "name", "place"),
    [
        (GOOD.replace("b = {", "a = {"), "a", "line 8: nodes.a"),
        (GOOD.replace("[members]", "[nodes]"), "nodes", "line 9: nodes"),
        (GOOD.replace("mass = 1", "mass = 1, mass = 2"), "mass", "line 8: nodes.b.mass"),
        (GOOD + 'm = { class = "string", nodes = ["a", "b"] }', "m", "line 11: members.m"),
        ('name = "x"\nname = "y"', "name", "line 2: name"),
        (GOOD + "[nodes.a]\nmass = 2\n", "nodes.a", "line 11: nodes.a"),
    ],
)
def test_a_name_twice_is_a_duplicate_name(scene_file, text, name, place):
    error = refused(scene_file(text))
    assert isinstance(error, DuplicateNameError)
    assert error.given == name
    assert error.where.endswith(f"pair.toml: {place}")


RUBBISH = {
    "letters": b"a" * 10**7,
    "quotes": b'"' * 10**7,
    "brackets": b"[" * 10**7,
    "nested lists": b"name = " + b"[" * 10**7,
    "nested tables": b"nodes = " + b"{a=" * 10**6,
    "dotted key": b"nodes" + b".a" * (5 * 10**6) + b" = 1",
    "dotted header": b"[nodes" + b".a" * (5 * 10**6) + b"]",
    "quoted dotted key": b"nodes" + b" . 'a'" * 10**6 + b" = 1",
    "many keys": b"".join(b"x%d=1\n" % number for number in range(10**6)),
    "many numbers": b"name = [" + b"1," * (5 * 10**6) + b"]",
    "zero bytes": bytes(10**7),
    "bytes": bytes(range(256)) * 40_000,
    "long integer": b"name = " + b"1" * 10**7,
    "spaces": b"name" + b" " * 10**7,
    "comments": b"#" * 10**7,
    "dots": b"." * 10**7,
}


@pytest.mark.parametrize("kind", RUBBISH)
def test_ten_megabytes_of_rubbish_fail_fast_and_briefly(scene_file, kind):
    path = scene_file(RUBBISH[kind])
    start = time.process_time()
    error = refused(path)
    assert time.process_time() - start < 2
    assert isinstance(error, SceneError)
    assert "pair.toml" in str(error)
    assert len(str(error)) < 1000


def test_deep_nesting_is_a_syntax_error(scene_file):
    error = refused(scene_file("name = " + "[" * 5000 + "]" * 5000))
    assert isinstance(error, SceneSyntaxError)
    assert "deep" in str(error)


def test_a_first_key_that_no_scene_has_is_refused_with_a_suggestion(scene_file):
    error = refused(scene_file("# a comment\n\n[node]\n" + GOOD))
    assert isinstance(error, UnknownKeyError)
    assert error.where.endswith("pair.toml: node")
    assert "'nodes'" in error.hint


def test_read_document_leaves_foreign_keys_when_no_keys_are_known(scene_file):
    assert read_document(scene_file("foreign = 1")) == {"foreign": 1}


def test_an_empty_file_is_an_empty_scene(scene_file):
    assert isinstance(refused(scene_file("")), StructureError)
    assert isinstance(refused(scene_file("# nothing\n")), StructureError)


def test_a_document_that_is_no_table():
    with pytest.raises(InvalidValueError):
        parse_scene([1, 2], WHERE)  # type: ignore[arg-type]


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
        (changed("inputs", 0, "kind", to="torque"), "inputs[0]", "'force'"),
        (changed("inputs", 0, "kind", to=REMOVE), "inputs[0]", "force"),
        (changed("members", "ab", "nodes", to=["a"]), "members.ab.nodes", "at least 2"),
        (changed("members", "ab", "nodes", to=["a", "b", "c"]), "members.ab.nodes", "at most 2"),
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


def test_several_errors_report_the_first_and_list_five_others():
    nodes = {f"n{number}": {"position": [0, 0, 0], "mass": -1} for number in range(9)}
    error = refused_document(changed("nodes", to=nodes))
    assert error.where == f"{WHERE}: nodes.n0.mass"
    assert "8 more problems" in error.problem
    assert "nodes.n5.mass" in error.hint
    assert "nodes.n6.mass" not in error.hint
    assert "and 3 more" in error.hint


def test_documents_are_not_modified():
    document = changed("name", to="same")
    before = repr(document)
    parse_scene(document)
    assert repr(document) == before


def outcome(function, *arguments):
    """Return the function's result, or the SceneError that it raises."""
    try:
        return function(*arguments)
    except SceneError as error:
        return error


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)
KEYS = st.sampled_from(sorted(ARCH)) | st.text(max_size=5)


@settings(max_examples=150, deadline=None)
@given(st.dictionaries(KEYS, VALUES, max_size=4))
def test_any_document_is_a_scene_or_one_of_our_errors(document):
    error = outcome(parse_scene, {**ARCH, **document}, WHERE)
    assert not isinstance(error, SceneError) or error.where.startswith(WHERE)


@settings(max_examples=100, deadline=None)
@given(st.text(max_size=60))
def test_any_text_is_a_document_or_one_of_our_errors(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "any.toml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    result = outcome(read_document, path)
    if isinstance(result, SceneError):
        assert str(path) in result.where
    else:
        assert repr(result) == repr(tomllib.loads(path.read_bytes().decode("utf-8-sig")))
