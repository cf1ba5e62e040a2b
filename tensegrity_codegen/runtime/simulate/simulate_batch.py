"""Simulation of a batch: many starts, or parameter sets, of one structure."""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.accuracy.batch_control import integrate_batch_to_samples
from tensegrity_codegen.runtime.accuracy.integrate import join_runs
from tensegrity_codegen.runtime.accuracy.rates import find_fastest_of_batch
from tensegrity_codegen.runtime.accuracy.scales import set_atol_by_length
from tensegrity_codegen.runtime.accuracy.step_doubling import check_batch_by_doubling
from tensegrity_codegen.runtime.integrate.batch_integration import integrate_batch, runs_side_by_side
from tensegrity_codegen.runtime.integrate.motion import Motion, Progress, Schedule
from tensegrity_codegen.runtime.integrate.options import (
    MOVED_TO_STEPPING,
    RunOptions,
    Stepping,
    check_options,
    read_stepping,
)
from tensegrity_codegen.runtime.integrate.raw_results import NOT_ESTIMATED, RawBatch
from tensegrity_codegen.runtime.model.arguments import check_arguments, merge_inputs
from tensegrity_codegen.runtime.model.arrays import agree_on_rows, to_batch
from tensegrity_codegen.runtime.model.consistent import make_consistent
from tensegrity_codegen.runtime.model.interface import require_model
from tensegrity_codegen.runtime.model.library import check_threads
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.simulate.motion_input import (
    check_profiles,
    check_sample_memory,
)
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.evaluate import evaluate_batch, select_motion
from tensegrity_codegen.runtime.trajectory.sampled import SAMPLED, STATE
from tensegrity_codegen.runtime.trajectory.simulation_quantities import require_simulation
from tensegrity_codegen.runtime.trajectory.trajectory import BatchTrajectory, Trajectory
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_callback, with_moved
from tensegrity_codegen.system.errors import NonFiniteError
from tensegrity_codegen.tables.manifest import SET_STATES


@with_moved(**MOVED_TO_STEPPING)
def simulate_batch(
    model: CompiledModel,
    t_end: float,
    *,
    samples: int = 101,
    method: str = "rk853",
    rtol: float = 1e-6,
    coordinate: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    arguments: Mapping[str, Any] | None = None,
    schedule: Profile | Schedule | Sequence[Profile | Schedule] | None = None,
    stepping: Stepping | None = None,
    threads: int = 1,
    progress: Progress | None = None,
) -> BatchTrajectory:
    """Integrate the equations of motion for many initial states or parameter sets.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"simulate_batch"``, see compile_scene.
    t_end : float
        End time [s].
    samples : int
        Number of equally spaced sample times.
    method : str
        Explicit methods in C integrate several motions in the vector lanes of a core; steps do not end at
        events, and motions whose error that leaves beyond the tolerance, or on the ground and of members with
        memory, are integrated one after the other, as by any other method of `simulate`.
    rtol : float
        Relative tolerance.
    coordinate, velocity : array_like, shape (n_coordinates,) or (n_batch, n_coordinates), optional
        Initial states [m, m/s]; by default that of the scene.
    arguments : mapping, optional
        Run-time parameters and inputs by name, with or without a leading axis (n_batch,). At least one of the
        arrays has that axis, or `schedule` is a sequence.
    schedule : Profile or callable, or a sequence of n_batch of them, optional
        As in `simulate`, the same for all motions or one for each; integrates one motion after the other.
    stepping : Stepping, optional
        As in `simulate`. ``control="steps"`` is several times as fast, and the error is not estimated; kept
        energy integrates one motion after the other.
    threads : int
        Number of threads; the results do not depend on it.
    progress : callable, optional
        Called with the part of the work that is done, 0 to 1.

    Returns
    -------
    BatchTrajectory
        Samples with one row per motion, and a status for each; a motion that fails does not affect the
        others.

    Raises
    ------
    InvalidValueError
        A shape or option is out of range.
    UnknownNameError
        An unknown method or argument.
    LibraryError
        The library has no batch functions.
    FormulationError
        The library lacks the integrator, or a quantity of the samples.

    Notes
    -----
    Each motion has its own time and step; with reference flags it is bit-equal to a single run without
    events.

    Examples
    --------
    >>> import numpy as np
    >>> from tensegrity_codegen import compile_scene, simulate_batch
    >>> model = compile_scene("two_nodes.toml", for_="simulate_batch")
    >>> batch = simulate_batch(model, 0.1, samples=3, coordinate=np.array([[0, 0, -1.0], [0, 0, -1.1]]))
    >>> batch.status, batch.node_position.shape
    (('ok', 'ok'), (2, 3, 2, 3))
    """
    require_model(model)
    check_callback(progress, "progress")
    options = read_stepping(stepping).with_method(method, rtol)
    check_options(options, t_end, samples)
    require_simulation(model)
    needs_events = any(model.manifest.subjects_of(kind) for kind in SET_STATES)
    side_by_side = runs_side_by_side(options, model.manifest) and schedule is None and not needs_events
    check_threads(threads)
    schedules = tuple(schedule) if isinstance(schedule, Sequence) else schedule
    check_profiles(model, schedules, arguments)
    merged = merge_inputs(model.manifest, arguments, is_batch=True, dtype=model.dtype)
    starts = _read_starts(model, coordinate, velocity, merged, schedules)
    check_sample_memory(model.manifest, len(starts.state) * samples)
    times = np.linspace(0.0, t_end, samples)
    if not side_by_side:
        return _simulate_one_by_one(model, starts, times, options, schedules, threads, progress)
    run_arguments = {name: array for name, (array, _) in starts.arguments.items()}
    motion = Motion(model, _make_consistent(model, starts), times, run_arguments, progress)
    raw = _integrate(motion, options, threads)
    return evaluate_batch(model, raw, starts.arguments, threads)


@dataclass(frozen=True)
class _Starts:
    """Initial states (n_batch, n_states), and run-time arguments with whether each has one row a motion."""

    state: FloatArray
    arguments: Mapping[str, tuple[FloatArray, bool]]


def _read_starts(
    model: CompiledModel,
    coordinate: ArrayLike | None,
    velocity: ArrayLike | None,
    arguments: Mapping[str, Any],
    schedules: Sequence[Profile | Schedule] | Profile | Schedule | None,
) -> _Starts:
    check_arguments(model.manifest, arguments)
    batched_arguments = {
        name: to_batch(value, model.nominal(name).shape, model.library.precision, name)
        for name, value in arguments.items()
    }
    initial = {"coordinate": _read_initial(model, "coordinate", coordinate)}
    initial["velocity"] = _read_initial(model, "velocity", velocity)
    lengths = {
        name: len(array) for name, (array, is_batched) in (batched_arguments | initial).items() if is_batched
    }
    if isinstance(schedules, Sequence):
        lengths["schedule"] = len(schedules)
    n_batch = agree_on_rows(lengths, "simulate_batch", "use simulate() for a single motion")
    rows = [array if is_batched else np.tile(array, (n_batch, 1)) for array, is_batched in initial.values()]
    return _Starts(np.concatenate(rows, axis=1), batched_arguments)


def _integrate(motion: Motion, options: RunOptions, threads: int) -> RawBatch:
    """Return the samples of a batch, compared with those of other steps unless `control` is "steps"."""
    if options.control == "steps":
        batch = integrate_batch(motion, set_atol_by_length(motion.model.manifest, options), threads)
        message = (
            f"{reported}; {NOT_ESTIMATED}" if status == "ok" else reported
            for status, reported in zip(batch.status, batch.message, strict=True)
        )
        return replace(batch, message=tuple(message))
    motion = replace(motion, progress=join_runs(motion.progress))
    if options.step is None:
        return integrate_batch_to_samples(motion, options, threads)

    def run(step: float) -> RawBatch:
        return integrate_batch(motion, replace(options, step=step), threads)

    return check_batch_by_doubling(
        run, options.step, motion.model.manifest, find_fastest_of_batch(motion, threads)
    )


def _read_initial(model: CompiledModel, name: str, value: ArrayLike | None) -> tuple[FloatArray, bool]:
    nominal = model.nominal(name)
    return to_batch(nominal if value is None else value, nominal.shape, model.library.precision, name)


def _make_consistent(model: CompiledModel, starts: _Starts) -> FloatArray:
    """Return the states, brought onto the constraints between coordinates where a model has any."""
    state = starts.state
    if not model.has("consistent_coordinate"):
        return state
    n_coordinates, consistent = state.shape[1] // 2, []
    for k, row in enumerate(state):
        if not np.isfinite(row).all():  # the integrator reports it
            consistent.append(row)
            continue
        coordinate, velocity = row[:n_coordinates], row[n_coordinates:]
        corrected = make_consistent(model, coordinate, velocity, select_motion(starts.arguments, k))
        consistent.append(np.concatenate(corrected))
    return np.array(consistent)


def _simulate_one_by_one(
    model: CompiledModel,
    starts: _Starts,
    times: FloatArray,
    options: RunOptions,
    schedule: Sequence[Profile | Schedule] | Profile | Schedule | None,
    threads: int,
    progress: Progress | None,
) -> BatchTrajectory:
    """Return the motions, each simulated by itself in threads, without samples where it cannot begin."""
    n_coordinates, state = starts.state.shape[1] // 2, starts.state

    def run(k: int) -> Trajectory | tuple[str, str]:
        arguments_of_motion = select_motion(starts.arguments, k)
        if not all(np.isfinite(array).all() for array in (state[k], *arguments_of_motion.values())):
            return "non_finite_input", "the initial state or an argument is not finite"
        try:
            return simulate(
                model,
                float(times[-1]),
                samples=len(times),
                coordinate=state[k, :n_coordinates],
                velocity=state[k, n_coordinates:],
                arguments=arguments_of_motion,
                schedule=schedule[k] if isinstance(schedule, Sequence) else schedule,
                **options.as_given(),
            )
        except NonFiniteError as error:
            return "unstable", str(error.problem)

    # Of each motion: samples, or status and message where there are none.
    outcomes: list[Trajectory | tuple[str, str]] = []
    with ThreadPoolExecutor(threads) as pool:  # the calls into C hold no lock of Python's
        try:
            for outcome in pool.map(run, range(len(state))):
                outcomes.append(outcome)
                if progress is not None:
                    progress(len(outcomes) / len(state))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return _join_motions(model, times, outcomes, options.method)


def _join_motions(
    model: CompiledModel, time: FloatArray, outcomes: list[Trajectory | tuple[str, str]], method: str
) -> BatchTrajectory:
    """Return one record of all motions; NAN if samples were not reached, -1 for unknown rejected steps."""
    manifest, n_batch, n_samples = model.manifest, len(outcomes), len(time)
    n_coordinates, n_nodes = len(manifest.coordinate_name), len(manifest.node_name)
    n_members = len(manifest.member_name)
    # Empty arrays of all samples.
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys((*STATE, *SAMPLED), ())
    shapes |= {"coordinate": (n_coordinates,), "velocity": (n_coordinates,), "member_tension": (n_members,)}
    shapes |= {"node_position": (n_nodes, 3), "node_velocity": (n_nodes, 3)}
    if manifest.internal_name:
        shapes["internal"] = (len(manifest.internal_name),)
    arrays: dict[str, Any] = {
        name: np.full((n_batch, n_samples, *shape), np.nan) for name, shape in shapes.items()
    }
    energy_drift, error_estimate = np.full(n_batch, np.nan), np.full(n_batch, np.nan)
    n_reached, n_steps, n_evaluations = (np.zeros(n_batch, dtype=np.int64) for _ in range(3))
    verdicts: list[tuple[str, str]] = []
    # Rows of the motions that began.
    for k, motion in enumerate(outcomes):
        if not isinstance(motion, Trajectory):
            verdicts.append(motion)
            continue
        verdicts.append((motion.status, motion.message))
        reached = len(motion.time)
        for name, array in arrays.items():
            array[k, :reached] = getattr(motion, name)
        energy_drift[k] = np.nan if motion.energy_drift is None else motion.energy_drift
        error_estimate[k] = np.nan if motion.error_estimate is None else motion.error_estimate
        n_reached[k], n_steps[k], n_evaluations[k] = reached, motion.n_steps, motion.n_evaluations
    return BatchTrajectory(
        time=time,
        **arrays,
        energy_drift=energy_drift,
        error_estimate=error_estimate,
        status=tuple(status for status, _ in verdicts),
        message=tuple(message for _, message in verdicts),
        n_reached=n_reached,
        n_steps=n_steps,
        n_rejected=np.full(n_batch, -1, dtype=np.int64),
        n_evaluations=n_evaluations,
        method=method,
        step=None,
        node_name=manifest.node_name,
        member_name=manifest.member_name,
        structure=model.structure,
        internal_name=manifest.internal_name,
        bodies=manifest.body_places,
    )
