"""Simulation: one entry, methods by name, and motions that a contact of bars or a condition ends."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.accuracy.integrate import integrate, join_runs
from tensegrity_codegen.runtime.integrate.event_log import Condition, Watch
from tensegrity_codegen.runtime.integrate.methods import find_method, list_methods
from tensegrity_codegen.runtime.integrate.motion import Motion, Progress, Schedule
from tensegrity_codegen.runtime.integrate.options import (
    MOVED_TO_STEPPING,
    RunOptions,
    Stepping,
    read_stepping,
)
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.integrate.scipy_methods import find_distances
from tensegrity_codegen.runtime.model.interface import require_quantities
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.driven import follows_in_c
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.simulate.condition import build_condition, is_comparison
from tensegrity_codegen.runtime.simulate.motion_input import read_motion
from tensegrity_codegen.runtime.trajectory.evaluate import evaluate_trajectory
from tensegrity_codegen.runtime.trajectory.trajectory import MotionEvent, Trajectory
from tensegrity_codegen.system.checks import check_callback, check_switch, with_moved
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.manifest import JUMP_KINDS

CONTACT_QUANTITIES = ("bar_distance",)  # that contacts need besides those of a simulation
SAME_TIME = 1e-9  # of the simulated time: contacts this near happen at once


@dataclass(frozen=True)
class Until:
    """What is watched along a motion, and which of it ends the motion; as of `simulate`.

    Attributes
    ----------
    condition : str or callable, optional
        An expression over quantities such as ``"top.z < 0.1"``, or (time, coordinate, velocity) -> float.
        Steps end where it changes its sign; needs the event ``"condition"``.
    contact : bool
        Whether the motion ends at the first contact of bars; needs ``bar_distance`` and the event
        ``"contact"``.
    stops : bool
        Whether the motion ends at the first change of the condition; a comparison ends it at 0 if it is true
        there. False: changes are only listed in ``Trajectory.log``.
    """

    condition: str | Condition | None = None
    contact: bool = False
    stops: bool = True

    def watch(
        self,
        model: CompiledModel,
        method: str,
        arguments: Mapping[str, Any],
        schedule: Schedule | None = None,
    ) -> Watch | None:
        """Return the events for the integrator, jumps of stiffness too if it knows them; None: as usual."""
        # The condition, then contacts, beside jumps of stiffness.
        condition = self.condition
        kinds: list[str] = []
        stop: list[str] = []
        call = condition if callable(condition) else None
        if condition is not None:
            if not (isinstance(condition, str) or callable(condition)):
                raise InvalidValueError(
                    "not a condition",
                    where="condition",
                    given=condition,
                    allowed='a text such as "top.z < 0.1", or a function (time, coordinate, velocity) -> '
                    "float",
                )
            _check_method(model, method, schedule)
            if isinstance(condition, str):
                call = build_condition(condition, model, arguments, schedule)
            kinds.append("condition")
            stop += ["condition"] if self.stops else []
        if self.contact:
            require_quantities(model, CONTACT_QUANTITIES, "these events need")
            kinds.append("contact")
            stop.append("contact")
        if not kinds:
            return None
        events = {spec.name: spec.events for spec in model.manifest.integrators}
        kinds_of_method = events.get(
            method, [kind for method_kinds in events.values() for kind in method_kinds]
        )
        return Watch((*(kind for kind in JUMP_KINDS if kind in kinds_of_method), *kinds), tuple(stop), call)

    def integrate(self, motion: Motion, options: RunOptions) -> tuple[RawTrajectory, tuple[MotionEvent, ...]]:
        """Return the samples up to the event that ends the motion, at its start at once, and that event."""
        if self.contact:
            # What a longer fixed step makes of bars that go through each other says nothing.
            options = options if options.step is None else replace(options, control="steps")
            touching = find_distances(motion, motion.state) <= 0.0
            if touching.any():
                pairs = zip(motion.model.manifest.bar_pair_name, touching.tolist(), strict=True)
                inside = tuple(name for name, touches in pairs if touches)
                return _tell_contact(motion, _stay(motion, options, ""), inside)
        if self.stops and self._holds_at_start(motion):
            raw = _stay(motion, options, "the condition holds from the start")
            return raw, (self._describe_condition(raw),)
        raw = integrate(motion, options)
        log = raw.log
        kind = log.kind[-1] if log.count and raw.time[-1] >= log.time[-1] else ""
        if self.stops and kind == "condition":
            return raw, (self._describe_condition(raw),)
        if self.contact:
            same = log.time >= raw.time[-1] - SAME_TIME * motion.t_end
            rows = zip(log.name, log.kind, same.tolist(), strict=True)
            names = tuple(name for name, event_kind, is_same in rows if event_kind == "contact" and is_same)
            return _tell_contact(motion, raw, names if kind == "contact" else ())
        return raw, ()

    def _holds_at_start(self, motion: Motion) -> bool:
        """Return whether the condition is a comparison that is true at the start."""
        if not isinstance(self.condition, str) or not is_comparison(self.condition):
            return False
        n = len(motion.state) // 2
        assert motion.watch is not None
        assert motion.watch.condition is not None
        return motion.watch.condition(0.0, motion.state[:n], motion.state[n:]) > 0

    def _describe_condition(self, raw: RawTrajectory) -> MotionEvent:
        """Return the condition as the event at the last sample of a run."""
        name = self.condition if isinstance(self.condition, str) else "condition"
        n, state = raw.state.shape[1] // 2, raw.state[-1]
        return MotionEvent("condition", (name,), float(raw.time[-1]), 0.0, state[:n], state[n:])


def read_until(until: "Until | str | Condition | None") -> Until:
    """Return the end of a motion: "contact", a condition, or an `Until`; raises InvalidValueError."""
    if not isinstance(until, Until):
        return Until(contact=True) if isinstance(until, str) and until == "contact" else Until(until)
    check_switch(until.contact, "until.contact")
    check_switch(until.stops, "until.stops")
    return until


def _check_method(model: CompiledModel, method: str, schedule: Schedule | None) -> None:
    """Raise InvalidValueError if a run by this method, or with this schedule, watches no conditions."""
    if not find_method(method).finds_events:
        raise InvalidValueError(
            "this method does not monitor conditions",
            where="condition",
            given=method,
            allowed=", ".join(list_methods("finds_events")),
        )
    if schedule is not None and not follows_in_c(schedule, model.manifest):
        raise InvalidValueError(
            "a run with this schedule uses SciPy, which does not monitor conditions",
            where="condition",
            given="schedule and condition",
            allowed="one of them",
            hint="make the schedule a Profile of inputs, or evaluate the condition at the samples of the run",
        )


def _stay(motion: Motion, options: RunOptions, message: str) -> RawTrajectory:
    """Return the run of a motion that is over at its start."""
    return RawTrajectory(motion.sample_time[:1], motion.state[None, :], "ok", message, options.method, 0, 0)


def _tell_contact(
    motion: Motion, raw: RawTrajectory, names: tuple[str, ...]
) -> tuple[RawTrajectory, tuple[MotionEvent, ...]]:
    """Return a run with a word on the contact at its last sample of these pairs of bars, and that event."""
    if not names:
        return replace(raw, message="; ".join(filter(None, [raw.message, "no contact"]))), ()
    n, state, time = raw.state.shape[1] // 2, raw.state[-1], float(raw.time[-1])
    sentence = f"contact of {', '.join(names)} at t = {time:.9g} s"
    margin = float(np.min(find_distances(motion, state)))
    event = MotionEvent("contact", names, time, margin, state[:n], state[n:])
    return replace(raw, message="; ".join(filter(None, [raw.message, sentence]))), (event,)


@with_moved(
    **MOVED_TO_STEPPING,
    until_contact='until="contact", or until=Until(contact=True)',
    condition="until=..., or until=Until(condition=..., stops=False) where the motion goes on",
    until_condition="until=..., a condition",
)
def simulate(
    model: CompiledModel,
    t_end: float,
    *,
    samples: int | ArrayLike = 101,
    method: str = "auto",
    rtol: float = 1e-6,
    coordinate: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    arguments: Mapping[str, Any] | None = None,
    schedule: Profile | Schedule | None = None,
    until: str | Condition | Until | None = None,
    stepping: Stepping | None = None,
    progress: Progress | None = None,
) -> Trajectory:
    """Integrate the equations of motion from the initial state.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"simulate"``, see compile_scene.
    t_end : float
        End time [s]; the motion starts at 0.
    samples : int or array_like, shape (n_t,)
        Number of equally spaced sample times, 0 and t_end included; or the times themselves [s], increasing
        from 0 to t_end.
    method : str
        ``"auto"``, the name of an integrator of the library (``"rk853"``, ``"rk54"``, ``"rk4"``, ...) or of a
        method of SciPy (``"scipy_dop853"``, ...): docs/motions.md lists them.
    rtol : float
        Relative tolerance.
    coordinate, velocity : array_like, shape (n_coordinates,), optional
        Initial state [m, m/s]; by default that of the scene.
    arguments : mapping, optional
        Values of run-time parameters and inputs by name, where they differ from the scene.
    schedule : Profile or callable, optional
        Values that change with time: knots of a `Profile`, which all methods in C follow where accelerations
        depend on inputs, or a function time [s] -> such a mapping, for ``"auto"`` and SciPy methods, whose
        steps are then at most a hundredth of the time.
    until : str, callable or Until, optional
        What ends the motion early: ``"contact"`` of bars, a condition such as ``"top.z < 0.1"`` or
        (time, coordinate, velocity) -> float; an `Until` also for both, or for a condition that is only
        watched.
    stepping : Stepping, optional
        Step of ``"rk4"``, absolute tolerance, largest number of steps, kept energy, what tolerances limit.
    progress : callable, optional
        Called with the part of the work that is done, 0 to 1.

    Returns
    -------
    Trajectory
        The samples, with status and message; a run that fails returns the samples that it reached.

    Raises
    ------
    InvalidValueError
        A value or option is out of range.
    UnknownNameError
        An unknown method, argument or quantity.
    FormulationError
        The library lacks a function, integrator or event.
    NonFiniteError
        An argument, the initial state or the condition is not finite.

    Notes
    -----
    Solves H q'' = f(q, q') (docs/motions.md). Steps end where cables go slack or taut, if the library has
    this event; ``Trajectory.log`` lists the events.

    Examples
    --------
    >>> from tensegrity_codegen import compile_scene, simulate
    >>> model = compile_scene("two_nodes.toml", for_="simulate")
    >>> trajectory = simulate(model, t_end=0.1, samples=11)
    >>> trajectory.status, trajectory.node_position.shape
    ('ok', (11, 2, 3))
    """
    check_callback(progress, "progress")
    ending = read_until(until)
    options = read_stepping(stepping).with_method(method, rtol)
    motion = read_motion(model, options, t_end, samples, arguments, schedule, coordinate, velocity)
    watch = ending.watch(model, options.method, motion.arguments, motion.schedule)
    follow = progress if options.control == "steps" else join_runs(progress)
    raw, events = ending.integrate(replace(motion, progress=follow, watch=watch), options)
    if progress is not None:
        progress(1.0)
    return evaluate_trajectory(model, raw, motion.arguments, motion.schedule, events)
