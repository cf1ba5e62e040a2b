"""From the arrays of a simulated loop to its record."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.feedback.loop.control_run import ControlRun
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.manifest import Manifest


def build_run(
    manifest: Manifest,
    motion: Motion,
    sample: float,
    *,
    state: FloatArray,
    command: FloatArray,
    input: FloatArray,
    tension: FloatArray,
    known: FloatArray | None,
    statuses: Sequence[str],
    word: str,
    yielding: NDArray[np.bool_] | None = None,
) -> ControlRun:
    """Return the record of a run.

    Parameters
    ----------
    manifest : Manifest
        Of the simulated model.
    motion : Motion
        The motion to hold.
    sample : float [s]
        Time between two commands.
    state : ndarray, shape (n_t, n_states)
        Coordinates and velocities at the samples.
    command, input : ndarray, shape (n_t - 1, n_actuators) and (n_t - 1, n_inputs)
        Of each sample.
    tension : ndarray, shape (n_t, n_members) [N]
        Tensions at the samples.
    known : ndarray, shape (n_t - 1, n_states + n_coordinates), or None
        Estimated states and disturbance forces, with an estimator.
    statuses : sequence of str
        Status of each step.
    word : str
        ``"ok"``, or why the run ended.
    yielding : ndarray of bool, shape (n_t - 1, n_members), optional
        Members whose least tension yields.

    Returns
    -------
    ControlRun
        The record.
    """
    n_t, n = len(state), len(manifest.coordinate_name)
    time = sample * np.arange(n_t, dtype=float)
    goal = np.array([motion.at(float(now)).coordinate for now in time])
    limited = sum(status != "ok" for status in statuses)
    is_ok, has_known = word == "ok", known is not None and len(known) > 0
    return ControlRun(
        status="ok" if is_ok else "unstable",
        message=f"{n_t - 1} samples, {limited} limited" if is_ok else f"{word} at {time[-1]:.6g} s",
        time=time,
        coordinate=state[:, :n],
        velocity=state[:, n:],
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
    )
