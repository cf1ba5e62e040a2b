"""Comparisons of an interrupted run of the benchmarks are taken from its journal."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from harness.session import Kept, Session
from harness.tools import Candidate

from tensegrity_codegen.system.journal import Journal, Resumption


def make(name: str, ns: float, value: float) -> Candidate:
    """Return a candidate that says that a call takes `ns`."""
    return Candidate(name, lambda count: ns * 1e-9 * count, lambda: np.array([value]), called="C")


def compare(session: Session, structure: str, quantity: str) -> None:
    ways = [("ours", ("table", lambda: make("table", 50.0, 1.0)))]
    ways += [("peer", ("C", lambda: make("C", 200.0, 1.0))), ("peer", ("odd", lambda: make("odd", 1.0, 9.0)))]
    session.compare(structure, 12, quantity, ways, ("C",))
    session.units[structure, quantity] = 2.5
    session.chosen[structure, quantity] = "table"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """The journal of a run that has finished one of three parts."""
    path, session = tmp_path / "journal" / "bench.jsonl", Session(rounds=3, target=1e-6)
    kept = Kept(Journal(path, "key"))
    assert not kept.take(session, "prism", "node_force")
    compare(session, "prism", "node_force")
    kept.keep(session, "prism", "node_force")
    return path


def test_finished_comparisons_are_taken_as_they_were(path: Path) -> None:
    told: list[Resumption] = []
    seen: list[float] = []
    kept = Kept(Journal(path, "key", notice=told.append), seen.append)
    kept.announce(["prism, node_force", "prism, elastic_energy", "script.py"])
    assert (told[0].taken, told[0].total) == (1, 3)
    session = Session()
    assert kept.take(session, "prism", "node_force")
    first = Session(rounds=3, target=1e-6)
    compare(first, "prism", "node_force")
    assert [dataclasses.replace(row, ns=1.0) for row in session.rows] == [
        dataclasses.replace(row, ns=1.0) for row in first.rows
    ]
    assert session.row("prism", "node_force", "table").ns == pytest.approx(50.0)  # type: ignore[union-attr]
    timings = session.timings["prism", "node_force"]
    assert timings["table"].times_faster_than(timings["C"]) == pytest.approx(4.0)
    assert (session.units, session.chosen) == (first.units, first.chosen)
    assert session.unequal == {}
    assert kept.find("script.py", lambda: "text", lambda text: True) == "text"
    assert seen == pytest.approx([1 / 3, 2 / 3])


@pytest.mark.parametrize(
    ("name", "wrong"),
    [("rows", None), ("rows", []), ("rows", [{"name": 3}]), ("timings", [1]), ("units", ...)],
)
def test_a_damaged_comparison_is_made_again(path: Path, name: str, wrong: object) -> None:
    journal = Journal(path, "key")
    data = dict(journal.find("prism, node_force"))
    journal.store(
        "prism, node_force",
        {k: v for k, v in data.items() if k != name} if wrong is ... else data | {name: wrong},
    )
    session = Session()
    assert not Kept(journal).take(session, "prism", "node_force")
    assert session.rows == []


def test_what_is_not_good_is_not_kept(path: Path) -> None:
    kept = Kept(Journal(path, "key"))
    assert kept.find("script.py", lambda: "failed: why", lambda text: "failed" not in text) == "failed: why"
    assert Journal(path, "key").find("script.py") is None


def test_results_of_another_shape_are_kept_with_their_infinite_error(path: Path) -> None:
    odd = Candidate("odd", lambda count: 1e-9 * count, lambda: np.zeros(3))
    session = Session(rounds=1, target=1e-6)
    ways = [("ours", ("table", lambda: make("table", 50.0, 1.0))), ("peer", ("odd", lambda: odd))]
    session.compare("prism", 12, "energy", ways)
    Kept(Journal(path, "key")).keep(session, "prism", "energy")
    again = Session()
    assert Kept(Journal(path, "key")).take(again, "prism", "energy")
    assert [row.error for row in again.rows] == [0.0, np.inf]
    assert again.rows == session.rows
