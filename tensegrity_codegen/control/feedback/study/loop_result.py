"""One loop of a study over all draws."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.control.feedback.loop.control_run import ControlRun
from tensegrity_codegen.control.feedback.study.run_measures import RunMeasures
from tensegrity_codegen.system.arrays import FloatArray

OPEN = "open"
LOOPS = (OPEN, "true_state", "estimator")


@dataclass(frozen=True, eq=False)
class LoopResult:
    """One loop over all draws; those of the end are over the last part of the time.

    Attributes
    ----------
    name : str
        ``"open"``, ``"true_state"`` or ``"estimator"``.
    measures : tuple of RunMeasures
        Of each draw: status, errors, tensions, limits, statuses of the commands.
    run : ControlRun
        The run of the worst draw of the study.
    """

    name: str
    measures: tuple[RunMeasures, ...]
    run: ControlRun

    @classmethod
    def collect(cls, name: str, rows: Sequence[RunMeasures], run: ControlRun) -> "LoopResult":
        """Return the result of a loop."""
        return cls(name, tuple(rows), run)

    @property
    def unstable(self) -> int:
        """Number of draws in which the simulation stopped."""
        return sum(row.is_unstable for row in self.measures)

    @property
    def end_error(self) -> FloatArray:
        """Largest distance of a node from the motion at the end of each draw, (n_draws,) [m]."""
        return np.array([row.end_error for row in self.measures])

    @property
    def end_angle(self) -> FloatArray:
        """Largest error of an angle at the end of each draw, (n_draws,) [rad]; nan without angles."""
        return np.array([row.end_angle for row in self.measures])

    @property
    def peak_error(self) -> FloatArray:
        """Largest distance of a node from the motion in each draw, (n_draws,) [m]."""
        return np.array([row.peak_error for row in self.measures])

    @property
    def least_tension(self) -> FloatArray:
        """Least tension of the cables in each draw, (n_draws,) [N]."""
        return np.array([row.least_tension for row in self.measures])

    @property
    def end_tension(self) -> FloatArray:
        """Least tension of the cables at the end of each draw, (n_draws,) [N]."""
        return np.array([row.end_tension for row in self.measures])

    @property
    def steps(self) -> dict[str, int]:
        """Number of commands of each status, over all draws."""
        words = dict.fromkeys(("ok", *(word for row in self.measures for word in row.steps)))
        return {word: sum(row.steps.get(word, 0) for row in self.measures) for word in words}

    @property
    def broken(self) -> dict[str, tuple[str, ...]]:
        """Limits of the scene that are exceeded at the end of any draw, with members or pairs of bars."""
        found: dict[str, tuple[str, ...]] = {}
        for row in self.measures:
            for name, who in row.broken.items():
                found[name] = tuple(dict.fromkeys((*found.get(name, ()), *who)))
        return found
