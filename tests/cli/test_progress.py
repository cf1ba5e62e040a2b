"""Progress on stderr and the time that every verb takes."""

from __future__ import annotations

import io
import re
import threading

import pytest
from rich.console import Console

from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.progress_bar import ProgressBar
from tests.cli.conftest import Run
from tests.codegen.compilers import wait_until


def test_every_result_says_its_time(run: Run, two_nodes: object) -> None:
    words = ("simulate", "two_nodes.toml", "--t-end", "0.1")
    assert re.search(r"took \d+\.\d s$", run(*words).out.strip())
    assert run(*words, "--json").data["seconds"] > 0.0


def test_where_stderr_is_no_terminal_lines_say_how_far_the_work_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(ProgressBar, "INTERVAL", 0.05)
    output, lines = Output(as_json=True), []

    def is_shown(pattern: str) -> bool:
        lines.extend(capsys.readouterr().err.splitlines())
        return any(re.fullmatch(pattern, line) for line in lines)

    with output.guard():  # nothing calls for progress, and still there are lines
        wait_until(lambda: is_shown(r"working: \d+ s so far"), "a line is shown")
        with output.progress("measuring") as move:
            move(0.25)
            wait_until(lambda: is_shown(r"measuring: 25 % after \d+ s, about \d+ s left"), "it says 25 %")
        output.result({"status": "ok"})
        assert "progress" not in {thread.name for thread in threading.enumerate()}  # a result ends them


def test_a_terminal_shows_one_bar_and_no_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ProgressBar, "DELAY", 0.0)
    monkeypatch.setattr(ProgressBar, "INTERVAL", 0.01)
    shown = io.StringIO()
    bar = ProgressBar(lambda: Console(file=shown, force_terminal=True, width=80), "computing")
    bar.start()
    bar.move(0.5)
    wait_until(lambda: "50%" in shown.getvalue(), "the bar shows 50 %")
    wait_until(lambda: "s left" in shown.getvalue(), "it says how long the rest takes")
    bar.stop()
    assert "so far" not in shown.getvalue()


def test_the_time_left_is_that_of_the_work_since_its_first_report() -> None:
    bar = ProgressBar(lambda: Console(file=io.StringIO()), "computing")
    assert bar._left(0.0) == ""
    bar.move(0.1)
    bar.move(0.3)
    assert bar._first is not None
    begun, before = bar._first  # however long the preparation took
    assert before == 0.1
    assert bar._left(begun + 10.0) == ", about 35 s left"  # 20 % took 10 s


def test_quick_commands_show_no_progress(run: Run) -> None:
    assert run("new", "fresh.toml").err == ""
