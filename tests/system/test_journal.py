"""Journals: what is read back, and what is computed again."""

import json
import math
import os
import time
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace

import pytest

from tensegrity_codegen.studies import study
from tensegrity_codegen.studies.study import hash_study
from tensegrity_codegen.system import journal
from tensegrity_codegen.system.errors import OutputError
from tensegrity_codegen.system.journal import Journal, Resumption, read_record
from tests.runtime.build import prism


def test_results_of_the_same_key_are_found_again(tmp_path: Path) -> None:
    file = tmp_path / "new" / "a.jsonl"
    Journal(file, "one").store("x", [1.5, None])
    Journal(file, "two").store("x", "other")
    assert Journal(file, "one").find("x") == [1.5, None]
    assert Journal(file, "one").find("y") is None
    assert Journal(file, "three").find("x") is None


@pytest.mark.parametrize("cut", range(1, 30, 4))
def test_a_last_line_that_is_cut_off_costs_only_itself(tmp_path: Path, cut: int) -> None:
    file = tmp_path / "a.jsonl"
    whole = Journal(file, "one")
    whole.store("x", 1)
    whole.store("y", 2)
    file.write_bytes(file.read_bytes()[:-cut])
    torn = Journal(file, "one")
    assert torn.find("x") == 1
    torn.store("z", 3)
    healed = Journal(file, "one")
    assert (healed.find("x"), healed.find("z")) == (1, 3)


def test_a_line_of_which_a_bit_changed_is_not_used(tmp_path: Path) -> None:
    file = tmp_path / "a.jsonl"
    Journal(file, "one").store("x", 31.25)
    line = file.read_bytes()
    for place in range(len(line) - 1):
        for bit in range(8):
            changed = bytearray(line)
            changed[place] ^= 1 << bit
            file.write_bytes(changed)
            assert Journal(file, "one").find("x") in (None, 31.25)


@pytest.mark.parametrize(
    "text",
    [
        "[]\n3\nnull\n",
        '{"key": "one"}\n',
        '{"key": "one", "name": ["x"], "value": 1}\n',
        "[" * 100_000 + "\n",
        '{"key": "one", "name": "x", "value": NaN}\n',
        "\x00\xff\n",
    ],
)
def test_lines_of_another_kind_are_not_used(tmp_path: Path, text: str) -> None:
    file = tmp_path / "a.jsonl"
    file.write_text(text, encoding="utf-8")
    assert Journal(file, "one").find("x") is None


def test_a_journal_that_is_no_regular_file_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path, tmp_path / "pipe"):
        with pytest.raises(OutputError, match="no regular file"):
            Journal(path, "one")


@dataclass(frozen=True)
class Sample:
    name: str
    count: int
    size: float
    error: float | None
    good: bool


GOOD = {"name": "a", "count": 1, "size": 2.0, "error": None, "good": True}


@pytest.mark.parametrize(
    "wrong",
    [
        {"size": "2.0"},
        {"error": "soon"},
        {"count": 1.5},
        {"count": True},
        {"good": 1},
        {"name": None},
        {"size": math.inf},
        {"size": 10**400},
        {"more": 1},
    ],
)
def test_a_record_with_a_wrong_value_is_none(wrong: dict[str, object]) -> None:
    assert read_record(Sample, GOOD) == Sample("a", 1, 2.0, None, True)
    assert read_record(Sample, GOOD | wrong) is None
    assert read_record(Sample, {k: v for k, v in GOOD.items() if k != "name"}) is None
    assert read_record(Sample, json.loads("[]")) is None


def test_the_key_of_a_study_changes_with_code_scene_options_and_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    structure = prism()
    key = hash_study(structure, None, "reference", "0.1")
    assert hash_study(prism(), None, "reference", "0.1") == key
    assert hash_study(structure, None, "native", "0.1") != key
    assert hash_study(structure, None, "reference", "0.2") != key
    heavier = structure.with_changes(node_mass=2.0 * structure.node_mass)
    assert hash_study(heavier, None, "reference", "0.1") != key
    for name in ("hash_package", "name_processor", "find_version"):
        with monkeypatch.context() as patch:
            patch.setattr(study, name, lambda *_: "another")
            study._surroundings.cache_clear()
            assert hash_study(structure, None, "reference", "0.1") != key, name
    study._surroundings.cache_clear()


def test_a_fresh_journal_forgets_the_results_of_its_key_alone(tmp_path: Path) -> None:
    file = tmp_path / "a.jsonl"
    for key in ("one", "two"):
        Journal(file, key).store("x", key)
    assert Journal(file, "one", fresh=True).find("x") is None
    assert Journal(file, "one").find("x") is None
    assert Journal(file, "two").find("x") == "two"
    assert [path.name for path in tmp_path.iterdir()] == ["a.jsonl"]


def test_what_is_taken_is_announced_with_its_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, told = tmp_path / "a.jsonl", list[Resumption]()
    monkeypatch.setattr(journal, "time", SimpleNamespace(time=lambda: 1234.5))
    Journal(file, "one", notice=told.append).announce("prism", "cases", 0, 2)
    assert told == []  # there was no run before
    Journal(file, "one").store("x", 1)
    Journal(file, "one", notice=told.append).announce("prism", "cases", 1, 2)
    assert told.pop() == Resumption("prism", "cases", 1, 2, 1234.5)
    Journal(file, "two", notice=told.append).announce("prism", "cases", 0, 2)
    assert told.pop() == Resumption("prism", "cases", 0, 2, 1234.5, is_stale=True)
    Journal(file, "one", fresh=True, notice=told.append).announce("prism", "cases", 0, 2)
    assert told == []
    file.write_text('{"key": "one", "name": "x", "value": 1}\n', encoding="utf-8")  # of an older version
    Journal(file, "one", notice=told.append).announce("prism", "cases", 1, 2)
    assert told.pop().written is None


NOON = time.mktime((2026, 7, 1, 12, 0, 0, 0, 0, -1))


@pytest.mark.parametrize(
    ("taken", "hours", "is_stale", "text"),
    [
        (12, 1, False, "prism: 12 of 40 cases taken from the unfinished run of 12:00"),
        (12, 24, False, "prism: 12 of 40 cases taken from the unfinished run of 2026-07-01 12:00"),
        (40, 1, False, "prism: all 40 cases taken from the run of 12:00; `fresh=True` computes them again"),
        (
            0,
            1,
            True,
            "prism: results of the run of 12:00 are not used: "
            "scene, options, code, packages or machine differ",
        ),
    ],
)
def test_what_is_taken_is_described_in_a_sentence(taken: int, hours: int, is_stale: bool, text: str) -> None:
    assert Resumption("prism", "cases", taken, 40, NOON, is_stale).describe(NOON + 3600.0 * hours) == text


def test_a_run_of_unknown_time() -> None:
    taken = Resumption("prism", "cases", 3, 40, None)
    assert taken.describe(NOON) == "prism: 3 of 40 cases taken from the unfinished run before"
    assert taken.as_dict()["written"] is None
    written = Resumption("prism", "cases", 3, 40, NOON).as_dict()["written"]
    assert datetime.strptime(written, "%Y-%m-%dT%H:%M:%S%z").timestamp() == NOON
