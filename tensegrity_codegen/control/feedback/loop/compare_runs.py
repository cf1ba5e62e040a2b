"""Simulated loops beside the same ones without feedback: which one ends nearer to the motion."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tensegrity_codegen.control.feedback.loop.control_run import ControlRun
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.system.arrays import FloatArray

LAST = 1.0 / 6.0  # of the simulated time, in which errors are compared
WORSE = 0.005  # of the size of the structure, by which a loop may end further away than the open loop


def compare_with_open_loop(
    model: CompiledModel, motion: Motion, run: ControlRun, run_open: Callable[[], ControlRun]
) -> ControlRun:
    """Return a run with the status ``"does_not_hold"`` where it ends further away than the open loop.

    Parameters
    ----------
    model : CompiledModel
        The model that was simulated.
    motion : Motion
        The motion.
    run : ControlRun
        The run with feedback.
    run_open : callable
        Simulates the same draw without feedback, where the error at the end is large enough to need it.

    Returns
    -------
    ControlRun
        The run; its message has both errors where they were compared.
    """
    if run.status != "ok":
        return run
    position = place_nodes(model, motion.coordinate[0])
    most = WORSE * float(np.ptp(position, axis=0).max(initial=0.0))
    error = _find_end_error(model, run)
    if error <= most:
        return run
    other = run_open()
    if other.status != "ok":
        return run
    without = _find_end_error(model, other)
    message = (
        f"{run.message}; at the end {1000 * error:.3g} mm from the motion, {1000 * without:.3g} mm without "
        "feedback"
    )
    return replace(run, status="does_not_hold" if error > without + most else "ok", message=message)


def find_displacement(model: CompiledModel, run: ControlRun, since: float = 0.0) -> FloatArray:
    """Return the distance of each node from the motion at the samples from a time [s] on, (n_t, n_nodes)."""
    rows = run.time >= since - 1e-12
    coordinate, error = run.coordinate[rows], run.error[rows]
    if model.manifest.coordinate_node_axis:
        moved = np.zeros((len(error), len(model.manifest.node_name), 3))
        node, axis = model.manifest.coordinate_place.T
        moved[:, node, axis] = error
        return np.asarray(np.linalg.norm(moved, axis=2))
    pairs = zip(coordinate, error, strict=True)
    away = [np.linalg.norm(place_nodes(model, q) - place_nodes(model, q - e), axis=1) for q, e in pairs]
    return np.array(away)


def _find_end_error(model: CompiledModel, run: ControlRun) -> float:
    """Return the largest distance of a node from the motion at the end [m]."""
    return float(find_displacement(model, run, (1.0 - LAST) * float(run.time[-1])).max())
