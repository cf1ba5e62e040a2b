"""SciPy's methods over the generated functions: a check, and for arguments that change with time."""

from __future__ import annotations

import warnings
from itertools import pairwise
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from tensegrity_codegen.errors import NonFiniteError
from tensegrity_codegen.runtime.integrate.flow import build_derivative
from tensegrity_codegen.runtime.integrate.methods import find_method
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.profiles.driven import DrivenArguments

__all__ = ["integrate_scipy"]

FloatArray = NDArray[np.float64]


def integrate_scipy(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Integrate a motion by a method of SciPy, begun anew at every kink of a profile.

    Status "unstable" where SciPy does not come to the end.
    """
    method, times = find_method(options.method).scipy, motion.sample_time
    state, count = motion.state, 0
    states: list[FloatArray] = []
    for start, end in pairwise((0.0, *_list_kinks(motion), motion.t_end)):
        is_last = end == motion.t_end
        inside = times[(times >= start) & ((times < end) | is_last)]
        try:
            found = _run(motion, options, (start, end), state, inside)
        except NonFiniteError as error:
            return _end_early(motion, method, states, count, error.problem)
        count += int(found.nfev)
        reached = found.y.T[: len(inside)]
        if found.status != 0 or len(found.t) == 0:
            states += list(reached[: len(found.t)])
            return _end_early(motion, method, states, count, str(found.message))
        states += list(reached)
        state = found.y[:, -1]
    return RawTrajectory(
        time=times,
        state=np.array(states),
        status="ok",
        message=str(found.message),
        method=f"scipy {method}",
        n_steps=len(times),
        n_evaluations=count,
    )


def _list_kinks(motion: Motion) -> list[float]:
    """Return the times [s] within the motion at which its profile has a kink; none without a profile."""
    if not isinstance(motion.schedule, DrivenArguments):
        return []
    pieces = motion.schedule.pieces
    kinks = pieces.time[pieces.is_kink]
    return [float(time) for time in kinks[kinks < motion.t_end]]


def _run(
    motion: Motion, options: RunOptions, span: tuple[float, float], state: FloatArray, inside: FloatArray
) -> Any:
    """Return what SciPy finds at the times `inside` a span and, where it ends at a kink, at its end."""
    schedule = motion.schedule
    until = span[1] < motion.t_end
    last = float(np.nextafter(span[1], span[0]))  # before a jump
    own = None if schedule is None else (lambda t: schedule(min(t, last) if until else t))
    derivative = build_derivative(motion.model, motion.arguments, own)
    times = np.append(inside, span[1]) if until else inside
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what they say is in the status
        return scipy.integrate.solve_ivp(
            derivative,
            span,
            state,
            find_method(options.method).scipy,
            t_eval=times,
            rtol=options.rtol,
            atol=options.absolute,
        )


def _end_early(motion: Motion, method: str, states: list[FloatArray], count: int, why: str) -> RawTrajectory:
    """Return the run that stopped after these samples; the first one is there in any case."""
    kept = np.array(states) if states else motion.state[None, :]
    times, name = motion.sample_time[: len(kept)], f"scipy {method}"
    return RawTrajectory(times, kept, "unstable", why, name, len(states), count)
