"""Simulation: one entry, methods by name."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.accuracy.integrate import join_runs
from tensegrity_codegen.runtime.integrate.event_log import Condition
from tensegrity_codegen.runtime.integrate.motion import Progress, Schedule
from tensegrity_codegen.runtime.integrate.options import MOVED_TO_STEPPING, Stepping, read_stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.simulate.motion_input import read_motion
from tensegrity_codegen.runtime.simulate.until import Until, read_until
from tensegrity_codegen.runtime.trajectory.evaluate import evaluate_trajectory
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.system.checks import check_callback, with_moved


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
        method of SciPy (``"scipy_dop853"``, ...): docs/model.md lists them.
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
    Solves H q'' = f(q, q') (docs/model.md). Steps end where cables go slack or taut, if the library has this
    event; ``Trajectory.log`` lists the events.

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
    return replace(evaluate_trajectory(model, raw, motion.arguments, motion.schedule), events=events)
