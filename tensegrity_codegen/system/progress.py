"""Progress of long work: parts of a whole, and passes that are reported while they run."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Protocol

ProgressFunction = Callable[[float], None]


def part_of(progress: ProgressFunction | None, start: float, share: float) -> ProgressFunction | None:
    """Return the progress of a part that begins at the fraction `start` and has `share` of the whole."""
    if progress is None:
        return None
    return lambda fraction: progress(start + share * fraction)


# Passes of long work, reported to the display of progress, if there is one.
#
# Code that generates, compiles or integrates does not know who called it. It reports here; the command line
# watches. Without a watcher a report costs one look at a context variable.


GENERATING, COMPILING, SETTLING = "generating C", "compiling", "finding the equilibrium"


class PassWatcher(Protocol):
    """Callbacks as passes begin and end; passes may be nested. title: of the running pass, as shown."""

    title: str

    def begin(self, title: str) -> Callable[[float], None]:
        """Note that a pass begins; return the callback for the fraction of it that is done, 0 to 1."""

    def end(self) -> None:
        """Note that the innermost pass has ended."""


_watcher: ContextVar[PassWatcher | None] = ContextVar("pass watcher", default=None)
_depth: ContextVar[int] = ContextVar("passes within passes", default=0)


@contextmanager
def watched_passes(watcher: PassWatcher) -> Iterator[None]:
    """Report passes to `watcher` within the block."""
    token = _watcher.set(watcher)
    try:
        yield
    finally:
        _watcher.reset(token)


def describe_pass(text: str) -> None:
    """Report the current work, with its count, in work of which no part is known to be done."""
    watcher = _watcher.get()
    if watcher is not None:
        watcher.title = text


@contextmanager
def work_pass(title: str) -> Iterator[Callable[[float], None]]:
    """Report that a pass runs within the block; yield the callback for the fraction of it that is done."""
    watcher = _watcher.get()
    if watcher is None:
        yield lambda fraction: None
        return
    before, depth = watcher.title, _depth.get()
    token = _depth.set(depth + 1)
    move = watcher.begin(title)
    try:
        yield move
    finally:
        watcher.end()
        _depth.reset(token)
        if depth:  # the report of a pass within another is over with it
            watcher.title = before
