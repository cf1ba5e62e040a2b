"""The registry of export formats: what it refuses before any work; files are written whole or not at all."""

from pathlib import Path
from typing import Any

import pytest

from tensegrity_codegen.export import exporter
from tensegrity_codegen.export.exporter import Exported, Exporter, ExportSource, find_exporters, write_export
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.system.errors import (
    FormulationError,
    InvalidValueError,
    OutputError,
    UnknownNameError,
)
from tests.cli.conftest import write_example


def write_names(source: ExportSource, path: Path, *, end: str = "\n") -> Exported:
    path.write_text(end.join(source.structure.node_name), encoding="utf-8")
    return Exported({"n_nodes": source.structure.n_nodes}, ("forces are not in the file",))


def write_half(source: ExportSource, path: Path) -> Exported:
    path.write_text("half", encoding="utf-8")
    raise FormulationError("bars cannot be written", where=str(source.path))


@pytest.fixture(autouse=True)
def formats(monkeypatch: pytest.MonkeyPatch) -> None:
    known = [
        Exporter("names", "names of nodes", (".txt",), write_names, ("end",)),
        Exporter("half", "half a file", (".half",), write_half),
    ]
    monkeypatch.setattr(exporter, "find_exporters", lambda: known)


@pytest.fixture
def source(tmp_path: Path) -> ExportSource:
    path = write_example(tmp_path, "two_nodes")
    return ExportSource(path, *load_scene(path))


def test_a_format_writes_the_file(source: ExportSource, tmp_path: Path) -> None:
    out = tmp_path / "names.txt"
    exported = write_export("names", source, out, end=";")
    assert out.read_text(encoding="utf-8") == ";".join(source.structure.node_name)
    assert exported.facts == {"n_nodes": 2}


@pytest.mark.parametrize(
    ("name", "file", "options", "error", "words"),
    [
        ("nmaes", "a.txt", {}, UnknownNameError, "did you mean 'names'"),
        ("half", "a.half", {"end": ";"}, InvalidValueError, "with names only"),
        ("names", "a.csv", {}, OutputError, "'.csv'"),
        ("names", "nowhere/a.txt", {}, OutputError, "no folder"),
        ("names", "there.txt", {}, OutputError, "exists"),
    ],
)
def test_a_wrong_request_is_refused(
    name: str,
    file: str,
    options: dict[str, Any],
    error: type[Exception],
    words: str,
    source: ExportSource,
    tmp_path: Path,
) -> None:
    (tmp_path / "there.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(error, match=words):
        write_export(name, source, tmp_path / file, **options)
    assert (tmp_path / "there.txt").read_text(encoding="utf-8") == "mine"


def test_nothing_half_written_is_left(source: ExportSource, tmp_path: Path) -> None:
    before = sorted(tmp_path.iterdir())
    with pytest.raises(FormulationError):
        write_export("half", source, tmp_path / "a.half")
    assert sorted(tmp_path.iterdir()) == before


def test_every_format_has_another_name_and_an_ending() -> None:
    found = find_exporters()
    assert len({item.name for item in found}) == len(found)
    assert all(item.endings and item.title for item in found)
