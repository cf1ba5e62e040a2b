"""Plain sections are read as JSON, and nothing about the outcome tells."""

import random
import tomllib
from pathlib import Path
from typing import Any

import pytest

from tensegrity_codegen.scene import plain_sections
from tensegrity_codegen.scene.plain_sections import cut_plain_sections
from tensegrity_codegen.scene.read import read_document
from tensegrity_codegen.scene.toml_text import format_scene
from tensegrity_codegen.system.errors import SceneError

EXAMPLES = sorted(Path(plain_sections.__file__).parent.joinpath("examples").glob("*.toml"))
NODES = {f"n{k}": {"position": [0.1 * k, -1e-7 * k, k], "mass": 0.5, "anchored": k == 0} for k in range(9)}
MEMBERS = {
    f"m{k}": {"kind": "cable", "nodes": [f"n{k}", f"n{k + 1}"], "spring_constant": 1e5} for k in range(8)
}


@pytest.fixture(autouse=True)
def short_files_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plain_sections, "LEAST_LENGTH", 0)


def outcome(text: str, path: Path) -> Any:
    """What reading a file gives: the document, or the error's class and text."""
    path.write_text(text, encoding="utf-8", newline="")
    try:
        return repr(read_document(path))
    except SceneError as error:
        return type(error), str(error)


def same_as_toml(text: str, path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    fast = outcome(text, path)
    with monkeypatch.context() as patch:
        patch.setattr(plain_sections, "LEAST_LENGTH", 10**9)
        assert fast == outcome(text, path)
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
    monkeypatch.setattr(plain_sections, "LEAST_LENGTH", len(text) + 1)
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
