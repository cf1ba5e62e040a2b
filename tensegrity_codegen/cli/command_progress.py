"""The progress of one command: what its passes report, what is remembered of earlier runs, the bar."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from tensegrity_codegen.cli.progress_bar import ProgressBar
from tensegrity_codegen.long_work.estimate import Pass, WorkEstimate
from tensegrity_codegen.passes import COMPILING, GENERATING, SETTLING, watched_passes

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["BUILD", "DRAWING", "PLANNING", "SETTLE", "TIMING", "CommandProgress"]

# Seconds for scenes of 12 to 5,400 members: 1 to 8 to generate, 1 to 21 to compile.
BUILD = (Pass(GENERATING, 2.0), Pass(COMPILING, 4.0))
SETTLE = Pass(SETTLING, 2.0)
DRAWING = Pass("drawing", 2.0, is_known=True)
PLANNING = Pass("planning", 20.0)
TIMING = Pass("putting the plan in time", 3.0)


class CommandProgress:
    """The progress of one command.

    Parameters
    ----------
    console : callable
        Returns the console of stderr; called when it is needed.
    passes : sequence of Pass
        What the command does, in that order.
    """

    def __init__(self, console: Callable[[], Console], passes: Sequence[Pass]) -> None:
        self.estimate = WorkEstimate(passes)
        self._bar = ProgressBar(console, self.estimate.look, self._remember)

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Show the passes of the block."""
        self._bar.start()
        with watched_passes(self.estimate):
            yield

    def stop(self) -> None:
        """End the bar."""
        self._bar.stop()

    def keep_durations(self) -> None:
        """Remember how long the passes took, if the command was not a short one."""
        if self.estimate.look().spent >= ProgressBar.DELAY:
            from tensegrity_codegen.cli.durations import write_durations

            write_durations(self.estimate.durations)

    def _remember(self) -> None:
        from tensegrity_codegen.cli.durations import read_durations

        self.estimate.remember(read_durations())
