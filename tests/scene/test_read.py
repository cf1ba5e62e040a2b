import os
import random
import time
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tensegrity_codegen.scene import read
from tensegrity_codegen.scene.read import cut_plain_sections, parse_scene, read_document, read_scene
from tensegrity_codegen.scene.toml_text import format_scene
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    SceneError,
    SceneSyntaxError,
    StructureError,
    TensegrityError,
    UnknownKeyError,
)
from tests.cases import thorough

from .samples import ARCH, WHERE, changed

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
    monkeypatch.setattr(read, "MAX_FILE_BYTES", len(GOOD) - 1)
    assert "too large" in str(refused(path))
    monkeypatch.setattr(read, "MAX_FILE_BYTES", len(GOOD))
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


# Functions, so that no other test waits for ten megabytes or keeps them.
RUBBISH = {
    "letters": lambda: b"a" * 10**7,
    "quotes": lambda: b'"' * 10**7,
    "brackets": lambda: b"[" * 10**7,
    "nested lists": lambda: b"name = " + b"[" * 10**7,
    "nested tables": lambda: b"nodes = " + b"{a=" * 10**6,
    "dotted key": lambda: b"nodes" + b".a" * (5 * 10**6) + b" = 1",
    "dotted header": lambda: b"[nodes" + b".a" * (5 * 10**6) + b"]",
    "quoted dotted key": lambda: b"nodes" + b" . 'a'" * 10**6 + b" = 1",
    "many keys": lambda: b"".join(b"x%d=1\n" % number for number in range(10**6)),
    "many numbers": lambda: b"name = [" + b"1," * (5 * 10**6) + b"]",
    "zero bytes": lambda: bytes(10**7),
    "bytes": lambda: bytes(range(256)) * 40_000,
    "long integer": lambda: b"name = " + b"1" * 10**7,
    "spaces": lambda: b"name" + b" " * 10**7,
    "comments": lambda: b"#" * 10**7,
    "dots": lambda: b"." * 10**7,
}


QUICK = ("nested lists", "bytes")


@pytest.mark.parametrize("kind", [*QUICK, *thorough(*(kind for kind in RUBBISH if kind not in QUICK))])
def test_ten_megabytes_of_rubbish_fail_fast_and_briefly(scene_file, kind):
    path = scene_file(RUBBISH[kind]())
    start = time.process_time()
    error = refused(path)
    assert time.process_time() - start < 20
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


@settings(max_examples=50, deadline=None)
@given(st.dictionaries(KEYS, VALUES, max_size=4))
def test_any_document_is_a_scene_or_one_of_our_errors(document):
    error = outcome(parse_scene, {**ARCH, **document}, WHERE)
    assert not isinstance(error, SceneError) or error.where.startswith(WHERE)


@settings(max_examples=50, deadline=None)
@given(st.text(max_size=60))
def test_any_text_is_a_document_or_one_of_our_errors(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "any.toml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    result = outcome(read_document, path)
    if isinstance(result, SceneError):
        assert str(path) in result.where
    else:
        assert repr(result) == repr(tomllib.loads(path.read_bytes().decode("utf-8-sig")))


EXAMPLES = sorted(Path(read.__file__).parent.joinpath("examples").glob("*.toml"))
NODES = {f"n{k}": {"position": [0.1 * k, -1e-7 * k, k], "mass": 0.5, "anchored": k == 0} for k in range(9)}
MEMBERS = {
    f"m{k}": {"kind": "cable", "nodes": [f"n{k}", f"n{k + 1}"], "spring_constant": 1e5} for k in range(8)
}


@pytest.fixture(autouse=True)
def short_files_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(read, "MIN_PLAIN_LENGTH", 0)


def parsed_outcome(text: str, path: Path) -> Any:
    """What reading a file gives: the document, or the error's class and text."""
    path.write_text(text, encoding="utf-8", newline="")
    try:
        return repr(read_document(path))
    except SceneError as error:
        return type(error), str(error)


def same_as_toml(text: str, path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    fast = parsed_outcome(text, path)
    with monkeypatch.context() as patch:
        patch.setattr(read, "MIN_PLAIN_LENGTH", 10**9)
        assert fast == parsed_outcome(text, path)
    return fast


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_read_the_same(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    same_as_toml(path.read_text(encoding="utf-8"), tmp_path / "a.toml", monkeypatch)


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_a_written_scene_has_plain_sections(
    newline: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    document = {"name": "s", "nodes": NODES, "members": MEMBERS, "groups": {"all": ["m0", "m1"]}}
    text = format_scene(document).replace("\n", newline)
    rest, found = cut_plain_sections(text)
    assert found == {"nodes": NODES, "members": MEMBERS}
    assert "n0" not in rest
    assert rest.count("\n") == text.count("\n")
    assert same_as_toml(text, tmp_path / "a.toml", monkeypatch) == repr(document)


def test_a_short_file_is_left_to_the_toml_reader(monkeypatch: pytest.MonkeyPatch) -> None:
    text = format_scene({"name": "s", "nodes": NODES})
    monkeypatch.setattr(read, "MIN_PLAIN_LENGTH", len(text) + 1)
    assert cut_plain_sections(text) == (text, {})


LINE = "a = { position = [0, 1.5, -2e3], mass = 1 }\n"
ODD = {
    "twice a name": f"[nodes]\n{LINE}{LINE}",
    "twice a key": "[nodes]\na = { mass = 1, mass = 2 }\n",
    "twice the section": f"[nodes]\n{LINE}[nodes]\nb = {{ mass = 1 }}\n",
    "a table below": f"[nodes]\n{LINE}[nodes.b]\nmass = 1\n",
    "a table below, before": f"[nodes.b]\nmass = 1\n[nodes]\n{LINE}",
    "a table of the same name": f"[nodes]\n{LINE}[nodes.a]\nmass = 1\n",
    "dotted at the top": f"nodes.b.mass = 1\n[nodes]\n{LINE}",
    "inline at the top": f"nodes = {{}}\n[nodes]\n{LINE}",
    "an array of tables": f"[[nodes]]\nmass = 1\n[nodes]\n{LINE}",
    "inside a list": f"x = [\n[nodes]\n{LINE}[1]\n]\n",
    "inside a long text": f'x = """\n[nodes]\n{LINE}"""\n',
    "inside a long literal": f"x = '''\n[nodes]\n{LINE}'''\n",
    "a comment": f"[nodes]\n{LINE}# text\nb = {{ mass = 1 }} # more\n",
    "blank lines": f"[nodes]\n\n{LINE}  \n\t\n\nb = {{ mass = 1 }}\n\n[x]\ny = 1\n",
    "no newline at the end": f"[nodes]\n{LINE}b = {{ mass = 1 }}",
    "a quoted name": f'[nodes]\n{LINE}"b c" = {{ mass = 1 }}\n',
    "a text with an equals sign": '[nodes]\na = { b = "c = 1", d = 2 }\n',
    "a text with a brace": '[nodes]\na = { b = "}, c", d = 2 }\n',
    "a text with an escape": '[nodes]\na = { b = "\\u0041" }\n',
    "a literal": "[nodes]\na = { b = 'c' }\n",
    "a date": "[nodes]\na = { b = 1979-05-27 }\n",
    "numbers of TOML alone": "[nodes]\na = { b = 1_000, c = 0x10, d = +1, e = inf }\n",
    "zeros": "[nodes]\na = { b = -0, c = -0.0, d = 0e0, e = 0 }\n",
    "a leading zero": "[nodes]\na = { b = 01 }\n",
    "a lone point": "[nodes]\na = { b = 1. }\n",
    "digits of another script": "[nodes]\na = { b = ١ }\n",
    "a huge number": "[nodes]\na = { b = 1e999, c = 123456789012345678901234567890 }\n",
    "a number too long": f"[nodes]\na = {{ b = {'1' * 1200} }}\n",
    "a list too long": f"[nodes]\na = {{ b = [{'1, ' * 1100}1] }}\n",
    "a list in a list": "[nodes]\na = { b = [[1, 2], [3]] }\n",
    "a comma at the end": "[nodes]\na = { b = [1, 2, ], c = 1 }\n",
    "a comma at the end of a table": "[nodes]\na = { b = 1, }\n",
    "an empty table": "[nodes]\na = {}\n[members]\nm = { kind = \"bar\" }\n",
    "a dotted key": "[nodes]\na = { b.c = 1 }\na.d = 2\n",
    "an error after it": f"[nodes]\n{LINE}\n[model]\nx = = 1\n",
    "an error in it": f"[nodes]\n{LINE}b = {{ mass = }}\n",
    "an unknown word": f"[nodes]\n{LINE}b = {{ mass = True }}\n",
    "digits for names": "[nodes]\n1 = { b = 1 }\n-2 = { true = false }\n",
    "spaces around the header": f"[ nodes ]\n{LINE}",
    "spaces before the header": f"  [nodes]\n{LINE}",
    "nothing else": "[nodes]\n",
    "a vertical tab": "[nodes]\na = { b = 1 }\x0b\nc = { d = 1 }\n",
    "a carriage return alone": "[nodes]\na = { b = 1 }\rc = { d = 1 }\n",
}  # fmt: skip


@pytest.mark.parametrize("text", ODD.values(), ids=ODD)
def test_odd_files_read_as_toml_says(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    same_as_toml(text, tmp_path / "a.toml", monkeypatch)
    same_as_toml(f'name = "s"\n{text}', tmp_path / "a.toml", monkeypatch)


@pytest.mark.thorough
def test_mangled_files_read_as_toml_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = format_scene(
        {"name": "s", "nodes": dict(list(NODES.items())[:3]), "members": {"m": MEMBERS["m0"]}}
    )
    tomllib.loads(text)
    letters = random.Random(4)
    valid = 0
    for _ in range(1500):
        mangled = list(text)
        for _ in range(letters.randint(1, 2)):
            place = letters.randrange(len(mangled))
            mangled[place] = letters.choice(["", mangled[place] * 2, letters.choice('[]{}=,." \n#-_0e\\xt')])
        found = same_as_toml("".join(mangled), tmp_path / "a.toml", monkeypatch)
        valid += isinstance(found, str)
    assert 100 < valid < 1400  # both kinds were seen
