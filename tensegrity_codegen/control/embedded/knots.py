"""Tables over time for a controller in C: motion, inputs, gains of feedback and estimator at their knots."""

from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.system.arrays import FloatArray


@dataclass(frozen=True)
class Knots:
    """Rows of numbers at rising times, two rows at least.

    time (n_knots,) [s]; row (n_knots, n): numbers at each.
    """

    time: FloatArray
    row: FloatArray


def tabulate_states(motion: Motion) -> Knots:
    """Return coordinates, velocities and accelerations of a motion, and the steps of its polynomials.

    Parameters
    ----------
    motion : Motion
        The motion.

    Returns
    -------
    Knots
        Rows (q, v, a, g): g = q_next - q - h v - h^2 a / 2, by which the coordinates at the next knot differ
        from a parabola. Stored, it keeps digits which the difference of coordinates would lose in C.
    """
    q, v, a = (
        np.asarray(x, dtype=np.longdouble) for x in (motion.coordinate, motion.velocity, motion.acceleration)
    )
    h = np.diff(np.asarray(motion.time, dtype=np.longdouble))[:, None]
    gap = np.zeros_like(q)
    gap[:-1] = np.diff(q, axis=0) - h * v[:-1] - h**2 * a[:-1] / 2
    return Knots(motion.time, np.hstack([q, v, a, gap]).astype(np.float64))


def tabulate_inputs(motion: Motion) -> Knots:
    """Return the inputs of a motion and their slopes, rows (u, u'), of the spline of `Motion.profile`."""
    pieces = motion.profile().pieces
    value, slope = pieces.coefficient[:, 0], pieces.coefficient[:, 1]
    h = pieces.time[-1] - pieces.time[-2]
    powers = np.arange(1, pieces.coefficient.shape[1])
    last = (powers * h ** (powers - 1)) @ pieces.coefficient[-1, 1:]
    ends = np.vstack([value, motion.input[-1]]), np.vstack([slope, last])
    return Knots(pieces.time, np.hstack(ends))


def tabulate_gains(time: FloatArray, gains: FloatArray, sample: float) -> Knots:
    """Return gains (n_knots, rows, columns) at their times; a single one holds at all times."""
    rows = gains.reshape(len(gains), -1)
    if len(rows) == 1:
        return Knots(np.array([time[0], time[0] + sample]), np.vstack([rows, rows]))
    return Knots(np.asarray(time), rows)
