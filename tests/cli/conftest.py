"""The command line called in this process, in a folder of its own."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tensegrity_codegen.cli import installation
from tensegrity_codegen.cli.app import main
from tensegrity_codegen.cli.streams import ProgressBar
from tensegrity_codegen.cli.verbs.examples import list_examples
from tensegrity_codegen.codegen.compilation import toolchain
from tensegrity_codegen.codegen.compilation.flags import Compiler


@dataclass(frozen=True)
class Ended:
    """How a call ended: exit code, standard output, standard error."""

    code: int
    out: str
    err: str

    @property
    def data(self) -> Any:
        """All of standard output as one JSON object; NaN and Infinity are no JSON."""

        def refuse(word: str) -> Any:
            raise ValueError(f"{word} in JSON")

        data = json.loads(self.out, parse_constant=refuse)
        assert isinstance(data, dict)
        return data

    @property
    def facts(self) -> dict[str, Any]:
        """The data without the time that the verb took."""
        return {key: value for key, value in self.data.items() if key != "seconds"}


class Run:
    """The command line, called with words in this process."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self.capsys = capsys

    def __call__(self, *words: object) -> Ended:
        """Return how a call ended; no error is shown as a traceback."""
        self.capsys.readouterr()
        with pytest.raises(SystemExit) as caught:
            main([str(word) for word in words])
        out, err = self.capsys.readouterr()
        assert "Traceback" not in err
        return Ended(int(caught.value.code or 0), out, err)

    def good(self, *words: object) -> Ended:
        """Return how a call ended that has to end with code 0."""
        ended = self(*words)
        assert ended.code == 0, ended.err
        return ended

    def refused(self, *words: object) -> Ended:
        """Return how a call with wrong input ended, which has to end with code 2."""
        ended = self(*words)
        assert ended.code == 2, ended.out
        return ended


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    """Return what calls the command line. Lines of progress are off."""
    monkeypatch.setattr(ProgressBar, "INTERVAL", 3600.0)
    return Run(capsys)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, empty at first."""
    place = tmp_path / "work"
    place.mkdir()
    monkeypatch.chdir(place)
    return place


@pytest.fixture(autouse=True)
def without_zig(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let doctor try zig only where nothing else is: at first zig builds its C library, for seconds."""

    def find_others() -> tuple[Compiler, ...]:
        found = toolchain.find_compilers()
        return tuple(item for item in found if item.name != "zig") or found

    monkeypatch.setattr(installation, "find_compilers", find_others)


@pytest.fixture
def prism(folder: Path) -> Path:
    """The example prism as a file in the working folder."""
    return write_example(folder, "prism")


@pytest.fixture
def two_nodes(folder: Path) -> Path:
    """The smallest example as a file in the working folder."""
    return write_example(folder, "two_nodes")


def write_example(folder: Path, name: str) -> Path:
    path = folder / f"{name}.toml"
    path.write_text(list_examples()[name], encoding="utf-8")
    return path
