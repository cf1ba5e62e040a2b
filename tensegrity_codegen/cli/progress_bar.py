"""How far a command has come: one bar on a terminal, else a plain line every ten seconds."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

from tensegrity_codegen.cli.streams import print_aside
from tensegrity_codegen.long_work.estimate import WorkState, name_duration

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["ProgressBar", "describe_left", "describe_progress"]

NARROW = 70  # columns; below, only title, bar and percentage are shown
WIDEST_TITLE = 0.4  # of the columns


class ProgressBar:
    """The progress of one command, shown on stderr while it runs.

    A thread shows it, so that it appears also while nothing reports. On a terminal it is a bar, from DELAY
    seconds on, that disappears at the end; elsewhere it is a line every INTERVAL seconds.

    Parameters
    ----------
    console : callable
        Returns the console of stderr; called when a bar is drawn.
    look : callable
        Returns how far the work is.
    wake : callable, optional
        Called once when the command has run for DELAY seconds, in the thread of the bar.
    """

    DELAY = 1.0  # [s]
    INTERVAL = 10.0  # [s]
    REFRESH = 0.1  # [s]

    def __init__(
        self,
        console: Callable[[], Console],
        look: Callable[[], WorkState],
        wake: Callable[[], None] = lambda: None,
    ) -> None:
        self._console, self._look, self._wake = console, look, wake
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

    def show(self) -> None:
        """Show the progress until `stop` is called."""
        waited = min(self.DELAY, self.INTERVAL)
        if self._wait(waited):  # most commands end before Rich has to be imported
            return
        self._wake()
        if can_draw():
            self._show_bar(self._console(), self.DELAY - waited)
        else:
            self._show_lines(self.INTERVAL - waited)

    def _show_lines(self, wait: float) -> None:
        while not self._wait(wait):
            print_aside(describe_progress(self._look()))
            wait = self.INTERVAL

    def _show_bar(self, console: Console, wait: float) -> None:
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
            columns.append(TextColumn("{task.fields[times]}", markup=False, table_column=one_line))
        with Progress(*columns, console=console, transient=True, auto_refresh=False, expand=True) as bar:
            task = bar.add_task(self._look().title, total=None, times="")
            while not self._wait(self.REFRESH):
                state = self._look()
                total = 1.0 if state.fraction > 0.0 else None
                times = ", ".join(filter(None, (_name_whole(state.spent), describe_left(state))))
                bar.update(
                    task,
                    description=state.title,
                    total=total,
                    completed=state.fraction,
                    times=times,
                    refresh=True,
                )


def can_draw() -> bool:
    """Return whether stderr shows a bar: no file or pipe, whatever FORCE_COLOR says, nor a dumb terminal."""
    try:
        is_terminal = sys.stderr is not None and sys.stderr.isatty()
    except ValueError:  # the stream is closed
        return False
    return is_terminal and os.environ.get("TERM", "").lower() not in ("dumb", "unknown")


def describe_progress(state: WorkState) -> str:
    """Return one line: "simulating: 40 % after 12 s, about 18 s left"."""
    spent = _name_whole(state.spent)
    if state.fraction <= 0.0:
        return f"{state.title}: {spent} so far"
    left = describe_left(state)
    return f"{state.title}: {int(100.0 * state.fraction)} % after {spent}" + (f", {left}" if left else "")


def describe_left(state: WorkState) -> str:
    """Return the estimated rest of the time as text, "" where there is no estimate."""
    if state.left is None:
        return ""
    about = f"about {_name_whole(state.left)}"
    return f"longer than estimated, {about} more" if state.is_late else f"{about} left"


def _name_whole(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 59.5 else name_duration(seconds)
