"""Pieces of work in processes: results, crashes, the deadline."""

import math
import multiprocessing
import os
import signal
import subprocess
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from tensegrity_codegen.system import forked
from tensegrity_codegen.system.forked import run_pieces
from tests.codegen.compilers import is_running, wait_until

pytestmark = pytest.mark.skipif(not forked.can_fork(), reason="this system makes no processes by fork")


def test_every_item_comes_back_with_its_index() -> None:
    end = time.monotonic() + 200.0
    found = {p.index: p.result for p in run_pieces(lambda x: 2 * x, [1, 2, 3], deadline=end, workers=2)}
    assert found == {0: 2, 1: 4, 2: 6}


def test_a_process_that_dies_or_raises_is_named_and_the_others_go_on() -> None:
    def work(item: str) -> str:
        if item == "dies":
            os._exit(7)
        if item == "raises":
            raise ZeroDivisionError("of its own")
        return item

    end = time.monotonic() + 200.0
    pieces = list(run_pieces(work, ["dies", "raises", "good"], deadline=end, workers=1))
    assert [piece.result for piece in pieces] == [None, None, "good"]
    assert "code 7" in pieces[0].problem
    assert pieces[1].problem == "ZeroDivisionError: of its own"


def test_at_the_deadline_everything_ends_with_what_it_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def work(item: int) -> int:
        child = subprocess.Popen(["sleep", "600"])
        (tmp_path / str(child.pid)).touch()
        return child.wait()

    looks: list[int] = []

    def look() -> None:
        looks.append(len(list(tmp_path.iterdir())))
        if looks[-1] == 2:  # both that may run at once have started
            clock[0] = math.inf

    clock = replace_clock(monkeypatch)
    assert list(run_pieces(work, [0, 1, 2], deadline=1.0, workers=2, look=look)) == []
    assert looks[-1] == len(list(tmp_path.iterdir())) == 2
    for file in tmp_path.iterdir():
        child = int(file.name)
        wait_until(lambda child=child: not is_running(child), "what was started ended")  # type: ignore[misc]


def replace_clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Let run_pieces read the time from the list that is returned, which stands still."""
    clock = [0.0]
    monkeypatch.setattr(forked, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    return clock


def test_without_fork_items_run_here_until_the_deadline(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(forked, "can_fork", lambda: False)
    clock = replace_clock(monkeypatch)

    def work(item: int) -> int:
        clock[0] += 0.4
        return os.getpid()

    found = list(run_pieces(work, range(10), deadline=1.0, workers=2))
    assert [piece.result for piece in found] == [os.getpid()] * 3


def test_an_interruption_within_a_fork_is_not_lost() -> None:
    interrupts = [True]

    def interrupt() -> None:
        if interrupts:
            interrupts.clear()
            os.kill(os.getpid(), signal.SIGINT)

    os.register_at_fork(after_in_parent=interrupt)
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            list(run_pieces(time.sleep, [600.0], deadline=time.monotonic() + 100.0, workers=1))
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        assert multiprocessing.active_children() == []
    finally:
        signal.signal(signal.SIGINT, handler)
        interrupts.clear()
