"""Run the command line in a process of its own, so that Ctrl-C ends it within a second whatever it does.

Python looks at signals between two instructions of its own. A long call into C, or code that catches every
exception, as CasADi's does, would swallow Ctrl-C or delay it. So a second process does the work, and this one
only waits:

    Ctrl-C       -> the worker raises KeyboardInterrupt and cleans up; after GRACE it is killed, and what it
                    had announced (temporary_files.py) is removed here; exit code 130
    other signal -> passed on to the worker
    the worker ends -> this process ends in the same way
    this process is killed -> the worker ends as soon as it can

Systems without fork, and calls in which Ctrl-C is ignored, do the work in this process.
"""

import atexit
import gc
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NoReturn

from tensegrity_codegen.system.temporary_files import read_announcements, remove_leftovers, report_to

INTERRUPTED = 130
GRACE = 0.6  # s from Ctrl-C until the worker is killed
COLLECTED_AFTER = 250_000  # new objects: collecting among those of imports takes a tenth of a verb
SHOW_CURSOR = b"\x1b[?25h"


def main() -> None:
    """Run the command line; the entry of `tensegrity-codegen` and of `python -m tensegrity_codegen`."""
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # looked for in every installed package
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # most matrices are too small for several
        os.environ.setdefault(name, "1")
    gc.set_threshold(COLLECTED_AFTER)
    forks = hasattr(os, "fork") and sys.gettrace() is None
    if forks and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        run_supervised(_run)
    _run()


def _run() -> None:
    from tensegrity_codegen.cli.app import main as run

    try:
        allow_interruption()
        run()
    except SystemExit:
        raise
    except BaseException:
        if not _state["raised"]:
            raise
        os.write(2, b"interrupted\n")  # it was raised where the command line does not catch it
        sys.exit(INTERRUPTED)


def run_supervised(work: Callable[[], object]) -> NoReturn:
    """Call `work` in a forked process and wait for its end; end as it does."""
    passed_on = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
    usual = signal.pthread_sigmask(signal.SIG_BLOCK, (*passed_on, signal.SIGUSR1))
    notes, notes_end = os.pipe()
    life, life_end = os.pipe()
    worker = os.fork()
    if worker == 0:
        os.close(notes)
        os.close(life_end)
        report_to(notes_end)
        _become_worker(life)
        signal.pthread_sigmask(signal.SIG_SETMASK, usual)
        _end_quickly(work)
    os.close(notes_end)
    os.close(life)
    _Waiting(worker, notes).wait(passed_on, usual)


def _end_quickly(work: Callable[[], object]) -> NoReturn:
    """Call `work` and end as Python does, but leave memory to the system if no threads are at work."""
    code: object = None
    try:
        work()
    except SystemExit as end:
        code = end.code
    # The work is done: from here on Ctrl-C only starts the time after which this process is killed.
    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGUSR1,))
    threads = [thread for thread in threading.enumerate() if thread is not threading.main_thread()]
    if isinstance(code, int | None) and all(thread.daemon for thread in threads):
        atexit._run_exitfuncs()
        with suppress(OSError, ValueError):
            for stream in (sys.stdout, sys.stderr):
                if stream is not None:
                    stream.flush()
            os._exit(code or 0)
    sys.exit(code)  # type: ignore[arg-type]


# may_raise: whether KeyboardInterrupt is caught; before, nothing is written that needs cleaning up.
# raised: whether it was raised, which happens once: a second Ctrl-C must not interrupt the cleaning up.
_state = {"may_raise": False, "raised": False}


def allow_interruption() -> None:
    """From now on Ctrl-C raises KeyboardInterrupt in the worker; before, it ends the worker at once."""
    _state["may_raise"] = True


def _become_worker(life: int) -> None:
    """Answer the signal of the waiting process, not Ctrl-C itself, and end when that process is gone."""
    signal.signal(signal.SIGINT, lambda number, frame: None)  # a terminal sends it to both processes
    signal.signal(signal.SIGUSR1, _interrupt)
    sys.unraisablehook = _report_unraisable
    threading.Thread(target=_end_with, args=(life,), name="life", daemon=True).start()


def _interrupt(number: int, frame: Any) -> None:
    if _state["raised"]:
        return
    if _state["may_raise"]:
        _state["raised"] = True
        raise KeyboardInterrupt
    os.write(2, b"interrupted\n")
    os._exit(INTERRUPTED)


def _report_unraisable(dropped: Any) -> None:
    """Report an exception that Python drops, but no KeyboardInterrupt: this process is killed soon after it.

    Python drops what is raised in destructors and in callbacks of weak references, which imports call.
    """
    if not issubclass(dropped.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(dropped)


def _end_with(life: int) -> None:
    """End this process when the other end of the pipe closes."""
    with suppress(OSError):
        os.read(life, 1)
        os._exit(128 + signal.SIGKILL)


class _Waiting:
    """The process that waits for the worker."""

    def __init__(self, worker: int, notes: int) -> None:
        self.worker, self.notes = worker, notes
        self.known: set[str] = set()
        self.advice: list[str | None] = []
        self.rest = b""
        self.deadline: float | None = None

    def wait(self, passed_on: tuple[signal.Signals, ...], usual: set[Any]) -> NoReturn:
        """Pass signals on until the worker has ended, then end as it did."""
        wake, wake_end = os.pipe()
        os.set_blocking(wake, False)
        os.set_blocking(wake_end, False)
        os.set_blocking(self.notes, False)
        signal.set_wakeup_fd(wake_end, warn_on_full_buffer=False)
        for number in (*passed_on, signal.SIGCHLD):
            if signal.getsignal(number) != signal.SIG_IGN:
                signal.signal(number, lambda number, frame: None)
        signal.pthread_sigmask(signal.SIG_SETMASK, usual)
        while True:
            ended, status = os.waitpid(self.worker, os.WNOHANG)
            if ended:
                self._end(status)
            remaining = None if self.deadline is None else max(self.deadline - time.monotonic(), 0.0)
            ready = select.select([wake, self.notes], [], [], remaining)[0]
            self._read_notes()
            if wake in ready:
                self._pass_on(os.read(wake, 512))
            if self.deadline is not None and time.monotonic() >= self.deadline:
                self._kill()

    def _pass_on(self, numbers: bytes) -> None:
        for number in numbers:
            if number == signal.SIGINT:
                self.deadline = self.deadline or time.monotonic() + GRACE
                os.kill(self.worker, signal.SIGUSR1)
            elif number != signal.SIGCHLD:
                os.kill(self.worker, number)

    def _read_notes(self) -> None:
        with suppress(BlockingIOError):
            while data := os.read(self.notes, 65536):
                self.rest = read_announcements(self.rest + data, self.known, self.advice)

    def _kill(self) -> NoReturn:
        """Kill the worker and all that it started, and remove what it left."""
        for process in [*_find_descendants(self.worker), self.worker]:
            with suppress(OSError):
                os.kill(process, signal.SIGKILL)
        os.waitpid(self.worker, 0)
        self._read_notes()
        remove_leftovers(self.known)
        lines = [] if None in self.advice else [*self.advice, "interrupted"]
        report = "".join(f"{line}\n" for line in lines)
        os.write(2, (SHOW_CURSOR if os.isatty(2) else b"") + os.fsencode(report))
        os._exit(INTERRUPTED)

    def _end(self, status: int) -> NoReturn:
        """End as the worker did."""
        self._read_notes()
        if os.WIFSIGNALED(status):
            remove_leftovers(self.known)
            if self.deadline is not None:
                os._exit(INTERRUPTED)
            number = os.WTERMSIG(status)
            signal.signal(number, signal.SIG_DFL) if number != signal.SIGKILL else None
            os.kill(os.getpid(), number)
        os._exit(os.waitstatus_to_exitcode(status))


def _find_descendants(process: int) -> list[int]:
    """Return the processes that a process started, and those that they started; none without /proc."""
    try:
        with open(f"/proc/{process}/task/{process}/children", encoding="ascii") as file:  # noqa: PTH123
            children = [int(number) for number in file.read().split()]
    except OSError:
        return []
    return [descendant for child in children for descendant in (*_find_descendants(child), child)]
