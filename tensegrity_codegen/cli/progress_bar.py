"""How far a command has come: one bar on a terminal, else a plain line every ten seconds."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["ProgressBar"]


class ProgressBar:
    """The progress of one command, shown on stderr while it runs; `console` is called when it is needed.

    A thread shows it, so that it appears also while nothing calls `move`. On a terminal it is a bar, from
    DELAY seconds on, that disappears at the end; elsewhere it is a line every INTERVAL seconds.
    """

    DELAY = 1.0  # [s]
    INTERVAL = 10.0  # [s]

    def __init__(self, console: Callable[[], Console], title: str) -> None:
        self.title = title
        self._console = console
        self._fraction: float | None = None
        self._first: tuple[float, float] | None = None  # time [s] and fraction of the first report
        self._started = time.monotonic()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._show, name="progress", daemon=True)

    def start(self) -> None:
        """Begin to show the progress."""
        self._thread.start()

    def move(self, fraction: float) -> None:
        """Say which fraction of the whole work is done, 0 to 1."""
        self._first = self._first or (time.monotonic(), fraction)
        self._fraction = fraction

    def stop(self) -> None:
        """End the bar; nothing is shown any more."""
        self._ended.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join()

    def _show(self) -> None:
        waited = min(self.DELAY, self.INTERVAL)
        if self._ended.wait(waited):  # most commands end before Rich has to be imported
            return
        console = self._console()
        if console.is_terminal:
            self._show_bar(console, self.DELAY - waited)
        else:
            self._show_lines(console, self.INTERVAL - waited)

    def _show_lines(self, console: Console, wait: float) -> None:
        while not self._ended.wait(wait):
            console.print(self._line(), markup=False, soft_wrap=True)
            wait = self.INTERVAL

    def _line(self) -> str:
        now, done = time.monotonic(), self._fraction
        spent = now - self._started
        if not done:
            return f"{self.title}: {spent:.0f} s so far"
        return f"{self.title}: {100.0 * done:.0f} % after {spent:.0f} s{self._left(now)}"

    def _left(self, now: float) -> str:
        """Return ", about 12 s left" at the speed since the first report, "" where nothing is known.

        What came before the first report, such as compilation, does not come again.
        """
        done = self._fraction
        if not done or self._first is None:
            return ""
        begun, before = self._first
        if done <= before:  # one report so far
            begun, before = self._started, 0.0
        return f", about {(now - begun) * (1.0 - done) / (done - before):.0f} s left"

    def _show_bar(self, console: Console, wait: float) -> None:
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

        if self._ended.wait(wait):
            return
        left = TextColumn("{task.fields[left]}")
        columns = (
            *(TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn()),
            left,
        )
        with Progress(*columns, console=console, transient=True) as bar:
            task = bar.add_task(self.title, total=None, left="")
            while not self._ended.wait(0.1):
                done = self._fraction
                text = self._left(time.monotonic()).removeprefix(", ")
                bar.update(task, description=self.title, total=done and 1.0, completed=done or 0.0, left=text)
