"""Progress on stderr: a bar on a terminal, lines in a file or pipe, and the time that every verb takes."""

import io
import json
import re
import sys
import threading
from contextlib import redirect_stderr

import pytest

from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.streams import ProgressBar
from tests.cases import thorough
from tests.cli.conftest import Run
from tests.cli.terminal import CONTROL, TerminalRun
from tests.codegen.compilers import POSIX, wait_until

# A command with one pass; at each line that it reads it is a quarter of the way further. It ends after four.
QUARTERS = """
import sys
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.streams import ProgressBar
ProgressBar.DELAY, ProgressBar.INTERVAL, ProgressBar.REFRESH = 0.0, 0.01, 0.01
output = Output("--json" in sys.argv)
with output.guard():
    with output.progress("computing [a] long motion of the whole structure") as move:
        for k in range(5):
            move(k / 4)
            sys.stdin.readline()
    output.result({"status": "ok"}, "result")
"""


def test_every_verb_says_on_stderr_how_long_it_took(run: Run, two_nodes: object) -> None:
    words = ("simulate", "two_nodes.toml", "--t-end", "0.1")
    ended = run(*words)
    assert re.search(r"^took \d+\.\d s$", ended.err.splitlines()[-1])
    assert "took" not in ended.out
    ended = run(*words, "--json")
    assert ended.data["seconds"] > 0.0
    assert "took" not in ended.err


def test_a_build_says_both_times(run: Run, two_nodes: object) -> None:
    data = run("build", "two_nodes.toml", "--json").data
    assert data["took_seconds"] >= data["seconds"] > 0.0  # of the verb, and of the library


def test_help_version_and_errors_say_no_time(run: Run) -> None:
    for words in (("--help",), ("--version",), ("check", "--help"), ("check", "none.toml"), ("check",)):
        ended = run(*words)
        assert "took" not in ended.out + ended.err, words


def test_an_error_after_long_work_says_the_time(monkeypatch: pytest.MonkeyPatch, run: Run) -> None:
    monkeypatch.setattr(ProgressBar, "INTERVAL", -1.0)
    assert re.search(r"took \d+\.\d s$", run("check", "none.toml").err.strip())


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
            wait_until(lambda: is_shown(r"measuring: 25 % after \d+ s"), "it says 25 %")
        output.result({"status": "ok"})
        assert "progress" not in {thread.name for thread in threading.enumerate()}  # a result ends them


class FakeTime:
    """A clock that moves on where the bar waits; what happens then is up to the test."""

    def __init__(self, end: float) -> None:
        self.now, self.end = 0.0, end

    def wait(self, seconds: float) -> bool:
        """Let time pass; return whether the work has ended."""
        self.now += seconds
        return self.now >= self.end


def show_lines(seconds: float) -> list[str]:
    """Return the lines of work of so many seconds whose stderr is a file, and that advances evenly."""
    time = FakeTime(seconds)
    bar = ProgressBar(lambda: pytest.fail("a console is not needed"), lambda: time.now)
    move = bar.begin("simulating")

    def wait(duration: float) -> bool:
        ended = time.wait(duration)
        move(time.now / seconds)
        return ended

    bar._wait = wait
    with redirect_stderr(io.StringIO()) as shown:
        bar.show()
    return shown.getvalue().splitlines()


def test_there_is_a_line_every_ten_seconds_and_none_for_shorter_work() -> None:
    assert show_lines(9.99) == []
    assert show_lines(35.0) == [
        "simulating: 28 % after 10 s",
        "simulating: 57 % after 20 s",
        "simulating: 85 % after 30 s",
    ]
    long = show_lines(7200.0)
    assert len(long) == 719
    assert long[5] == "simulating: 0 % after 1 min 0 s"


def test_lines_name_the_outermost_pass_that_runs() -> None:
    time = FakeTime(1.0)
    bar = ProgressBar(lambda: pytest.fail("a console is not needed"), lambda: time.now)
    time.wait(3.0)
    assert bar.describe() == "working: 3 s so far"
    bar.begin("compiling")
    time.wait(20.4)
    bar.begin("a part of it")(0.5)
    assert bar.describe() == "compiling: 20 s so far"
    bar.end()
    bar.end()
    move = bar.begin("simulating")
    time.wait(2.0)
    for fraction in (0.25, 0.1, float("nan"), -1.0):  # it does not go back
        move(fraction)
        assert bar.describe() == "simulating: 25 % after 2 s"
    move(1.5)
    assert bar.describe() == "simulating: 100 % after 2 s"


def draw(columns: int, *words: str, is_piped: bool = False, **variables: str) -> tuple[str, str]:
    """Return what a terminal shows of a command, and what it writes into a pipe; check the exit code."""
    run = TerminalRun([sys.executable, "-c", QUARTERS, *words], columns, is_piped, variables)
    run.read_until(lambda text: "comput" in text)
    for percent in ("25%", "50%", "75%", "100%"):
        run.go_on()
        run.read_until(lambda text, percent=percent: percent in CONTROL.sub("", text))  # type: ignore[misc]
    run.go_on()
    code, shown, piped = run.finish()
    assert code == 0, shown
    return shown, piped


def split_frames(shown: str) -> list[str]:
    """Return the lines that were drawn one over the other, without control sequences."""
    frames = re.split(r"\r|\n|\x1b\[2K", shown)
    return [text for text in (CONTROL.sub("", frame).rstrip() for frame in frames) if text]


@POSIX
@pytest.mark.parametrize("columns", [100, 30, *thorough((60,), (20,))])
def test_a_terminal_shows_one_bar_on_one_line(columns: int) -> None:
    shown, _ = draw(columns)
    frames = split_frames(shown)
    assert max(map(len, frames)) <= columns
    bars = [frame for frame in frames if "%" in frame]
    assert all(frame.startswith("comput") for frame in bars)  # a wrapped line would begin otherwise
    percents = [int(match[1]) for frame in bars if (match := re.search(r"(\d+)%", frame))]
    assert percents == sorted(percents)
    assert (percents[0], percents[-1]) == (25, 100)
    assert "so far" not in shown
    assert shown.count("\x1b[?25l") == shown.count("\x1b[?25h") == 1  # the cursor is hidden, and comes back
    assert re.fullmatch(r"took \d+\.\d s", frames[-1])
    assert "result" in frames


@POSIX
def test_with_json_the_terminal_shows_the_bar_and_stdout_is_one_object() -> None:
    shown, piped = draw(100, "--json", is_piped=True)
    assert "50%" in CONTROL.sub("", shown)
    assert json.loads(piped)["status"] == "ok"
    assert not CONTROL.search(piped)


@pytest.mark.thorough
@POSIX
def test_no_color_draws_the_bar_without_colours() -> None:
    colour = re.compile(r"\x1b\[(?:3[0-8]|4[0-8]|9[0-7]|10[0-7])[;m]")
    assert colour.search(draw(100)[0])
    assert not colour.search(draw(100, NO_COLOR="1")[0])


@POSIX
def test_a_terminal_that_cannot_move_its_cursor_gets_lines() -> None:
    run = TerminalRun([sys.executable, "-c", QUARTERS], 80, False, {"TERM": "dumb"})
    run.read_until(lambda text: " s so far" in text)
    for percent in ("25 %", "50 %", "75 %", "100 %"):
        run.go_on()
        run.read_until(lambda text, percent=percent: percent in text)  # type: ignore[misc]
    run.go_on()
    code, shown, _ = run.finish()
    assert code == 0
    assert not CONTROL.search(shown)


def test_a_file_gets_lines_even_where_colours_are_forced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert len(show_lines(25.0)) == 2


def test_quick_commands_show_no_progress(run: Run) -> None:
    assert re.fullmatch(r"took \d+\.\d s\n", run("new", "fresh.toml").err)
