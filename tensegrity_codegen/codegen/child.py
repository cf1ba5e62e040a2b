"""Run one command with limits on time and memory, leaving no process behind however it ends."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

__all__ = ["LOG_LIMIT", "ChildOutcome", "run_limited"]

LOG_LIMIT = 1_000_000  # bytes of a log that are kept
SUPERVISOR = Path(__file__).with_name("supervise.py")


@dataclass(frozen=True)
class ChildOutcome:
    """How a command ended.

    ended: "exit" | "signal" | "time" (stopped at the time limit); number: exit status or signal; log: both
    output streams; seconds: wall time; peak_memory: largest resident set [byte], None where unknown.
    """

    ended: str
    number: int
    log: str
    seconds: float
    peak_memory: int | None

    @property
    def ok(self) -> bool:
        """Whether the command ran to its end and reported success."""
        return self.ended == "exit" and self.number == 0


def run_limited(
    command: Sequence[str],
    *,
    folder: Path,
    environment: Mapping[str, str],
    timeout: float,
    memory_limit: int | None = None,
) -> ChildOutcome:
    """Run `command` (no shell) in `folder`, for at most `timeout` [s] and `memory_limit` [byte].

    memory_limit bounds the address space of each process of the command; it has no effect on Windows and
    macOS. If anything interrupts the wait (Ctrl-C), or this process dies, the command and all of its children
    are killed. Raises OSError if the command cannot be started.
    """
    run = _run_supervised if os.name == "posix" and sys.executable else _run_alone
    with tempfile.TemporaryFile() as log:
        return run(list(command), folder, dict(environment), timeout, memory_limit, log)


def _run_supervised(
    command: list[str],
    folder: Path,
    environment: dict[str, str],
    timeout: float,
    memory_limit: int | None,
    log: IO[bytes],
) -> ChildOutcome:
    """Run through supervise.py, which ends with the command or when its standard input closes."""
    limits = [repr(float(timeout)), str(memory_limit or 0)]
    supervisor = subprocess.Popen(
        [sys.executable, "-I", "-S", str(SUPERVISOR), *limits, *command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=log,
        cwd=folder,
        env=environment,
        start_new_session=True,
    )
    assert supervisor.stdin is not None  # a pipe, as asked for
    assert supervisor.stdout is not None
    try:
        report = supervisor.stdout.read()
    except BaseException:  # Ctrl-C above all
        supervisor.terminate()
        raise
    finally:
        supervisor.stdin.close()
        supervisor.stdout.close()
        supervisor.wait()
    words = report.decode("ascii").split()
    if len(words) != 4:
        raise OSError(f"the supervisor of {command[0]} ended early: {_read_log(log)}")
    return ChildOutcome(words[0], int(words[1]), _read_log(log), float(words[2]), int(words[3]))


def _run_alone(
    command: list[str],
    folder: Path,
    environment: dict[str, str],
    timeout: float,
    memory_limit: int | None,
    log: IO[bytes],
) -> ChildOutcome:
    """Run directly, where there is no fork: time limit only."""
    started = time.monotonic()
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT, cwd=folder, env=environment
    ) as child:
        try:
            number = child.wait(timeout)
            ended = "exit" if number >= 0 else "signal"
        except subprocess.TimeoutExpired:
            ended, number = "time", 0
        finally:
            child.kill()
    return ChildOutcome(ended, abs(number), _read_log(log), time.monotonic() - started, None)


def _read_log(log: IO[bytes]) -> str:
    log.seek(0)
    data = log.read(LOG_LIMIT + 1)
    text = data[:LOG_LIMIT].decode("utf-8", "replace")
    return text + "\n[cut here]\n" if len(data) > LOG_LIMIT else text
