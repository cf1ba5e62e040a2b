"""A second opinion in extended precision: the same physics written once more, fixed steps of order 8.

Velocities of stiff bars are lost in the rounding of double precision, mu eps l / m a step; here they are not.
Digits have 64 bits; where a compiler's `long double` is no longer than `double` there is no such opinion.
"""

import ctypes
import math
import time
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.codegen.print.render import render
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.stability.cases import Case
from tensegrity_codegen.studies.stability.judge import Truth, is_agreed
from tensegrity_codegen.studies.stability.methods import SAMPLES
from tensegrity_codegen.studies.study import load_c
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import TensegrityError
from tensegrity_codegen.tables.laws.law import compute_spring_constant
from tensegrity_codegen.tables.tableaus import TABLEAUS

LongArray = NDArray[np.longdouble]

STAGES = TABLEAUS["rk853"].rows
CHUNK = 0.2  # s of work after which the clock is looked at
REFINEMENTS = 3  # of the inverse of H by Newton's iteration, from double precision


def has_extended_precision() -> bool:
    """Return whether `long double` has more digits than `double` here."""
    return bool(np.finfo(np.longdouble).eps < 1e-3 * np.finfo(np.float64).eps)


class ExtendedMotion:
    """The motion of a structure whose members are all springs, from its stated positions and velocities."""

    def __init__(self, structure: Structure) -> None:
        long = np.longdouble
        self.structure = structure
        self.places = structure.coordinate_node_axis
        self.end = np.ascontiguousarray(structure.connectivity, dtype=np.intc)
        rest_length = structure.rest_length.astype(long)
        stiffnesses = (structure.spring_constant.astype(long), structure.axial_stiffness.astype(long))
        self.mu = compute_spring_constant(*stiffnesses, rest_length)
        columns = [self.mu, structure.damping.astype(long), rest_length, structure.tension_only.astype(long)]
        self.law = np.ascontiguousarray(np.stack(columns, axis=1))
        weight = structure.node_mass.astype(long)
        np.add.at(
            weight, structure.connectivity.ravel(), np.repeat(structure.member_mass.astype(long) / 2, 2)
        )
        self.constant = structure.node_load.astype(long) + weight[:, None] * structure.gravity.astype(long)
        self.where = np.ascontiguousarray(3 * self.places[:, 0] + self.places[:, 1], dtype=np.intc)
        self.inverse = _inverse(_mass(structure))

    def fastest(self) -> tuple[float, float]:
        """Return the largest frequency [rad/s] and decay rate [1/s] with every member taut."""
        vector = self._vectors(self.structure.node_position.astype(np.longdouble)).astype(np.float64)
        length = np.linalg.norm(vector, axis=1)[:, None]
        direction = np.divide(vector, length, out=np.zeros_like(vector), where=length > 0)
        rows = np.zeros((len(vector), self.structure.n_nodes * 3))
        for end, sign in ((0, 1.0), (1, -1.0)):
            for axis in range(3):
                rows[np.arange(len(vector)), 3 * self.end[:, end] + axis] = sign * direction[:, axis]
        rows = rows[:, self.where]
        columns = []
        for values in (self.mu.astype(np.float64), self.structure.damping):
            matrix = self.inverse.astype(np.float64) @ (rows.T @ (values[:, None] * rows))
            columns.append(float(np.abs(np.linalg.eigvals(matrix)).max(initial=0.0)))
        return float(np.sqrt(columns[0])), columns[1]

    def run(self, sample_time: FloatArray, steps: int, deadline: float) -> LongArray | None:
        """Return the states (n_t, 2n) at times [s] from 0 up; None if they are not finite or time is up."""
        node, axis = self.places.T
        position = np.ascontiguousarray(self.structure.node_position.astype(np.longdouble))
        speed = np.ascontiguousarray(np.zeros_like(position))
        state = np.concatenate([position[node, axis], self.structure.node_velocity[node, axis]])
        state = np.ascontiguousarray(state.astype(np.longdouble))
        states, rate = [state.copy()], 1e5  # steps a second, at first
        for span in np.diff(sample_time):
            remaining = steps
            h = np.longdouble(span) / remaining
            while remaining:
                count = min(remaining, max(1, int(rate * CHUNK)))
                started = time.process_time()
                if started + remaining / rate > deadline + CHUNK or self._advance(
                    count, h, position, speed, state
                ):
                    return None
                rate = count / max(time.process_time() - started, 1e-6)
                remaining -= count
            states.append(state.copy())
        return np.array(states)

    def tension(self, state: LongArray) -> FloatArray:
        """Return the tensions (n_t, n_members) [N] in states (n_t, 2n)."""
        return np.array([self._tension(row) for row in state])

    def _tension(self, state: LongArray) -> FloatArray:
        node, axis = self.places.T
        n = len(node)
        position = self.structure.node_position.astype(np.longdouble)
        speed = np.zeros_like(position)
        position[node, axis], speed[node, axis] = state[:n], state[n:]
        vector, moving = self._vectors(position), self._vectors(speed)
        length = np.sqrt(np.sum(vector * vector, axis=1))
        mu, c, rest_length, is_cable = self.law.T
        pull = mu * (length - rest_length) + c * np.sum(vector * moving, axis=1) / length
        slack = (is_cable > 0) & ((length <= rest_length) | (pull <= 0))
        return np.where(slack, 0.0, pull).astype(np.float64)

    def _vectors(self, position: LongArray) -> LongArray:
        return np.asarray(position[self.end[:, 0]] - position[self.end[:, 1]])

    def _advance(
        self, count: int, h: np.longdouble, position: LongArray, speed: LongArray, state: LongArray
    ) -> bool:
        """Take some steps, in place; return whether the state is lost."""
        structure, n = self.structure, len(self.where)
        row_start, column, value = _by_rows(self.inverse)
        work = np.empty(3 * structure.n_nodes + 2 * n * (len(STAGES) + 2), np.longdouble)
        arrays = [self.end, self.law, self.constant, self.where, row_start, column, value]
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in arrays]
        after = [array.ctypes.data_as(ctypes.c_void_p) for array in (position, speed, state, work)]
        sizes = (structure.n_nodes, structure.n_members, n)
        step = ctypes.c_longdouble(float(h))
        ctypes.memmove(ctypes.byref(step), np.array([h]).ctypes.data, ctypes.sizeof(step))
        return bool(_function()(*sizes, *pointers, ctypes.c_longlong(count), step, *after))


def _mass(structure: Structure) -> LongArray:
    """Return H over the coordinates (n, n)."""
    long, node_axes = np.longdouble, structure.coordinate_node_axis
    full_mass = np.diag(structure.node_mass.astype(long))
    bars = structure.member_mass.astype(long) * structure.is_bar
    halves = np.repeat((structure.member_mass.astype(long) - bars) / 2, 2)
    np.add.at(full_mass, (structure.connectivity.ravel(), structure.connectivity.ravel()), halves)
    for (i, j), mass in zip(structure.connectivity, bars, strict=True):
        full_mass[i, i] += mass / 3
        full_mass[j, j] += mass / 3
        full_mass[i, j] += mass / 6
        full_mass[j, i] += mass / 6
    same = node_axes[:, 1][:, None] == node_axes[:, 1][None, :]
    return np.where(same, full_mass[node_axes[:, 0]][:, node_axes[:, 0]], long(0))


def _inverse(matrix: LongArray) -> LongArray:
    """Return the inverse of a symmetric positive definite matrix to all digits."""
    root = np.sqrt(np.diag(matrix))
    scaled = matrix / root[:, None] / root[None, :]
    inverse = np.linalg.inv(scaled.astype(np.float64)).astype(np.longdouble)
    for _ in range(REFINEMENTS):
        inverse = 2 * inverse - inverse @ scaled @ inverse
    inverse[np.abs(inverse) < 1e-25] = 0
    return np.asarray(inverse / root[:, None] / root[None, :])


def _by_rows(matrix: LongArray) -> tuple[NDArray[np.intc], NDArray[np.intc], LongArray]:
    """Return where rows start, columns and values of the entries that are not 0."""
    row, column = np.nonzero(matrix)
    row_start = np.searchsorted(row, np.arange(len(matrix) + 1))
    return row_start.astype(np.intc), column.astype(np.intc), np.ascontiguousarray(matrix[row, column])


@cache
def _function() -> Any:
    """Return the function of templates/extended_motion.c.j2, compiled once a machine."""
    rows = [[(k, repr(value)) for k, value in row.items()] for row in STAGES]
    text = render("extended_motion.c", {"rows": rows})
    function = load_c("extended_motion", text).extended_motion
    function.restype = ctypes.c_int
    pointer, count, long = ctypes.c_void_p, ctypes.c_longlong, ctypes.c_longdouble
    function.argtypes = [*[ctypes.c_int] * 3, *[pointer] * 7, count, long, *[pointer] * 4]
    return function


RESOLVED = 0.6  # radians of the fastest vibration in a step, at first: some 1e-9 off a step
DECAYED = 2.0  # decay times in a step: order 8 is stable up to 6
SHORTER = 1.5  # times the steps in the next run, 25 times as exact where no cable goes slack or taut
AGREEMENTS = 2  # one after the other; where cables go slack, two runs can agree by chance


def certify_extended(case: Case, limit: float) -> Truth | None:
    """Return states that steps in extended precision and shorter ones agree on, None where time is up before.

    Only where all members are linear springs without memory, and no ground. limit: seconds of CPU time.
    """
    structure = case.structure
    if case.expects_refusal or case.is_rigid or not has_extended_precision():
        return None
    if not structure.is_linear.all() or structure.ground is not None or structure.internal_name:
        return None
    deadline = time.process_time() + limit
    times = np.linspace(0.0, case.t_end, SAMPLES)
    try:
        motion = ExtendedMotion(structure)
        frequency, decay = motion.fastest()
        step = min(RESOLVED / max(frequency, 1e-300), DECAYED / max(decay, 1e-300), times[1])
        count, agreed = max(1, math.ceil(times[1] / step)), 0
        before = motion.run(times, count, deadline)
        while before is not None:
            count = math.ceil(SHORTER * count)
            state = motion.run(times, count, deadline)
            if state is None:
                return None
            error = np.abs(state - before).astype(np.float64)
            agreed = agreed + 1 if is_agreed(case, state.astype(np.float64), error) else 0
            if agreed == AGREEMENTS:
                tension = motion.tension(state)
                between = np.abs(tension - motion.tension(before))
                return Truth(state.astype(np.float64), error, tension, between)
            before = state
    except (TensegrityError, np.linalg.LinAlgError):
        return None
    return None
