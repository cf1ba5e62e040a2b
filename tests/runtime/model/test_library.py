"""Loading a library: everything that does not fit together is a named error, never a crash."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.codegen.compilation.compile import compile_library
from tensegrity_codegen.codegen.compilation.flags import FLAG_SETS
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.system.errors import AbiMismatchError, LibraryError
from tensegrity_codegen.tables.manifest import ABI_VERSION, Manifest
from tensegrity_codegen.tables.request import ModelRequest
from tests.runtime.build import prism

REQUEST = ModelRequest(("member_tension",))


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a library and its manifest; tests copy it."""
    folder = tmp_path_factory.mktemp("built")
    return build_library(prism(), REQUEST).export(folder)


@pytest.fixture
def folder(built: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(built, tmp_path / "library"))


def library_in(folder: Path) -> Path:
    (found,) = (path for path in folder.iterdir() if path.suffix in (".so", ".dylib", ".dll"))
    return found


def compile_text(text: Callable[[str], str], folder: Path) -> Path:
    """Put a library into the folder whose source was changed."""
    files = {name: body for name, body in emit(prism(), REQUEST).files.items() if name.startswith("small.")}
    changed = {name: text(body) for name, body in files.items()}
    assert changed != files
    artifact = compile_library(changed, name="small", compiler=find_compiler(), flags=FLAG_SETS["reference"])
    path = folder / artifact.file_name
    path.unlink()
    path.write_bytes(artifact.library)
    return path


def test_a_library_with_its_manifest_loads_from_anywhere(folder: Path) -> None:
    model = CompiledModel(library_in(folder))
    assert model.manifest.name == "small"
    assert model.compute("member_tension").shape == (12,)


def test_a_bare_file_name_means_the_present_folder(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    assert CompiledModel(library_in(folder).name).has("member_tension")


def test_a_missing_library_is_named(folder: Path) -> None:
    path = library_in(folder)
    path.unlink()
    with pytest.raises(LibraryError, match="does not load") as caught:
        CompiledModel(path)
    assert caught.value.where == str(path)


@pytest.mark.parametrize("content", [b"", b"rubbish", b"\x7fELF" + b"\x00" * 100])
def test_a_file_that_is_no_library_is_refused(folder: Path, content: bytes) -> None:
    path = library_in(folder)
    path.unlink()
    path.write_bytes(content)
    with pytest.raises(LibraryError, match="does not load"):
        CompiledModel(path)


def test_a_folder_is_no_library(folder: Path) -> None:
    manifest = Manifest.read(folder / "manifest.json")
    with pytest.raises(LibraryError, match="does not load"):
        CompiledModel(folder, manifest)


def test_another_interface_version_in_the_library_is_refused(folder: Path) -> None:
    path = compile_text(lambda text: text.replace(f'    {ABI_VERSION}, "small"', '    99, "small"'), folder)
    with pytest.raises(AbiMismatchError) as caught:
        CompiledModel(path)
    assert (caught.value.given, caught.value.allowed) == (99, str(ABI_VERSION))


def test_another_interface_version_in_the_manifest_is_refused(folder: Path) -> None:
    path = folder / "manifest.json"
    path.write_bytes(with_entries(abi_version=ABI_VERSION + 1)(path.read_bytes()))
    with pytest.raises(AbiMismatchError) as caught:
        CompiledModel(library_in(folder))
    assert caught.value.given == ABI_VERSION + 1


def test_a_library_of_another_scene_is_refused(folder: Path) -> None:
    manifest = Manifest.read(folder / "manifest.json")
    with pytest.raises(AbiMismatchError, match="different scenes") as caught:
        CompiledModel(library_in(folder), replace(manifest, scene_hash="0" * 64))
    assert manifest.scene_hash[:12] in str(caught.value.given)


@pytest.mark.parametrize("symbol", ["small_descriptor", "small_compute_member_tension"])
def test_a_library_that_lacks_a_symbol_is_refused(folder: Path, symbol: str) -> None:
    path = compile_text(lambda text: text.replace(symbol, f"{symbol}_renamed"), folder)
    with pytest.raises(LibraryError, match="lacks a function") as caught:
        CompiledModel(path)
    assert caught.value.given == symbol


def test_a_library_without_manifest_is_refused(folder: Path) -> None:
    (folder / "manifest.json").unlink()
    with pytest.raises(LibraryError, match="no manifest beside the library"):
        CompiledModel(library_in(folder))


def test_a_manifest_survives_the_way_to_text_and_back(folder: Path) -> None:
    text = (folder / "manifest.json").read_text(encoding="utf-8")
    assert Manifest.from_json(text).to_json() == text


def cut(part: float) -> Callable[[bytes], bytes]:
    return lambda content: content[: int(part * len(content))]


def becomes(content: bytes) -> Callable[[bytes], bytes]:
    return lambda _: content


def with_entries(**changes: Any) -> Callable[[bytes], bytes]:
    return lambda content: json.dumps(json.loads(content) | changes).encode()


@pytest.mark.parametrize(
    "damage",
    [
        *map(cut, (0.0, 0.1, 0.5, 0.99)),
        *map(becomes, (b"\xff\xfe\x00", b"[]", b"5", b"{}", b'{"abi_version": %d}' % ABI_VERSION, b"null")),
        with_entries(made_by="abc"),
        with_entries(made_by=5),
        with_entries(arguments=5),
        with_entries(functions=[5]),
        with_entries(functions=[{"quantity": "x"}]),
        with_entries(surprise=1),
        with_entries(left_out=None),
    ],
)
def test_a_damaged_manifest_is_refused(folder: Path, damage: Callable[[bytes], bytes]) -> None:
    path = folder / "manifest.json"
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(LibraryError, match="the manifest is damaged") as caught:
        CompiledModel(library_in(folder))
    assert caught.value.where == str(path)


def test_two_libraries_of_one_name_live_side_by_side(folder: Path) -> None:
    first = CompiledModel(library_in(folder))
    second = build_library(prism(140.0), REQUEST).load()
    assert not np.array_equal(first.compute("member_tension"), second.compute("member_tension"))
    np.testing.assert_array_equal(
        first.compute("member_tension"), CompiledModel(library_in(folder)).compute("member_tension")
    )
