"""Local processes: every task once, in spite of killed processes, and no process left."""

import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.sweeps.engines.engine import FinishedTask, LocalEngine
from tensegrity_codegen.sweeps.engines.work import SweepWork
from tensegrity_codegen.system.errors import LibraryError
from tensegrity_codegen.system.forked import can_fork
from tests.sweeps.engines.conftest import NoLibraries, Square, make_work
from tests.sweeps.status_words import decode_statuses

pytestmark = pytest.mark.skipif(not can_fork(), reason="these tests need a system that forks processes")


def run_all(work: SweepWork, workers: int = 2) -> dict[int, FinishedTask]:
    libraries: Any = NoLibraries()
    with LocalEngine(workers, libraries).run(work, work.plan.tasks) as stream:
        finished = list(stream)
    assert sorted(item.task.number for item in finished) == [task.number for task in work.plan.tasks]
    return {item.task.number: item for item in finished}


def collect(found: dict[int, FinishedTask]) -> tuple[np.ndarray, list[str], list[str]]:
    rows = [found[number] for number in sorted(found)]
    values = np.concatenate([item.result.arrays["square"] for item in rows])
    words = [word for item in rows for word in decode_statuses(item.result.status)]
    return values, words, [text for item in rows for text in item.result.messages]


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_every_case_has_its_result_whichever_process_and_group(workers: int) -> None:
    values, words, messages = collect(run_all(make_work(Square(), wrong=5.0), workers))
    expected = np.arange(40.0) ** 2
    expected[5] = np.nan
    assert np.array_equal(values, expected, equal_nan=True)
    assert [k for k, word in enumerate(words) if word != "ok"] == [5]
    assert (words[5], messages[5]) == ("bad_input", "a wrong value")


def test_the_task_of_a_killed_process_runs_again(tmp_path: Path) -> None:
    work = make_work(Square(folder=str(tmp_path), deadly=17.0, lives=1))
    found = run_all(work)
    values, words, _ = collect(found)
    assert np.array_equal(values, np.arange(40.0) ** 2)
    assert set(words) == {"ok"}
    attempts = {number: item.facts["attempts"] for number, item in found.items()}
    assert attempts[2] == 2
    assert set(attempts.values()) <= {1, 2}  # others that were under way are computed again, too


@pytest.mark.parametrize(("way", "said"), [("kill", "SIGKILL"), ("bug", "ZeroDivisionError: by zero")])
def test_a_task_that_ends_two_processes_is_set_aside(tmp_path: Path, way: str, said: str) -> None:
    work = make_work(Square(folder=str(tmp_path), deadly=17.0, lives=9, way=way))
    values, words, messages = collect(run_all(work))
    aside = [k for k, word in enumerate(words) if word == "set_aside"]
    assert aside == list(range(16, 24))
    assert np.isnan(values[aside]).all()
    assert np.array_equal(np.delete(values, aside), np.delete(np.arange(40.0) ** 2, aside))
    assert all(said in messages[k] for k in aside)
    if way == "kill":
        assert len(list(tmp_path.iterdir())) == 2


def test_an_error_of_this_package_ends_the_sweep(tmp_path: Path) -> None:
    work = make_work(Square(folder=str(tmp_path), deadly=17.0, lives=9, way="library"))
    with pytest.raises(LibraryError, match="no such library"):
        run_all(work)


def test_no_process_is_left_where_the_caller_stops() -> None:
    work, libraries = make_work(Square(), count=4000), NoLibraries()
    engine, others = LocalEngine(2, libraries), _children()  # type: ignore[arg-type]
    with engine.run(work, work.plan.tasks) as stream:
        next(stream)
        children = _children() - others
        assert len(children) == 2
    deadline = time.monotonic() + 60.0
    while _children() & children and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not _children() & children


def _children() -> set[int]:
    me = os.getpid()
    text = Path(f"/proc/{me}/task/{me}/children")
    if not text.exists():
        pytest.skip("this system does not list the processes of a process")
    return {int(word) for word in text.read_text().split()}
