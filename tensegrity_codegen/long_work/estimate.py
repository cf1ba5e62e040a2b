"""How far work of several passes has come, and how long the rest takes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

__all__ = ["Pass", "WorkEstimate", "WorkState", "name_duration"]

LINEAR = 0.9  # part of a pass of known time without reports that passes at constant speed
EVIDENCE = 3.0  # s of reports before the time left is estimated from them
WINDOW = 30.0  # s; the speed is that of the last WINDOW, or of the last half of the pass
APART = 0.25  # s between two reports that are kept, or this part of the time since the first one:
FINENESS = 1.0 / 128.0


@dataclass(frozen=True)
class Pass:
    """One pass of a longer work.

    Attributes
    ----------
    title : str
        What is done.
    seconds : float
        About how long it takes [s]; decides the part of the bar that it gets.
    is_known : bool
        Whether `seconds` was measured in the same work before, or does not depend on the size of the scene.
    """

    title: str
    seconds: float
    is_known: bool = False


@dataclass(frozen=True)
class WorkState:
    """How far the work is.

    Attributes
    ----------
    title : str
        Title of the pass that runs.
    fraction : float
        Fraction of the whole work that is done; it never decreases.
    spent : float
        Time since the work began [s].
    left : float or None
        Estimated time to its end [s], None where there is no estimate; it never increases, unless `is_late`.
    is_late : bool
        Whether the work takes longer than was estimated before.
    """

    title: str
    fraction: float
    spent: float
    left: float | None = None
    is_late: bool = False


@dataclass(frozen=True)
class _Running:
    """The pass that runs: its place in the whole, when it began [s], reports as (time, fraction)."""

    item: Pass
    base: float
    share: float
    began: float
    marks: tuple[tuple[float, float], ...] = ()


class WorkEstimate:
    """The progress of several passes as one.

    A pass gets the part of what is left of the bar that its `seconds` have in those of all passes to come, so
    that the bar neither stops nor goes back where a pass takes longer, or is not needed. Passes that were not
    announced get a part too. One thread reports, another may call `look`.

    Parameters
    ----------
    passes : sequence of Pass
        The passes to come, in their order.
    title : str
        What is done before the first of them.
    clock : callable
        Time [s].
    """

    def __init__(
        self,
        passes: Sequence[Pass] = (),
        title: str = "working",
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.title = title
        self.started = clock()
        self.durations: dict[str, float] = {}
        self._clock = clock
        self._coming = tuple(passes)
        self._running: _Running | None = None
        self._depth = 0
        self._base = 0.0
        self._shown = WorkState(title, 0.0, 0.0)
        self._least, self._held_since = math.inf, self.started

    def begin(self, title: str) -> Callable[[float], None]:
        """Begin a pass; return what is called with the fraction of it that is done, 0 to 1.

        A pass within another is a part of that and is not shown.
        """
        self._depth += 1
        if self._depth > 1:
            return lambda fraction: None
        found = next((k for k, item in enumerate(self._coming) if item.title == title), None)
        if found is None:
            mean = sum(item.seconds for item in self._coming) / max(len(self._coming), 1)
            item = Pass(title, mean or 1.0)
        else:
            item, self._coming = self._coming[found], self._coming[found + 1 :]
        weight = max(item.seconds, 1e-3)
        share = weight / (weight + sum(other.seconds for other in self._coming))
        self._running = _Running(item, self._base, share * (1.0 - self._base), self._clock())
        self.title = title
        return self._move

    def _move(self, fraction: float) -> None:
        running = self._running
        if running is None or math.isnan(fraction):
            return
        now, marks = self._clock(), running.marks
        done = max(min(fraction, 1.0), marks[-1][1] if marks else 0.0)
        if len(marks) > 1 and marks[-1][0] - marks[-2][0] < max(APART, FINENESS * (now - marks[0][0])):
            marks = marks[:-1]
        self._running = replace(running, marks=(*marks, (now, done)))

    def end(self) -> None:
        """End the pass that runs."""
        self._depth -= 1
        running = self._running
        if self._depth > 0 or running is None:
            return
        spent = self._clock() - running.began
        self.durations[running.item.title] = self.durations.get(running.item.title, 0.0) + spent
        self._base = running.base + running.share
        self._running = None

    def remember(self, durations: Mapping[str, float]) -> None:
        """Take the durations [s] of passes of the same work before."""
        self._coming = tuple(_measured(item, durations) for item in self._coming)
        if self._running is not None:
            self._running = replace(self._running, item=_measured(self._running.item, durations))

    def look(self) -> WorkState:
        """Return how far the work is now."""
        now, running = self._clock(), self._running
        fraction, left = self._base, None
        if running is not None:
            fraction = running.base + running.share * _fraction_of(running, now)
            rest = _left_of(running, now)
            if rest is not None and all(item.is_known for item in self._coming):
                left = rest + sum(item.seconds for item in self._coming)
        fraction = max(fraction, self._shown.fraction)
        left, is_late = self._hold(left, now)
        self._shown = WorkState(self.title, fraction, now - self.started, left, is_late)
        return self._shown

    def _hold(self, left: float | None, now: float) -> tuple[float | None, bool]:
        """Return the time left to show, and whether the work is late.

        An estimate above the least one that was shown does not replace it: that one stays for as long as it
        says; from then on the work is late.
        """
        if left is None:
            return None, False
        if left <= self._least:
            self._least, self._held_since = left, now
            return left, False
        is_late = now - self._held_since > self._least
        return (left if is_late else self._least), is_late


def _measured(item: Pass, durations: Mapping[str, float]) -> Pass:
    seconds = durations.get(item.title)
    return item if seconds is None else Pass(item.title, seconds, is_known=True)


def _fraction_of(running: _Running, now: float) -> float:
    """Return the fraction of a pass that is done: the last one reported, else by its usual time."""
    if running.marks:
        return running.marks[-1][1]
    part = (now - running.began) / max(running.item.seconds, 1e-3)
    if not running.item.is_known:  # it may take many times as long
        return part / (1.0 + part)
    if part <= LINEAR:
        return part
    return 1.0 - (1.0 - LINEAR) / (1.0 + (part - LINEAR) / (1.0 - LINEAR))


def _left_of(running: _Running, now: float) -> float | None:
    """Return the estimated time to the end of a pass [s], None where nothing is known.

    What came before the first report, such as a preparation, does not come again.
    """
    if not running.marks:
        left = running.item.seconds - (now - running.began)
        return left if running.item.is_known and left > 0.0 else None
    first, done = running.marks[0], running.marks[-1][1]
    if done >= 1.0:
        return 0.0
    since = now - max(WINDOW, 0.5 * (now - first[0]))
    begun, before = next((mark for mark in reversed(running.marks) if mark[0] <= since), first)
    if now - begun < EVIDENCE or done <= before:
        return None
    return (now - begun) * (1.0 - done) / (done - before)


def name_duration(seconds: float) -> str:
    """Return a time as text: "0.3 s", "12 s", "3 min 20 s", "2 h 5 min".

    Examples
    --------
    >>> name_duration(3.21), name_duration(200.0), name_duration(7500.0)
    ('3.2 s', '3 min 20 s', '2 h 5 min')
    """
    if seconds < 59.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
