"""Templates, their bytecode in the cache, and lists of numbers in generated text."""

from collections.abc import Iterator
from pathlib import Path

import jinja2
import numpy as np
import pytest

from tensegrity_codegen.codegen.print import render as render_module
from tensegrity_codegen.codegen.print.render import render, wrap_values
from tensegrity_codegen.system.cache_root import CACHE_VARIABLE

WORDS = {"entries": ["one", "two"]}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A cache of its own, and the folder of templates in it, with one short template."""
    templates = tmp_path / "templates"
    templates.mkdir()
    (templates / "short.j2").write_text("{{ entries | enumerated('word') }}", encoding="utf-8")
    (templates / "c").mkdir()
    monkeypatch.setattr(render_module, "template_folder", lambda: templates)
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    render_module._environment.cache_clear()
    yield tmp_path / "cache" / "templates"
    render_module._environment.cache_clear()


def render_anew() -> str:
    """Render as a new process does."""
    render_module._environment.cache_clear()
    return render("short", WORDS)


def test_a_template_is_compiled_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = render_anew()
    assert text == "word_one = 0, word_two = 1"
    assert len(list(folder.iterdir())) == 1

    def refuse(*_: object, **__: object) -> str:
        raise AssertionError("compiled again")

    with monkeypatch.context() as patch:
        patch.setattr(jinja2.Environment, "compile", refuse)
        assert render_anew() == text
    (folder.parents[1] / "templates" / "short.j2").write_text("{{ entries[0] }}", encoding="utf-8")
    assert render_anew() == "one"


@pytest.mark.parametrize("damage", [b"", b"nothing", None])
def test_damaged_bytecode_is_made_again(folder: Path, damage: bytes | None) -> None:
    text = render_anew()
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[:-20] if damage is None else damage)
    assert render_anew() == text
    assert file.read_bytes() == whole


def test_bytecode_that_others_may_have_written_is_not_read(folder: Path) -> None:
    text = render_anew()
    (file,) = folder.iterdir()
    file.chmod(0o666)
    file.write_bytes(b"never read")
    assert render_anew() == text
    assert file.read_bytes() == b"never read"


def test_a_cache_that_cannot_be_written_is_not_needed(folder: Path) -> None:
    folder.parent.write_text("a file in the way", encoding="ascii")
    assert render_anew() == "word_one = 0, word_two = 1"


def test_a_full_disk_is_not_an_error(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(jinja2.FileSystemBytecodeCache, "dump_bytecode", fail)
    assert render_anew() == "word_one = 0, word_two = 1"


@pytest.mark.parametrize("values", [[], [7], list(range(1000)), [0.1, -1e-300, 1e300] * 40, ["x" * 200, "y"]])
def test_a_list_keeps_its_values_in_short_lines(values: list[object]) -> None:
    text = wrap_values(values)
    assert [word for word in text.replace("\n", "").replace(" ", "").split(",") if word] == list(
        map(str, values)
    )
    assert all(len(line) <= 110 or len(line.split()) == 1 for line in text.splitlines())


def test_all_lines_but_the_last_hold_equally_many() -> None:
    counts = [line.count(",") for line in wrap_values(range(10_000)).splitlines()]
    assert len(set(counts[:-1])) == 1
    assert counts[-1] < counts[0]


def test_arrays_are_taken_too() -> None:
    assert wrap_values(np.array([3, 1, 2], dtype=np.int32)) == "3, 1, 2"
    assert wrap_values(str(k) for k in range(3)) == "0, 1, 2"
