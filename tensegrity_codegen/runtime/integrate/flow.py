"""States between the samples of a motion: integrated anew from a sample, at a tolerance of their own."""

import warnings
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.integrate.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.integrate.motion import Motion, Schedule
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.named_inputs import merge_inputs
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import ConvergenceError

IN_C = ("rk54", "rk853")  # by preference
LOOSENING = (1.0, 1e2, 1e4)  # factors on the tolerance, one after the other, where rounding is in the way
ATOL_OF_STATE = 1e-2  # absolute tolerance over relative tolerance times the largest component


def build_derivative(
    model: CompiledModel, arguments: Mapping[str, Any], schedule: Schedule | None = None
) -> Callable[[float, FloatArray], FloatArray]:
    """Return (t [s], x) -> x' = (q', H^-1 f), with arguments that a schedule may change with time."""
    n = len(model.manifest.coordinate_name)

    def derivative(t: float, x: FloatArray) -> FloatArray:
        given = arguments if schedule is None else {**arguments, **schedule(t)}
        a = model.compute("acceleration", coordinate=x[:n], velocity=x[n:], **given)
        return np.concatenate([x[n:], a])

    return derivative


class Flow:
    """The motion from a state on: by rk54 or rk853 of the library, else by SciPy's DOP853.

    The library's cannot be used where a schedule changes arguments with time.
    """

    def __init__(
        self, model: CompiledModel, arguments: Mapping[str, Any], schedule: Schedule | None = None
    ) -> None:
        self.model, self.arguments = model, merge_inputs(model.manifest, arguments)
        present = [spec.name for spec in model.manifest.integrators]
        in_c = [name for name in IN_C if name in present and schedule is None]
        self._name = in_c[0] if in_c else ""
        self._run = self._in_c if in_c else self._dop853
        self._derivative = build_derivative(model, self.arguments, schedule)

    def states(self, start: float, state: FloatArray, offset: FloatArray, rtol: float) -> FloatArray:
        """Return the states (n, n_states) at start + offset [s]; offset (n,) rises from 0.

        Raises ConvergenceError where the motion cannot be followed even at ten thousand times `rtol`.
        """
        if offset[-1] <= 0.0:
            return np.tile(state, (len(offset), 1))
        size = float(np.abs(state).max(initial=0.0)) or 1.0
        for factor in LOOSENING:
            found = self._run(start, state, offset, factor * rtol, factor * rtol * ATOL_OF_STATE * size)
            if found is not None:
                return found
        raise ConvergenceError(
            "the motion between two samples cannot be integrated again",
            where=self.model.manifest.name,
            evidence={"time": start, "duration": float(offset[-1])},
            hint="take more samples, or tighter tolerances",
        )

    def state(self, start: float, state: FloatArray, offset: float, rtol: float) -> FloatArray:
        """Return the state (n_states,) at start + offset [s]."""
        return np.asarray(self.states(start, state, np.array([0.0, offset]), rtol)[-1])

    def _in_c(
        self, start: float, state: FloatArray, offset: FloatArray, rtol: float, atol: float
    ) -> FloatArray | None:
        motion = Motion(self.model, state, offset, self.arguments)
        raw = integrate_adaptive(motion, RunOptions(self._name, rtol, atol))
        return raw.state if raw.status == "ok" else None

    def _dop853(
        self, start: float, state: FloatArray, offset: FloatArray, rtol: float, atol: float
    ) -> FloatArray | None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what they say is in the status
            found = scipy.integrate.solve_ivp(
                lambda t, x: self._derivative(start + t, x),
                (0.0, float(offset[-1])),
                state,
                "DOP853",
                t_eval=offset,
                rtol=rtol,
                atol=atol,
            )
        return np.asarray(found.y.T) if found.status == 0 else None
