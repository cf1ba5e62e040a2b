"""The record of a simulated closed loop, and its comparison with the same loop without feedback."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.feedback.design.linear_samples import measure_slip
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.structure.frozen import freeze_fields
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_positive, is_number
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.system.summaries import Summarised

COMPARED_PART = 1.0 / 6.0  # of the simulated time, in which errors are compared
MIN_WORSE = 0.005  # of the size of the structure, by which a loop may end further away than the open loop
OFTEN = 0.1  # of the commands: so many are often cut, or not solved
# Statuses at which sums of errors stand still: the cause, and a remedy.
STANDSTILLS = {
    ("rate_limited", "range_limited"): (
        "cut to the rate or range of an actuator",
        "weaker feedback (a smaller effort), a slower motion or faster actuators avoid that",
    ),
    ("tension_limited", "least_tension"): (
        "held back by least tensions or ranges of coordinates",
        "an error may stay, and smaller least tensions avoid that",
    ),
}


@dataclass(frozen=True, eq=False, repr=False)
class ControlRun(Summarised):
    """A simulated closed loop, at n_t sample times; the loop acts at all of them but the last.

    Attributes
    ----------
    status : str
        ``"ok"``; ``"does_not_hold"`` where the last sixth of the time is further from the motion than without
        feedback, by more than 1/200 of the size of the structure; ``"not_solved"`` where a tenth of the
        commands are not those of a solved program; ``"unstable"`` where the integration stopped: arrays end
        there.
    message : str
        A sentence.
    time : ndarray, shape (n_t,) [s]
        Sample times.
    coordinate, velocity : ndarray, shape (n_t, n_coordinates)
        True state [m, rad, and per second].
    error : ndarray, shape (n_t, n_coordinates)
        True coordinates minus those of the motion.
    command : ndarray, shape (n_t - 1, n_actuators) [m]
        Commanded inputs of the actuators, within rate and range.
    input : ndarray, shape (n_t - 1, n_inputs)
        Inputs of the model at the end of each sample, delays included.
    member_tension : ndarray, shape (n_t, n_members) [N]
        True tensions.
    estimate : ndarray, shape (n_t - 1, n_states), or None
        Estimated state at each command.
    disturbance : ndarray, shape (n_t - 1, n_coordinates), or None
        Estimated disturbance force on each coordinate [N or N m].
    step_status : tuple of str, length n_t - 1
        Of each command: ``"ok"``, ``"rate_limited"``, ``"range_limited"``, and with a distribution of
        tensions or prediction ``"tension_limited"`` (least tensions prevent what feedback asks for),
        ``"least_tension"`` (one cannot be reached within rate and range) and ``"not_solved"`` (what feedback
        asks for, or the last plan, was cut instead); with an
        estimator ``"outlier"`` (measurements that are too far from their prediction: the last command holds).
    actuators, coordinate_name, member_name : tuple of str
        Names.
    yielding : ndarray of bool, shape (n_t - 1, n_members), or None
        Members whose least tension could not be reached; None without a distribution of tensions.
    warnings : tuple of str
        Facts to check.
    slip : ndarray, shape (n_t, n_contacts) [m], or None
        How far the points have moved where feet stick; zero for those that are open at the start. None
        without friction.
    sample_cost : float [s]
        Processor time of a sample of controller and model, of loops in C; nan in Python.
    """

    status: str
    message: str
    time: FloatArray
    coordinate: FloatArray
    velocity: FloatArray
    error: FloatArray
    command: FloatArray
    input: FloatArray
    member_tension: FloatArray
    estimate: FloatArray | None
    disturbance: FloatArray | None
    step_status: tuple[str, ...]
    actuators: tuple[str, ...]
    coordinate_name: tuple[str, ...]
    member_name: tuple[str, ...]
    yielding: NDArray[np.bool_] | None = None
    warnings: tuple[str, ...] = ()
    slip: FloatArray | None = None
    sample_cost: float = np.nan

    def __post_init__(self) -> None:
        freeze_fields(self)

    def worst_error(self, last: float | None = None, coordinates: Any = slice(None)) -> float:
        """Return the largest error of some coordinates.

        Parameters
        ----------
        last : float, optional [s]
            Time before the end that is looked at; by default all of it.
        coordinates : index
            Which coordinates; by default all.

        Returns
        -------
        float
            In the unit of the coordinates [m or rad].
        """
        start = -np.inf if last is None else self.time[-1] - check_positive(last, "last", "[s]")
        try:
            chosen = self.error[:, coordinates]
        except (IndexError, TypeError, ValueError) as error:
            raise InvalidValueError(
                "not an index of coordinates", where="coordinates", given=coordinates,
                allowed=f"indices from 0 to {len(self.coordinate_name) - 1}, a mask or a slice",
            ) from error  # fmt: skip
        return float(np.abs(chosen[self.time >= start - 1e-12]).max(initial=0.0))

    def least_tension(self, since: float = 0.0) -> FloatArray:
        """Return the smallest tension of each member from a time [s] on, (n_members,) [N]."""
        if not is_number(since) or since > self.time[-1]:
            allowed = f"a time up to {self.time[-1]:g} [s]"
            raise InvalidValueError("out of range", where="since", given=since, allowed=allowed)
        smallest: FloatArray = self.member_tension[self.time >= since - 1e-12].min(axis=0)
        return smallest

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays by name, with the names of actuators, coordinates and members."""
        values = {
            name: value for name, value in vars(self).items() if name not in ("warnings", "sample_cost")
        }
        return {name: np.asarray(value) for name, value in values.items() if value is not None}


# From the arrays of a simulated loop to its record.


def build_run(
    model: CompiledModel,
    motion: Motion,
    sample: float,  # [s]: time between two commands
    *,
    state: FloatArray,  # (n_t, n_states + n_internal): coordinates, velocities and internal states
    command: FloatArray,  # (n_t - 1, n_actuators): of each sample
    input: FloatArray,  # (n_t - 1, n_inputs)
    tension: FloatArray,  # (n_t, n_members) [N]
    known: FloatArray | None,  # (n_t - 1, n_states + n_coordinates): estimated states, disturbance forces
    statuses: Sequence[str],  # of each step
    word: str,  # ``"ok"``, or why the run ended
    yielding: NDArray[np.bool_] | None = None,  # (n_t - 1, n_members): members whose least tension yields
) -> ControlRun:
    """Return the record of a run."""
    manifest = model.manifest
    n_t, n = len(state), len(manifest.coordinate_name)
    time = sample * np.arange(n_t, dtype=float)
    goal = np.array([motion.at(float(now)).coordinate for now in time])
    limited, unsolved = sum(status != "ok" for status in statuses), statuses.count("not_solved")
    slip, what_slips = measure_slip(model, state)
    is_ok, has_known = word == "ok", known is not None and len(known) > 0
    is_solved, message = unsolved < max(OFTEN * len(statuses), 1), f"{n_t - 1} samples, {limited} limited"
    message += "" if is_solved else f", {unsolved} not solved: the last plan, or feedback, was cut instead"
    return ControlRun(
        status=("ok" if is_solved else "not_solved") if is_ok else "unstable",
        message=message if is_ok else f"{word} at {time[-1]:.6g} s",
        time=time,
        coordinate=state[:, :n],
        velocity=state[:, n : 2 * n],
        error=state[:, :n] - goal,
        command=command.reshape(n_t - 1, len(motion.actuators)),
        input=input.reshape(n_t - 1, len(manifest.input_name)),
        member_tension=tension,
        estimate=known[:, : 2 * n] if known is not None and has_known else None,
        disturbance=known[:, 2 * n :] if known is not None and has_known else None,
        step_status=tuple(statuses),
        actuators=motion.actuators,
        coordinate_name=manifest.coordinate_name,
        member_name=manifest.member_name,
        yielding=yielding,
        warnings=(*describe_cuts(Counter(statuses)), *([what_slips] if what_slips else ())),
        slip=slip,
    )


def describe_cuts(steps: Mapping[str, int]) -> list[str]:
    """Return a sentence for each reason why commands, so many of each status, are often cut."""
    count = max(sum(steps.values()), 1)
    fractions = {kind: sum(steps.get(status, 0) for status in kind) / count for kind in STANDSTILLS}
    return [
        f"{100 * fraction:.0f} % of the commands were {STANDSTILLS[kind][0]}, and integrals of errors "
        f"stand still then: {STANDSTILLS[kind][1]}"
        for kind, fraction in fractions.items()
        if fraction > OFTEN
    ]


# Simulated loops beside the same ones without feedback: which one ends nearer to the motion.


def compare_with_open_loop(
    model: CompiledModel, motion: Motion, run: ControlRun, run_open: Callable[[], ControlRun]
) -> ControlRun:
    """Return a run with the status ``"does_not_hold"`` where it ends further away than the open loop."""
    if run.status != "ok":
        return run
    position = place_nodes(model, motion.coordinate[0])
    tolerance = MIN_WORSE * float(np.ptp(position, axis=0).max(initial=0.0))
    error = _compute_end_error(model, run)
    if error <= tolerance:
        return run
    open_run = run_open()
    if open_run.status != "ok":
        return run
    without = _compute_end_error(model, open_run)
    message = (
        f"{run.message}; at the end {1000 * error:.3g} mm from the motion, {1000 * without:.3g} mm without "
        "feedback"
    )
    return replace(run, status="does_not_hold" if error > without + tolerance else "ok", message=message)


def find_displacement(model: CompiledModel, run: ControlRun, since: float = 0.0) -> FloatArray:
    """Return the distance of each node from the motion at the samples from a time [s] on, (n_t, n_nodes)."""
    rows = run.time >= since - 1e-12
    coordinate, error = run.coordinate[rows], run.error[rows]
    if model.manifest.coordinate_node_axis:
        moved = np.zeros((len(error), len(model.manifest.node_name), 3))
        node, axis = model.manifest.coordinate_place.T
        moved[:, node, axis] = error
        for body in model.manifest.body_places:
            body.attach(moved)
        return np.asarray(np.linalg.norm(moved, axis=2))
    pairs = zip(coordinate, error, strict=True)
    away = [np.linalg.norm(place_nodes(model, q) - place_nodes(model, q - e), axis=1) for q, e in pairs]
    return np.array(away)


def _compute_end_error(model: CompiledModel, run: ControlRun) -> float:
    """Return the largest distance of a node from the motion at the end [m]."""
    return float(find_displacement(model, run, (1.0 - COMPARED_PART) * float(run.time[-1])).max())
