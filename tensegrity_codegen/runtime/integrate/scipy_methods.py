"""SciPy's methods over the generated functions: a check, and for arguments that change with time."""

import warnings
from itertools import pairwise
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.integrate.flow import build_derivative
from tensegrity_codegen.runtime.integrate.methods import find_method
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory, judge_end
from tensegrity_codegen.runtime.profiles.driven import DrivenArguments
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import ConvergenceError, NonFiniteError

LONGEST_STEP = 0.01  # of the time, where a function of time may change anything: steps must not pass over it


class _Steps:
    """The steps of a run, which SciPy shows to what it takes for an event: counted, told and limited."""

    def __init__(self, motion: Motion, most: int) -> None:
        self.motion, self.most, self.count = motion, most, 0

    def __call__(self, time: float, state: FloatArray) -> float:
        self.count += time > 0.0
        if self.count > self.most and time < self.motion.t_end:
            raise ConvergenceError("too many steps", evidence={"time": time})
        self.motion.report(time / self.motion.t_end)
        return 1.0


def integrate_scipy(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Integrate a motion by a method of SciPy, begun anew at every kink of a profile.

    Status "unstable" where SciPy does not come to the end, "not_converged" after max_steps steps.
    """
    method, times = find_method(options.method).scipy, motion.sample_time
    state, count, steps = motion.state, 0, _Steps(motion, options.max_steps)
    states: list[FloatArray] = []

    def finish(status: str, message: str) -> RawTrajectory:
        kept = np.array(states) if states else motion.state[None, :]  # the first one is there in any case
        name = f"scipy {method}"
        return RawTrajectory(times[: len(kept)], kept, status, message, name, steps.count, count)

    for start, end in pairwise((0.0, *_list_kinks(motion), motion.t_end)):
        is_last = end == motion.t_end
        inside = times[(times >= start) & ((times < end) | is_last)]
        try:
            found = _run(motion, options, (start, end), state, inside, steps)
        except NonFiniteError as error:
            return finish("unstable", error.problem)
        except ConvergenceError as error:
            return finish(*judge_end("ok", error.evidence["time"], motion.t_end))
        count += int(found.nfev)
        reached = found.y.T[: len(inside)]
        if found.status != 0 or len(found.t) == 0:
            states += list(reached[: len(found.t)])
            return finish("unstable", str(found.message))
        states += list(reached)
        state = found.y[:, -1]
    return finish("ok", f"{steps.count} steps")


def _list_kinks(motion: Motion) -> list[float]:
    """Return the times [s] within the motion at which its profile has a kink; none without a profile."""
    if not isinstance(motion.schedule, DrivenArguments):
        return []
    pieces = motion.schedule.pieces
    kinks = pieces.time[pieces.is_kink]
    return [float(time) for time in kinks[kinks < motion.t_end]]


def _run(
    motion: Motion,
    options: RunOptions,
    span: tuple[float, float],
    state: FloatArray,
    inside: FloatArray,
    steps: _Steps,
) -> Any:
    """Return what SciPy finds at the times `inside` a span and, where it ends at a kink, at its end."""
    schedule = motion.schedule
    is_function = schedule is not None and not isinstance(schedule, DrivenArguments)
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
            max_step=LONGEST_STEP * motion.t_end if is_function else np.inf,
            events=steps,
        )
