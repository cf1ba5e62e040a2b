"""Run commands with limits on time and memory, leaving no process behind however they end."""

import os
import selectors
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

LOG_LIMIT = 1_000_000  # bytes of a log that are kept
SUPERVISOR = Path(__file__).with_name("supervise.py")


@dataclass(frozen=True)
class ChildOutcome:
    """How a command ended.

    ended: "exit" | "signal" | "time" (stopped at the time limit); number: exit status or signal; log: both
    output streams; seconds: wall time; peak_memory: largest resident set [byte], None if unknown.
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
    are killed.
    """
    return run_several(
        [command], folder=folder, environment=environment, timeout=timeout, memory_limit=memory_limit
    )[0]


def run_several(
    commands: Sequence[Sequence[str]],
    *,
    folder: Path,
    environment: Mapping[str, str],
    timeout: float,
    memory_limit: int | None = None,
    workers: int = 1,
) -> list[ChildOutcome]:
    """Run commands side by side, `workers` at a time (on Windows one); limits as in run_limited."""
    settings = (folder, dict(environment), timeout, memory_limit)
    if os.name != "posix" or not sys.executable:
        return [run_alone(list(command), *settings[:3]) for command in commands]
    outcomes: dict[int, ChildOutcome] = {}
    running: dict[int, _Supervised] = {}
    try:
        for number, command in enumerate(commands):
            if len(running) >= max(workers, 1):
                _collect(running, outcomes)
            running[number] = _Supervised(list(command), *settings)
        while running:
            _collect(running, outcomes)
    finally:
        for supervised in running.values():  # after Ctrl-C above all
            supervised.stop()
    return [outcomes[number] for number in range(len(commands))]


class _Supervised:
    """A command that runs under supervise.py, which ends with it or when its standard input closes."""

    def __init__(
        self,
        command: list[str],
        folder: Path,
        environment: dict[str, str],
        timeout: float,
        memory_limit: int | None,
    ) -> None:
        limits = [repr(float(timeout)), str(memory_limit or 0)]
        self.command = command
        self.log = tempfile.TemporaryFile()  # noqa: SIM115 - closed by `stop`
        try:
            self.process = subprocess.Popen(
                [sys.executable, "-I", "-S", str(SUPERVISOR), *limits, *command],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self.log,
                cwd=folder,
                env=environment,
                start_new_session=True,
            )
        except BaseException:
            self.log.close()
            raise

    @property
    def report(self) -> IO[bytes]:
        """Where the supervisor writes its report when all is over."""
        assert self.process.stdout is not None  # a pipe, as asked for
        return self.process.stdout

    def finish(self) -> ChildOutcome:
        """Wait for the end of the command and return how it was."""
        fields = self.report.read().decode("ascii").split()
        if len(fields) != 4:
            raise OSError(f"the supervisor of {self.command[0]} ended early: {_read_log(self.log)}")
        log = _read_log(self.log)
        self.stop()
        return ChildOutcome(fields[0], int(fields[1]), log, float(fields[2]), int(fields[3]))

    def stop(self) -> None:
        """End the command and its supervisor, if they still run."""
        assert self.process.stdin is not None
        self.process.terminate()
        self.process.stdin.close()
        self.report.close()
        self.process.wait()
        self.log.close()


def _collect(running: dict[int, _Supervised], outcomes: dict[int, ChildOutcome]) -> None:
    """Move those that have ended, at least one, from `running` to `outcomes`."""
    with selectors.DefaultSelector() as selector:
        for number, supervised in running.items():
            selector.register(supervised.report, selectors.EVENT_READ, number)
        ended = [key.data for key, _ in selector.select()]
    for number in ended:
        outcomes[number] = running[number].finish()
        del running[number]


def run_alone(
    command: list[str], folder: Path, environment: Mapping[str, str], timeout: float
) -> ChildOutcome:
    """Run directly, for questions and where there is no fork: time limit only, if this process lives on."""
    is_posix = os.name == "posix"
    started = time.monotonic()
    with (
        tempfile.TemporaryFile() as log,
        subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            cwd=folder,
            env=environment,
            start_new_session=is_posix,
        ) as child,
    ):
        try:
            number = child.wait(timeout)
            ended = "exit" if number >= 0 else "signal"
        except subprocess.TimeoutExpired:
            ended, number = "time", 0
        finally:
            if child.returncode is None:
                os.killpg(child.pid, signal.SIGKILL) if is_posix else child.kill()
        return ChildOutcome(ended, abs(number), _read_log(log), time.monotonic() - started, None)


def _read_log(log: IO[bytes]) -> str:
    log.seek(0)
    data = log.read(LOG_LIMIT + 1)
    text = data[:LOG_LIMIT].decode("utf-8", "replace")
    return text + "\n[cut here]\n" if len(data) > LOG_LIMIT else text
