"""A contender: one way to integrate a problem, at several settings of its own."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.system.arrays import FloatArray

REPEATS = 5
LEAST = 0.02  # seconds over which short runs are repeated
ENOUGH = 0.3  # seconds of measuring one setting, unless a single run takes longer


class Unavailable(Exception):
    """Why a contender cannot take part: not installed, or it has no such physics."""


@dataclass(frozen=True)
class Run:
    """What one run brings: positions (n_t, n_nodes, 3) [m] at the sample times, and its own word on it.

    status: "ok" where the method calls its result good; n_evaluations: of forces, 0 where unknown;
    energy_drift: largest change of the total energy [J] at the samples, where the motion keeps it.
    """

    node_position: FloatArray
    status: str
    message: str
    n_steps: int
    n_evaluations: int
    energy_drift: float | None = None


@dataclass(frozen=True)
class Contender:
    """name: unique in a report; group: "own" or "peer"; settings: a tolerance or a step [s] each.

    run: setting -> what makes the Run of it; the call itself integrates and is timed, everything that can be
    prepared being prepared, and what it returns looks at the result.
    """

    name: str
    group: str
    formulation: str
    method: str
    kind: str  # "tolerance" or "step"
    settings: Sequence[float]
    run: Callable[[float], Callable[[], Run]]
    prepare: Callable[[float], object] = float


@dataclass(frozen=True)
class Measurement:
    """One setting of a contender, measured: median seconds of CPU, and the run."""

    seconds: float
    run: Run


def measure(contender: Contender, setting: float, budget: float = ENOUGH) -> Measurement:
    """Return the median CPU time of 5 runs or more, fewer where they take longer than `budget` [s] in all."""
    seconds: list[float] = []
    run: Run | None = None
    contender.prepare(setting)
    while True:
        started = time.process_time()
        look = contender.run(setting)
        seconds.append(time.process_time() - started)
        run = run or look()
        enough = len(seconds) >= REPEATS and sum(seconds) > LEAST
        if run.status != "ok" or enough or sum(seconds) > budget:
            return Measurement(float(np.median(seconds)), run)
