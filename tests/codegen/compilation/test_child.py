import os
import signal
import subprocess
import sys

import pytest

from tensegrity_codegen.codegen.compilation import child
from tensegrity_codegen.codegen.compilation.child import run_alone, run_limited, run_several
from tests.codegen.compilers import POSIX, hanging_body, is_running, read_pids, wait_until, write_script

WAITING = """
import sys
from pathlib import Path
from tensegrity_codegen.codegen.compilation.child import run_limited
import os
run_limited([sys.argv[1]], folder=Path(sys.argv[2]), environment=os.environ, timeout=60)
"""


def run(tmp_path, *command, timeout=120.0, **options):
    return run_limited(command, folder=tmp_path, environment=os.environ, timeout=timeout, **options)


def test_output_status_and_measures_are_returned(tmp_path):
    code = "import sys; print('to one'); print('to the other', file=sys.stderr); sys.exit(5)"
    outcome = run(tmp_path, sys.executable, "-I", "-u", "-c", code)
    assert (outcome.ended, outcome.number, outcome.ok) == ("exit", 5, False)
    assert outcome.log.splitlines() == ["to one", "to the other"]
    assert 0.0 < outcome.seconds < 120.0


def test_standard_input_is_empty_and_the_folder_as_asked(tmp_path):
    code = "import os, sys; print(os.getcwd()); print(repr(sys.stdin.read()))"
    outcome = run(tmp_path, sys.executable, "-I", "-c", code)
    assert outcome.log.splitlines() == [str(tmp_path.resolve()), "''"]


def test_a_word_is_never_read_by_a_shell(tmp_path):
    word = "; touch broken $(touch broken) `touch broken`"
    outcome = run(tmp_path, sys.executable, "-I", "-c", "import sys; print(sys.argv[1])", word)
    assert outcome.log.strip() == word
    assert list(tmp_path.iterdir()) == []


def run_all(tmp_path, commands, **options):
    return run_several(commands, folder=tmp_path, environment=os.environ, timeout=120.0, **options)


def test_several_outcomes_come_in_the_order_of_their_commands(tmp_path):
    words = "time.sleep(float(sys.argv[2])); print('said', sys.argv[1]); sys.exit(int(sys.argv[1]))"
    code = f"import sys, time; {words}"
    commands = [
        [sys.executable, "-I", "-c", code, str(k), delay] for k, delay in enumerate(("0.5", "0", "0"))
    ]
    for workers in (1, 2, 5):
        outcomes = run_all(tmp_path, commands, workers=workers)
        assert [outcome.number for outcome in outcomes] == [0, 1, 2]
        assert [outcome.log.strip() for outcome in outcomes] == ["said 0", "said 1", "said 2"]
    assert run_all(tmp_path, []) == []


@POSIX
def test_a_question_without_answer_ends_with_what_it_started(tmp_path):
    script = write_script(tmp_path / "hang", hanging_body(tmp_path / "pids"))
    outcome = run_alone([str(script)], tmp_path, os.environ, 1.0)
    assert (outcome.ended, outcome.ok) == ("time", False)
    pids = read_pids(tmp_path / "pids")
    wait_until(lambda: not any(map(is_running, pids)), "both processes ended")


# Each tells that it has started, then waits for the other for as long as the second argument says.
MEETING = """
import pathlib, sys, time
mine, other = sys.argv[1:3]
pathlib.Path(mine).touch()
end = time.monotonic() + float(sys.argv[3])
while time.monotonic() < end and not pathlib.Path(other).exists():
    time.sleep(0.01)
met = pathlib.Path(other).exists()
pathlib.Path(mine).unlink() if sys.argv[4] == "leaves" else None
sys.exit(0 if met else 7)
"""


@POSIX
def test_as_many_commands_as_workers_run_at_once(tmp_path):
    def meet(patience, habit):
        ends = (("a", "b"), ("b", "a"))
        return [[sys.executable, "-I", "-c", MEETING, *pair, patience, habit] for pair in ends]

    assert [outcome.number for outcome in run_all(tmp_path, meet("100", "stays"), workers=2)] == [0, 0]
    for name in "ab":
        (tmp_path / name).unlink()
    assert [outcome.number for outcome in run_all(tmp_path, meet("0.3", "leaves"), workers=1)] == [7, 7]


@POSIX
def test_when_one_cannot_be_run_the_others_are_ended(tmp_path, monkeypatch):
    script = write_script(tmp_path / "hang", hanging_body(tmp_path / "pids"))
    start = subprocess.Popen
    started = []

    def refuse_second(*arguments, **options):
        if started:
            read_pids(tmp_path / "pids")
            raise OSError("no more processes")
        started.append(start(*arguments, **options))
        return started[0]

    monkeypatch.setattr(child.subprocess, "Popen", refuse_second)
    with pytest.raises(OSError, match="no more processes"):
        run_all(tmp_path, [[str(script)], [str(script)]], workers=2)
    for pid in read_pids(tmp_path / "pids"):
        wait_until(lambda pid=pid: not is_running(pid), "the command ended")


def test_a_long_log_is_cut(tmp_path, monkeypatch):
    monkeypatch.setattr(child, "LOG_LIMIT", 100)
    outcome = run(tmp_path, sys.executable, "-I", "-c", "print('x' * 5000)")
    assert outcome.log == "x" * 100 + "\n[cut here]\n"


@POSIX
def test_peak_memory_is_that_of_the_command_alone(tmp_path):
    ballast = bytearray(150 * 2**20)  # belongs to this process, not to the command
    small = run(tmp_path, sys.executable, "-I", "-S", "-c", "pass").peak_memory
    large = run(tmp_path, sys.executable, "-I", "-S", "-c", "bytearray(b'x') * (64 * 2**20)").peak_memory
    assert small < 64 * 2**20 < large < len(ballast)


@POSIX
def test_a_killed_command_reports_its_signal(tmp_path):
    outcome = run(tmp_path, sys.executable, "-I", "-c", "import os; os.kill(os.getpid(), 9)")
    assert (outcome.ended, outcome.number) == ("signal", signal.SIGKILL)


@POSIX
def test_a_missing_program_is_reported(tmp_path):
    outcome = run(tmp_path, str(tmp_path / "missing"))
    assert not outcome.ok
    assert "cannot start" in outcome.log


@POSIX
def test_the_time_limit_ends_the_command_and_its_children(tmp_path):
    script = write_script(tmp_path / "hang", hanging_body(tmp_path / "pids"))
    outcome = run(tmp_path, str(script), timeout=2.0)
    assert outcome.ended == "time"
    assert outcome.seconds >= 2.0
    for pid in read_pids(tmp_path / "pids"):
        wait_until(lambda pid=pid: not is_running(pid), "the process ended")


@pytest.mark.skipif(sys.platform != "linux", reason="macOS and Windows do not bound the address space")
def test_the_memory_limit_bounds_the_command(tmp_path):
    code = "bytearray(400 * 2**20)"
    assert run(tmp_path, sys.executable, "-I", "-S", "-c", code).ok
    outcome = run(tmp_path, sys.executable, "-I", "-S", "-c", code, memory_limit=200 * 2**20)
    assert not outcome.ok
    assert "MemoryError" in outcome.log


@POSIX
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_the_command_ends_with_the_process_that_started_it(tmp_path, number):
    script = write_script(tmp_path / "hang", hanging_body(tmp_path / "pids"))
    starter = subprocess.Popen(
        [sys.executable, "-c", WAITING, str(script), str(tmp_path)], stderr=subprocess.DEVNULL
    )
    with starter:
        pids = read_pids(tmp_path / "pids")
        assert all(is_running(pid) for pid in pids)
        starter.send_signal(number)
    assert starter.returncode != 0
    for pid in pids:
        wait_until(lambda pid=pid: not is_running(pid), "the process ended")


def test_without_a_supervisor_the_time_limit_holds(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "executable", "")
    python = os.path.realpath("/proc/self/exe") if sys.platform == "linux" else None
    if python is None:
        pytest.skip("needs /proc to find Python")
    assert run(tmp_path, python, "-I", "-c", "print('hello')").log == "hello\n"
    assert run(tmp_path, python, "-I", "-c", "import time; time.sleep(60)", timeout=0.3).ended == "time"
