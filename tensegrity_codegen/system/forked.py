"""Independent pieces of work side by side, each in a process of its own that can be ended at any moment."""

import multiprocessing
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any, Generic, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

DEFERRED = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGUSR1") if hasattr(signal, name)
)  # those that interrupt this program
PR_SET_PDEATHSIG = 1  # of prctl
LOOK = 0.5  # seconds between two looks at the clock


@dataclass(frozen=True)
class Piece(Generic[Result]):
    """The result of one item by its index; without one, `problem` tells how its process ended."""

    index: int
    result: Result | None
    problem: str = ""


def can_fork() -> bool:
    """Return whether this system makes processes by fork."""
    return "fork" in multiprocessing.get_all_start_methods()


def count_workers() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_pieces(
    work: Callable[[Item], Result],
    items: Sequence[Item],
    *,
    deadline: float,
    workers: int,
    look: Callable[[], None] = lambda: None,
) -> Generator[Piece[Result], None, None]:
    """Yield the result of every item as it ends, in any order.

    At the deadline (of time.monotonic) running items are ended, and unfinished ones are not yielded. Where
    the caller stops, by an exception or Ctrl-C, all processes are ended too. `look` is called about twice a
    second. If the system cannot fork, items run one after the other in this process.
    """
    if not can_fork():
        yield from _run_here(work, items, deadline)
        return
    waiting = list(enumerate(items))[::-1]
    running: dict[Connection, tuple[int, Any]] = {}
    try:
        while (waiting or running) and time.monotonic() < deadline:
            while waiting and len(running) < workers:
                index, item = waiting.pop()
                receiver, child = _start(work, item)
                running[receiver] = (index, child)
            remaining = max(0.0, deadline - time.monotonic())
            ready = wait(list(running), min(LOOK, remaining))
            for receiver in [item for item in running if item in ready]:
                index, child = running.pop(receiver)
                yield _receive(receiver, index, child)
            look()
    finally:
        for receiver, (_, child) in running.items():
            end_process(child)
            receiver.close()


def _run_here(
    work: Callable[[Item], Result], items: Sequence[Item], deadline: float
) -> Iterator[Piece[Result]]:
    for index, piece in enumerate(items):
        if time.monotonic() >= deadline:
            return
        yield Piece(index, work(piece))


def _start(work: Callable[[Item], Result], item: Item) -> tuple[Connection, Any]:
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    child = context.Process(target=_answer, args=(work, item, sender))
    try:
        with warnings.catch_warnings(), deferred_signals():
            warnings.simplefilter("ignore", DeprecationWarning)  # of fork beside the thread of a progress bar
            child.start()
    except BaseException:  # an interruption that came within the fork
        if child.pid is not None:
            end_process(child)
        receiver.close()
        raise
    finally:
        sender.close()
    return receiver, child


@contextmanager
def deferred_signals() -> Iterator[None]:
    """Let handlers of signals wait until the block has ended; Python drops their exceptions within a fork."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    previous = {number: signal.getsignal(number) for number in DEFERRED}
    handlers = {number: handler for number, handler in previous.items() if callable(handler)}
    for number in handlers:
        signal.signal(number, lambda number, frame: came.append(number))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    for number in came:
        handlers[signal.Signals(number)](number, None)


def _answer(work: Callable[[Item], Result], item: Item, sender: Connection) -> None:
    _end_with_parent()
    os.setpgid(0, 0)  # Ctrl-C reaches the parent alone, which ends this process and all that it started
    for number in DEFERRED:
        signal.signal(number, signal.SIG_IGN)
    with suppress(OSError):  # the parent is gone
        try:
            sender.send((work(item), ""))
        except Exception as error:
            sender.send((None, f"{type(error).__name__}: {error}"[:500]))


def _end_with_parent() -> None:
    """Let the system end this process when its parent ends, even by SIGKILL; Linux alone can do so."""
    if sys.platform != "linux":
        return
    import ctypes

    parent = os.getppid()
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it ended before
        os._exit(128 + signal.SIGKILL)


def _receive(receiver: Connection, index: int, child: Any) -> Piece[Any]:
    try:
        result, problem = receiver.recv()
    except EOFError:
        child.join()
        result, problem = None, f"its process ended with code {child.exitcode}"
    end_process(child)
    receiver.close()
    return Piece(index, result, problem)


def end_process(child: Any) -> None:
    """End a process and all that it started."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(child.pid, signal.SIGKILL)
    child.kill()
    child.join()
