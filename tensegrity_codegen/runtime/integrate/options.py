"""Options of a run: method, tolerances, step and limits in one record, and their checks."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.integrate.methods import find_method, list_methods
from tensegrity_codegen.runtime.integrate.raw_results import MAX_STEPS
from tensegrity_codegen.system.checks import check_instance, check_positive, check_whole
from tensegrity_codegen.system.errors import InvalidValueError, check_choice

ATOL = 1e-9  # of a structure of a metre
MAX_FIXED_STEPS = 100_000_000  # unless `max_steps` allows more: some seconds for a small structure
MAX_STEPS_KEEPING_ENERGY = 100_000_000  # the same of a run that keeps the energy: such runs are long
CONTROLS = ("samples", "steps")  # what the tolerance bounds: the error of every sample, or of each step
KEPT_QUANTITIES = ("energy",)
MAX_SAMPLES = 1_000_000
MAX_STEP_COUNT = 2**53  # steps; beyond, the time n h is no longer told from its neighbours
MIN_SCIPY_RTOL = 100 * np.finfo(np.float64).eps  # SciPy raises smaller ones to this


@dataclass(frozen=True)
class Stepping:
    """Steps and tolerances of a simulation that are rarely stated; as of `simulate` and `simulate_batch`.

    Attributes
    ----------
    step : float, optional [s]
        Step of ``"rk4"``; the result is compared with that of twice the step.
    atol : float, optional
        Absolute tolerance [m and m/s]; by default `rtol`, but at least 1e-9, times the length of the
        structure [m] and the largest speed of its nodes in this motion [m/s], as stated in
        ``Trajectory.evidence`` (``atol``, ``atol_speed``); 1e-9 times the length where `control` is
        ``"steps"``.
    max_steps : int, optional
        Largest number of steps of one run; by default a million, with `keep` a hundred million.
    keep : str
        ``"energy"``: each step of rk54, rk853 or auto ends at the initial energy, for long undamped motions;
        needs a library built with ``keep = ["energy"]``.
    control : str, optional
        What the tolerances limit: ``"samples"`` (default), the estimated error of all samples, for which runs
        are repeated with tighter tolerances; or ``"steps"`` (default with `keep`), the error of each step, in
        one run whose error at the samples is not estimated.
    """

    step: float | None = None
    atol: float | None = None
    max_steps: int | None = None
    keep: str = ""
    control: str | None = None

    def with_method(self, method: str, rtol: float) -> "RunOptions":
        """Return the options of a run by this method and relative tolerance."""
        return complete_run_options(
            method, rtol, self.atol, self.step, self.max_steps, self.keep, self.control
        )


# Arguments of `simulate` and `simulate_batch` that `Stepping` has.
MOVED_TO_STEPPING = {
    name: f"stepping=Stepping({name}=...)" for name in ("step", "atol", "max_steps", "keep", "control")
}


def read_stepping(stepping: Any) -> Stepping:
    """Return steps and tolerances, the usual ones for None; raises InvalidValueError for anything else."""
    check_instance(stepping, (Stepping, type(None)), "stepping", "a Stepping, or None")
    return stepping or Stepping()


@dataclass(frozen=True)
class RunOptions:
    """How a motion is integrated.

    method: one of `METHODS`; rtol, atol: tolerances, relative and in coordinates and velocities, None: by the
    scales of the structure (scales.py); atol_speed: of velocities where that is another; step [s]: of
    fixed-step methods; max_steps: that one run may try; keep: "energy" or nothing; control: whether the
    tolerance bounds the error of "samples" or of "steps"; is_open: whether the method or the absolute
    tolerance are left open, so that runs begin with looser steps, which in explicit methods follow two
    errors.
    """

    method: str = "auto"
    rtol: float = 1e-6
    atol: float | None = None
    step: float | None = None
    max_steps: int = MAX_STEPS
    keep: str = ""
    control: str = "samples"
    atol_speed: float | None = None
    is_open: bool = False

    @property
    def absolute(self) -> float:
        """The absolute tolerance as a number; that of a structure of a metre if none is given."""
        return ATOL if self.atol is None else self.atol

    def as_given(self) -> dict[str, Any]:
        """Return the options as arguments of `simulate`."""
        stepping = Stepping(self.step, self.atol, self.max_steps, self.keep, self.control)
        return {"method": self.method, "rtol": self.rtol, "stepping": stepping}

    def within(self, rtol: float, atol: float) -> "RunOptions":
        """Return the same with other tolerances."""
        return replace(self, rtol=rtol, atol=atol)


def complete_run_options(
    method: str,
    rtol: float,
    atol: float | None,
    step: float | None,
    max_steps: int | None,
    keep: str,
    control: str | None,
) -> RunOptions:
    """Return the options of a run; max_steps, control: None for what suits the rest.

    Runs that keep the energy are long, and motions that go on long enough are beyond any tolerance at the
    samples: of these each step's error is controlled unless asked otherwise.
    """
    check_instance(keep, str, "keep", "a text")
    check_instance(control, (str, type(None)), "control", f"{' or '.join(CONTROLS)}, or None")
    most = MAX_STEPS_KEEPING_ENERGY if keep else MAX_STEPS
    usual = "steps" if keep else "samples"
    return RunOptions(
        method, rtol, atol, step, most if max_steps is None else max_steps, keep, control or usual
    )


def check_options(options: RunOptions, t_end: float, samples: int) -> None:
    """Raise InvalidValueError or UnknownNameError for options that `simulate` cannot work with.

    t_end [s], samples: how long, and how often looked at.
    """
    find_method(options.method)
    _check_keep(options.keep, options.method)
    if options.control not in CONTROLS:
        raise InvalidValueError(
            "unknown control of the error",
            where="control",
            given=options.control,
            allowed=", ".join(CONTROLS),
        )
    check_positive(t_end, "t_end")
    check_whole(samples, "samples", 2, MAX_SAMPLES, "not a number of samples")
    _check_tolerances(options)
    _check_steps(options, t_end)


def _check_keep(keep: str, method: str) -> None:
    """Raise UnknownNameError or InvalidValueError for what no method, or not this one, can keep."""
    if not keep:
        return
    check_choice(keep, KEPT_QUANTITIES, "quantity to keep constant", "keep")
    if not find_method(method).keeps_energy:
        raise InvalidValueError(
            f"method {method!r} cannot keep the energy",
            where="keep",
            given=keep,
            allowed=f"with the methods {', '.join(list_methods('keeps_energy'))}",
            hint='`method="auto"`',
        )


def _check_tolerances(options: RunOptions) -> None:
    check_positive(options.rtol, "rtol")
    if options.atol is not None:
        check_positive(options.atol, "atol")
    if options.rtol >= 1.0:
        raise InvalidValueError(
            "the relative tolerance is out of range",
            where="rtol",
            given=options.rtol,
            allowed="a number > 0 and < 1",
        )
    if find_method(options.method).scipy and options.rtol < MIN_SCIPY_RTOL:
        raise InvalidValueError(
            "too small for SciPy's methods",
            where="rtol",
            given=options.rtol,
            allowed=f"at least {MIN_SCIPY_RTOL:.3g}",
        )


def _check_steps(options: RunOptions, t_end: float) -> None:
    has_step = find_method(options.method).has_fixed_step
    if has_step and options.step is None:
        raise InvalidValueError(
            f"method {options.method!r} needs a step",
            where="step",
            allowed="a finite number > 0 [s]",
            hint='`method="auto"`',
        )
    if not has_step and options.step is not None:
        raise InvalidValueError(
            "only fixed-step methods take a step", where="step", given=options.step, hint='`method="rk4"`'
        )
    check_whole(options.max_steps, "max_steps", 1, MAX_STEP_COUNT)
    if options.step is not None:
        _check_step(options.step, t_end, max(options.max_steps, MAX_FIXED_STEPS))


def _check_step(step: float, t_end: float, most: int) -> None:
    """Raise for a fixed step [s] of which more than `most` go into the time."""
    check_positive(step, "step", "[s]")
    if t_end > most * step * (1.0 + 1e-9):
        raise InvalidValueError(
            "too small for the simulated time",
            where="step",
            given=step,
            allowed=f"at least {t_end / most:.3g} s, which makes {most} steps",
            hint="a longer step, a shorter time, or more steps by `max_steps`",
        )
