"""Standard output and standard error, written as they are."""

import os
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from tensegrity_codegen.system.errors import escape_controls

if TYPE_CHECKING:
    from rich.console import Console


def print_text(text: str) -> None:
    """Write to stdout at once; a reader that has gone away is no error. Raises OSError, as on a full disk."""
    if sys.stdout is None:  # closed by the caller
        return
    try:
        sys.stdout.write(escape_controls(text))
        sys.stdout.flush()
    except OSError as error:
        drop_output(sys.stdout)
        if not isinstance(error, BrokenPipeError):
            raise


def print_aside(line: str) -> None:
    """Write one line to stderr at once; it is dropped if nobody can read it."""
    if sys.stderr is None:  # closed by the caller
        return
    try:
        sys.stderr.write(escape_controls(line) + "\n")
        sys.stderr.flush()
    except OSError:
        drop_output(sys.stderr)


def drop_output(stream: Any) -> None:
    """Let a stream whose reader has gone away lead nowhere, so that closing it at the end does not fail."""
    with suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


NARROW = 70  # columns; below, only title, bar and percentage are shown
WIDEST_TITLE = 0.4  # of the columns


class ProgressBar:
    """The pass of a command that runs, shown on stderr: its title, how far it is, how long it has taken.

    A thread shows it, so that it appears also while nothing reports. On a terminal it is a bar of Rich, from
    DELAY seconds on, that disappears at the end; elsewhere it is a line every INTERVAL seconds.

    console: returns the console of stderr; called when a bar is drawn; clock: time [s].
    """

    DELAY = 1.0  # [s]
    INTERVAL = 10.0  # [s]
    REFRESH = 0.1  # [s]
    IDLE = "working"  # title without a pass

    def __init__(self, console: "Callable[[], Console]", clock: Callable[[], float] = time.monotonic) -> None:
        self.title = self.IDLE
        self._console, self._clock = console, clock
        self._fraction, self._began, self._depth = 0.0, clock(), 0
        self._ended = threading.Event()
        self._wait: Callable[[float], bool] = self._ended.wait
        self._thread = threading.Thread(target=self.show, name="progress", daemon=True)

    def start(self) -> None:
        """Begin to show the progress."""
        self._thread.start()

    def stop(self) -> None:
        """End the bar; nothing is shown any more."""
        self._ended.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join()

    def begin(self, title: str) -> Callable[[float], None]:
        """Begin a pass, hidden within another one; return the function that takes its fraction, 0 to 1."""
        self._depth += 1
        if self._depth > 1:
            return lambda fraction: None
        self.title, self._fraction, self._began = title, 0.0, self._clock()
        return self._move

    def end(self) -> None:
        """End the pass that runs."""
        self._depth -= 1
        if self._depth == 0:
            self.title, self._fraction, self._began = self.IDLE, 0.0, self._clock()

    def _move(self, fraction: float) -> None:
        if fraction > self._fraction:  # else it is an earlier report, or NaN
            self._fraction = min(fraction, 1.0)

    def show(self) -> None:
        """Show the progress until `stop` is called."""
        waited = min(self.DELAY, self.INTERVAL)
        if self._wait(waited):  # most commands end before Rich has to be imported
            return
        if can_draw():
            self._show_bar(self._console(), self.DELAY - waited)
        else:
            self._show_lines(self.INTERVAL - waited)

    def _show_lines(self, wait: float) -> None:
        while not self._wait(wait):
            print_aside(self.describe())
            wait = self.INTERVAL

    def _show_bar(self, console: "Console", wait: float) -> None:
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn
        from rich.table import Column

        if self._wait(wait):
            return
        title = Column(no_wrap=True, overflow="ellipsis", max_width=max(int(WIDEST_TITLE * console.width), 1))
        one_line = Column(no_wrap=True, overflow="ellipsis")
        columns = [
            TextColumn("{task.description}", markup=False, table_column=title),
            BarColumn(bar_width=None, table_column=Column(ratio=1, min_width=4)),
            TaskProgressColumn(table_column=one_line),
        ]
        if console.width >= NARROW:
            columns.append(TextColumn("{task.fields[spent]}", markup=False, table_column=one_line))
        with Progress(*columns, console=console, transient=True, auto_refresh=False, expand=True) as bar:
            task = bar.add_task(self.title, total=None, spent="")
            while not self._wait(self.REFRESH):
                fraction = self._fraction
                bar.update(
                    task,
                    description=self.title,
                    total=1.0 if fraction > 0.0 else None,
                    completed=fraction,
                    spent=self._name_elapsed(),
                    refresh=True,
                )

    def describe(self) -> str:
        """Return one line: "simulating: 40 % after 12 s"."""
        spent, fraction = self._name_elapsed(), self._fraction
        if fraction <= 0.0:
            return f"{self.title}: {spent} so far"
        return f"{self.title}: {int(100.0 * fraction)} % after {spent}"

    def _name_elapsed(self) -> str:
        """Return how long the pass has taken, in whole seconds."""
        seconds = self._clock() - self._began
        return f"{seconds:.0f} s" if seconds < 59.5 else name_duration(seconds)


def can_draw() -> bool:
    """Return whether stderr shows a bar: no file or pipe, whatever FORCE_COLOR says, nor a dumb terminal."""
    try:
        is_terminal = sys.stderr is not None and sys.stderr.isatty()
    except ValueError:  # the stream is closed
        return False
    return is_terminal and os.environ.get("TERM", "").lower() not in ("dumb", "unknown")


def name_duration(seconds: float) -> str:
    """Return a time as text: "0.3 s", "12 s", "3 min 20 s", "2 h 5 min".

    Examples
    --------
    >>> name_duration(3.21), name_duration(200.0), name_duration(7500.0)
    ('3.2 s', '3 min 20 s', '2 h 5 min')
    """
    if seconds < 59.95:
        return f"{seconds:.1f} s"
    total = round(seconds)
    if total < 3600:
        return f"{total // 60} min {total % 60} s"
    return f"{total // 3600} h {total % 3600 // 60} min"
