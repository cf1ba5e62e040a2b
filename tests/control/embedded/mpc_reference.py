"""One step of model-predictive control in NumPy, with slack variables and qpOASES: the reference of the C."""

from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from tensegrity_codegen.control.feedback.design.linear_samples import split_delays, to_dense
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorBounds
from tensegrity_codegen.control.feedback.mpc import Mpc
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tests.control.feedback.pinned_prism import Array


@dataclass
class ReferenceMpc:
    """The controller of `design_mpc` along a motion, without an estimator; one call of `step` a sample."""

    model: CompiledModel
    motion: Motion
    mpc: Mpc
    bounds: ActuatorBounds
    plan: Array | None = None
    moves: Array = field(default_factory=lambda: np.zeros(0))
    sums: Array = field(default_factory=lambda: np.zeros(0))
    sent: list[Array] = field(default_factory=list)  # the latest first

    def __post_init__(self) -> None:
        back, self.rest, count = split_delays(self.bounds.delay, self.mpc.gains.sample)
        self.back, self.stages = back, self.mpc.horizon + int(count.max())
        self.block = np.repeat(np.arange(len(self.mpc.blocks)), self.mpc.blocks)
        self.moves = np.zeros((len(self.mpc.blocks), len(back)))
        self.sums = np.zeros(len(self.mpc.gains.integral_action))
        self.sent = [self.motion.at(0.0).input[self.bounds.place]] * (int(back.max()) + 2)

    def step(self, time: float, state: Array) -> tuple[Array, float]:
        """Return the command and the largest predicted excess over a soft limit."""
        h, gains, stages = self.mpc.gains.sample, self.mpc.gains, self.stages
        n, m, n_blocks = len(state) // 2, len(self.bounds.place), len(self.mpc.blocks)
        # The plan of the last step, moved on by a sample.
        goal = [self.motion.at(time + k * h) for k in range(stages + 1)]
        goals = np.array([np.concatenate([point.coordinate, point.velocity]) for point in goal])
        if self.plan is None:
            plan = goals.copy()
        else:
            plan = np.vstack([self.plan[1:], self.plan[-1:]])
            ends = np.cumsum([0, *self.mpc.blocks])[:-1]
            last = self.mpc.horizon - 1
            self.moves = self.moves[[self.block[min(start + 1, last)] for start in ends]]
        plan[0] = state
        inputs, places, planned = self._find_inputs(time)
        # Errors of the states as functions of the changes of the moves.
        size = n_blocks * m
        change, error = np.zeros((2 * n, size)), np.zeros(2 * n)
        sums, sums_change = self.sums.copy(), np.zeros((len(self.sums), size))
        hessian, gradient = np.zeros((size, size)), np.zeros(size)
        rows: list[tuple[Array, float, float, float]] = []
        checked = np.cumsum(self.mpc.blocks) + stages - self.mpc.horizon
        trail = [(error, change)]
        for k in range(stages):
            off = plan[k] + error - goals[k]
            sums, sums_change = (
                sums + gains.integral_action @ off,
                sums_change + gains.integral_action @ change,
            )
            reached, by_state, by_input = self._advance(plan[k], inputs[k])
            error = by_state @ error + reached - plan[k + 1]
            change = by_state @ change + by_input @ places[k]
            trail.append((error, change))
            weight = self.mpc.Q if k < stages - 1 else gains.S[-1]
            both = np.vstack([change, sums_change])
            hessian += both.T @ weight @ both
            gradient += both.T @ weight @ np.concatenate([plan[k + 1] + error - goals[k + 1], sums])
            if k + 1 in checked:
                rows += self._limit(plan[k + 1, :n], error[:n], change[:n], inputs[k], places[k])
        for b, count in enumerate(self.mpc.blocks):
            own = slice(b * m, (b + 1) * m)
            hessian[own, own] += count * self.mpc.R
            gradient[own] += count * self.mpc.R @ self.moves[b]
        rows += self._limit_inputs(planned)
        x = _solve(hessian, gradient, rows)
        # The new plan and the command.
        self.moves = self.moves + x.reshape(n_blocks, m)
        self.plan = plan + np.array([error + change @ x for error, change in trail])
        reach = self.bounds.rate * h
        low = np.maximum(self.bounds.least, self.sent[0] - reach)
        high = np.minimum(self.bounds.most, self.sent[0] + reach)
        command = np.clip(planned[0] + self.moves[0], low, high)
        self.sent = [command, *self.sent[:-1]]
        excess = max(
            (max(row @ x - high, low - row @ x) for row, low, high, soft in rows if soft), default=0.0
        )
        return command, max(excess, 0.0)

    def _find_inputs(self, time: float) -> tuple[Array, list[Array], Array]:
        """Return the inputs of each sample, their derivatives by the moves, and the motion's commands."""
        h, m = self.mpc.gains.sample, len(self.bounds.place)
        middles = [time + (k + 0.5) * h for k in range(self.stages)]
        late = self.bounds.delay
        planned = np.array(
            [[self.motion.at(t + late[u]).input[p] for u, p in enumerate(self.bounds.place)] for t in middles]
        )
        inputs = np.array([self.motion.at(t).input for t in middles])
        places = [np.zeros((m, self.moves.size)) for _ in middles]
        last = self.mpc.horizon - 1
        for k, place in enumerate(places):
            value = np.zeros(m)
            for u in range(m):
                share = self.rest[u] / h
                for part, number in ((1.0 - share, k - self.back[u]), (share, k - self.back[u] - 1)):
                    if part == 0.0:
                        continue
                    if number < 0:
                        value[u] += part * self.sent[-1 - number][u]
                    else:
                        b = self.block[min(number, last)]
                        value[u] += part * (planned[number, u] + self.moves[b, u])
                        place[u, b * m + u] += part
            inputs[k, self.bounds.place] = value
        return inputs, places, planned

    def _advance(self, state: Array, value: Array) -> tuple[Array, Array, Array]:
        """Return the state after a sample and its derivatives by the state and the actuators."""
        steps = self.mpc.substeps
        h, n = self.mpc.gains.sample / steps, len(state) // 2
        by = np.hstack([np.eye(2 * n), np.zeros((2 * n, len(self.bounds.place)))])

        def rate(x: Array, s: Array) -> tuple[Array, Array]:
            at: dict[str, Any] = {"coordinate": x[:n].copy(), "velocity": x[n:].copy(), "input": value}
            slope = to_dense(self.model.compute("state_jacobian", **at)) @ s
            slope[:, 2 * n :] += to_dense(self.model.compute("input_jacobian", **at))[:, self.bounds.place]
            return np.concatenate([x[n:], np.asarray(self.model.compute("acceleration", **at))]), slope

        for _ in range(steps):
            a, s = rate(state, by)
            b, t = rate(state + h / 2 * a, by + h / 2 * s)
            c, u = rate(state + h / 2 * b, by + h / 2 * t)
            d, v = rate(state + h * c, by + h * u)
            state, by = state + h / 6 * (a + 2 * b + 2 * c + d), by + h / 6 * (s + 2 * t + 2 * u + v)
        return state, by[:, : 2 * n], by[:, 2 * n :]

    def _limit(
        self, coordinate: Array, error: Array, change: Array, value: Array, place: Array
    ) -> list[tuple[Array, float, float, float]]:
        """Return the soft rows of a block: row, least and largest product with x, weight."""
        cables, rows = self.mpc.cables, []
        at = {"coordinate": coordinate.copy()}
        length = np.asarray(self.model.compute("member_length", **at))
        slopes = to_dense(self.model.compute("equilibrium_matrix", **at))
        longest, step = cables.find_rest_length(length, self.mpc.least_tension), 1e-6
        with np.errstate(invalid="ignore"):  # members without a limit
            slope = (cables.find_rest_length(length + step, self.mpc.least_tension) - longest) / step
        rest = cables.base + cables.other_incidence @ value + cables.incidence @ value[self.bounds.place]
        for e in cables.limited.tolist():
            row = cables.incidence[e] @ place - slope[e] * slopes[:, e] @ change
            room = float(longest[e] + slope[e] * slopes[:, e] @ error - rest[e])
            rows.append((row, -np.inf, room, self.mpc.excess_weight))
        for i, (least, most) in enumerate(self.mpc.coordinate_range.tolist()):
            if np.isfinite([least, most]).any():
                now = float(coordinate[i] + error[i])
                rows.append((change[i], least - now, most - now, self.mpc.excess_weight))
        return rows

    def _limit_inputs(self, planned: Array) -> list[tuple[Array, float, float, float]]:
        """Return the hard rows: ranges and rates of the inputs at the ends of the blocks."""
        m, rows, unit = planned.shape[1], [], np.eye(self.moves.size)
        reach = self.bounds.rate * self.mpc.gains.sample
        ends = np.cumsum(self.mpc.blocks) - 1
        for b, end in enumerate(ends.tolist()):
            for u in range(m):
                v, now = b * m + u, planned[end, u] + self.moves[b, u]
                rows.append((unit[v], self.bounds.least[u] - now, self.bounds.most[u] - now, 0.0))
                before = self.sent[0][u] if b == 0 else planned[ends[b - 1], u] + self.moves[b - 1, u]
                row = unit[v] - (0.0 if b == 0 else unit[v - m])
                room = reach[u] * self.mpc.blocks[b] if b else reach[u]
                step = now - before if b else planned[0, u] + self.moves[0, u] - before
                rows.append((row, -room - step, room - step, 0.0))
        return rows


def _solve(hessian: Array, gradient: Array, rows: list[tuple[Array, float, float, float]]) -> Array:
    """Return the least 0.5 x H x + g x + 0.5 weight slack^2, with a slack for each soft row."""
    soft = [k for k, row in enumerate(rows) if row[3]]
    n = len(gradient)
    whole = np.zeros((n + len(soft), n + len(soft)))
    whole[:n, :n] = hessian
    matrix = np.hstack([np.array([row[0] for row in rows]), np.zeros((len(rows), len(soft)))])
    for j, k in enumerate(soft):
        whole[n + j, n + j], matrix[k, n + j] = rows[k][3], -1.0
    solver = ca.conic(
        "program",
        "qpoases",
        {"h": ca.Sparsity.dense(*whole.shape), "a": ca.Sparsity.dense(*matrix.shape)},
        {"printLevel": "none"},
    )
    found = solver(
        h=whole, g=np.concatenate([gradient, np.zeros(len(soft))]), a=matrix,
        lba=[row[1] for row in rows], uba=[row[2] for row in rows],
    )  # fmt: skip
    return np.asarray(found["x"]).ravel()[:n]
