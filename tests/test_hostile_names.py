"""Names of scenes are plain identifiers or are refused: none of them leaves the place where it is written."""

import ast
import io
import json
import re
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegrity_codegen.cli.app import main
from tensegrity_codegen.codegen.bundle import emit_bundle
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.wheels.wheel import build_wheel
from tensegrity_codegen.pipeline.build_library import BuiltLibrary, build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.scene.names import DEVICES, is_name, is_scene_name
from tensegrity_codegen.system.errors import InvalidNameError, TensegrityError
from tensegrity_codegen.tables.manifest import Manifest
from tests.cases import draws, thorough
from tests.codegen.build_c import STRICT, run
from tests.codegen.compilers import POSIX, chosen_compiler, require_compiler
from tests.hostile_names import PLACES, format_scene, names

FEW = draws(12)
MANY = draws(500)
TRIGRAPH = re.compile(r"\?\?[=/'()!<>-]")
TEXT = re.compile(r"[\t\n\x20-\x7e]*")
FOLDERS = (
    *("a b", "-rf", "$(touch pwned)", "`touch pwned`", "a;touch pwned", "a'b", 'a"b', "%s%n", "a\\b", "#a"),
    *("ä", "a$b", "--help", "a&b", "*", "new\nline"),
)


def read_named(place: str, name: str, folder: Path) -> tuple[Path, TensegrityError | None]:
    path = folder / "scene.toml"
    path.write_text(format_scene(place, name), encoding="utf-8")
    try:
        load_scene(path)
    except TensegrityError as error:
        return path, error
    return path, None


def check_refusal(error: TensegrityError, place: str, name: str) -> None:
    """The message is one for people: file, reason and what is allowed, in characters that can be shown."""
    text = str(error)
    assert "scene.toml" in error.where
    assert error.problem
    assert error.allowed or error.hint or error.given is not None, text
    assert len(text) < 4000, (place, name, len(text))
    hidden = [c for c in text if not (c.isprintable() or c == "\n")]
    assert hidden == [], (place, name, text)
    json.dumps(error.as_dict(), allow_nan=False)


def check_names(files: dict[str, str]) -> None:
    """Generated text is plain ASCII without trigraphs; comments end where they are meant to."""
    for name, text in files.items():
        assert re.fullmatch(r"[A-Za-z0-9_.]+", name), name
        assert TEXT.fullmatch(text), name
        assert not TRIGRAPH.search(text), name
        if name.endswith((".c", ".h")):
            opened = re.sub(r'"(?:[^"\\\n]|\\.)*"', '""', text)
            assert "/*" not in re.sub(r"/\*.*?\*/", "", opened, flags=re.S), name
            assert "*/" not in re.sub(r"/\*.*?\*/", "", opened, flags=re.S), name


def check_manifest(text: str, place: str, name: str) -> Manifest:
    manifest = Manifest.from_json(text)
    for listed in (manifest.node_name, manifest.member_name, manifest.coordinate_name, manifest.input_name):
        assert all(map(is_name, listed))
    held = {"scene": [manifest.name], "node": manifest.node_name, "member": manifest.member_name}
    held |= {"input": manifest.input_name, "actuator": manifest.input_name}
    assert name in held.get(place, [name])
    return manifest


def check_wheel_text(manifest: Manifest, folder: Path) -> None:
    """The Python package is one module that parses, and its metadata has the headers that it should have."""
    library = folder / "library.so"
    library.write_bytes(b"library")
    try:
        file_name, wheel = build_wheel(manifest, library)
    except InvalidNameError:
        assert manifest.name == "codegen"
        return
    assert re.fullmatch(r"[A-Za-z0-9_.+-]+\.whl", file_name)
    with zipfile.ZipFile(io.BytesIO(wheel)) as archive:
        assert all(re.fullmatch(r"[\w.+-]+/[\w.+-]+", path) for path in archive.namelist())
        parts = {path.partition("/")[2]: archive.read(path).decode("utf-8") for path in archive.namelist()}
    module = ast.parse(parts["__init__.py"])
    kinds = {type(node).__name__ for node in module.body}
    assert kinds <= {"Expr", "ImportFrom", "Import", "Assign", "AnnAssign", "FunctionDef"}
    headers = Parser().parsestr(parts["METADATA"], headersonly=True)
    assert len(set(headers.keys())) == len(headers.keys()) - headers.keys().count("Classifier") + 1
    assert headers["Requires-Dist"] == "numpy>=1.26"


def try_name(place: str, name: str) -> None:
    """Read a scene with this name in this place, and check what is written, or how it is refused."""
    with tempfile.TemporaryDirectory() as folder:
        path, error = read_named(place, name, Path(folder))
        allowed = is_scene_name(name) if place == "scene" else is_name(name)
        if error is not None:
            check_refusal(error, place, name)
            taken = {f"a_{other}" for other in PLACES} | {"root", "a", "b", "cables", "bars", "all"}
            assert not allowed or name in taken or place in ("class", "group", "sensor"), (
                place,
                name,
                str(error),
            )
            return
        assert allowed, (place, name)
        source = emit(*load_scene(path))
        manifest = check_manifest(source.files["manifest.json"], place, name)
        bundle = emit_bundle(manifest, [f"{manifest.name}.c"], f"lib{manifest.name}.so")
        check_names(dict(source.files) | bundle)
        check_wheel_text(manifest, Path(folder))


@FEW
@given(place=st.sampled_from(PLACES), name=names())
def test_a_name_is_an_identifier_or_is_refused(place: str, name: str) -> None:
    try_name(place, name)


@pytest.mark.thorough
@MANY
@given(place=st.sampled_from(PLACES), name=names())
def test_500_names_are_identifiers_or_are_refused(place: str, name: str) -> None:
    try_name(place, name)


@pytest.mark.thorough
@draws(60)
@given(name=names().filter(is_scene_name), place=st.sampled_from(["scene", "node", "member", "input"]))
def test_what_accepted_names_give_compiles_with_trigraphs(name: str, place: str) -> None:
    compiler = require_compiler("gcc")
    with tempfile.TemporaryDirectory() as folder:
        path, error = read_named(place, name, Path(folder))
        if error is not None:
            return
        for file, text in emit(*load_scene(path)).files.items():
            (Path(folder) / file).write_text(text, encoding="utf-8")
        sources = [item.name for item in Path(folder).glob("*.c")]
        options = ("-std=c99", "-trigraphs", "-fsyntax-only", *STRICT)
        run([*compiler.command, *options, *sources], Path(folder))


@pytest.mark.thorough
@draws(8)
@given(name=names().filter(is_scene_name), place=st.sampled_from(["scene", "node", "member", "input"]))
def test_units_of_accepted_names_are_described_in_xml(name: str, place: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path, error = read_named(place, name, Path(folder))
        if error is not None:
            return
        made = Path(folder) / "unit.fmu"
        with pytest.raises(SystemExit) as ended:
            main(["export", "fmu", str(path), "--out", str(made), "--sources-only"])
        assert not ended.value.code
        with zipfile.ZipFile(made) as archive:
            assert all(not item.startswith(("/", "..")) and "\\" not in item for item in archive.namelist())
            root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    assert root.get("modelName") == (name if place == "scene" else "a_scene")


@pytest.mark.parametrize("name", [*DEVICES, "NUL", "Com1"])
def test_a_scene_has_no_name_of_a_device_of_windows(name: str, tmp_path: Path) -> None:
    _, error = read_named("scene", name, tmp_path)
    assert isinstance(error, InvalidNameError)
    assert "Windows" in error.problem
    assert "lpt1 to lpt9" in error.allowed


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> BuiltLibrary:
    path = tmp_path_factory.mktemp("scene") / "scene.toml"
    path.write_text(format_scene("node", "b"), encoding="utf-8")
    return build_library(*load_scene(path))


@POSIX
@pytest.mark.parametrize(
    "name", [*FOLDERS[::4], *thorough(*(name for name in FOLDERS if name not in FOLDERS[::4]))]
)
def test_names_of_folders_reach_no_shell(
    name: str, built: BuiltLibrary, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    folder = built.export(Path(name))
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert folder.absolute() == tmp_path / name
    if shutil.which("make") is None or sys.platform == "win32":
        return
    done = subprocess.run(
        ["make", chosen_compiler(), "-n"], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == [name]
