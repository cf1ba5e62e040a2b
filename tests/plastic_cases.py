"""Structures with plastic members, their motion in closed form, and one by an independent integration."""

from math import acos, atan2, cos, hypot, inf, pi, sin, sqrt
from typing import Any

import numpy as np
import scipy.integrate
from numpy.typing import NDArray

from tensegrity_codegen.structure.structure import Structure
from tests.runtime.build import make_structure, spring

Array = NDArray[np.float64]
STIFFNESS, YIELD_FORCE, HARDENING, SPEED = 1e4, 50.0, 0.1, 2.0


def with_plastic(
    structure: Structure, yield_force: Any, hardening: Any = HARDENING, isotropic: Any = 0.0
) -> Structure:
    """Return the structure with plastic members; a yield force of 0: the member is elastic."""
    force = np.broadcast_to(np.asarray(yield_force, dtype=float), structure.n_members)
    with np.errstate(invalid="ignore"):  # of rigid bars
        elongation = force / structure.mu
    values = {"yield_elongation": elongation, "hardening": hardening, "isotropic": isotropic}
    own = {name: np.where(force > 0, value, 0.0) for name, value in values.items()}
    return structure.with_changes(law_parameter=own)


def make_mass(
    hardening: float = HARDENING, isotropic: float = 0.0, *, yield_force: float = YIELD_FORCE, **member: Any
) -> Structure:
    """Return a mass of 1 kg at 2 m/s on one plastic spring of 1 m and 1e4 N/m, along x."""
    one = make_structure(
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
        [spring(0, 1, 1.0, STIFFNESS, **member)],
        anchored={0: "xyz", 1: "yz"},
    )
    velocity = np.array([[0.0, 0.0, 0.0], [SPEED, 0.0, 0.0]])
    return with_plastic(one, yield_force, hardening, isotropic).with_changes(node_velocity=velocity)


def follow_mass(
    times: Any, hardening: float = HARDENING, isotropic: float = 0.0
) -> tuple[Array, list[float]]:
    """Return x, x', q and a of `make_mass` at these times, (n_t, 4), and the times of its events.

    Piece by piece x'' = -k x - f: with k = 1e4 before flow and h k in flow, until t - X reaches its limit or
    x' = 0.
    """
    ratio = hardening / (1.0 - hardening)
    x, rate, q, a, time, side = 0.0, SPEED, 0.0, 0.0, 0.0, 0
    found, done, events = np.zeros((len(times), 4)), 0, []
    while True:
        kept = a - side * q
        radius = YIELD_FORCE + isotropic * ratio * STIFFNESS * kept
        slope = hardening * STIFFNESS if side else STIFFNESS
        force = side * (1.0 - hardening) * radius if side else -STIFFNESS * q
        omega, start = sqrt(slope), (x, rate)

        def at(
            s: float, start: Any = start, omega: float = omega, force: float = force
        ) -> tuple[float, float]:
            if omega == 0.0:
                return start[0] + start[1] * s - force * s * s / 2, start[1] - force * s
            rest = -force / omega**2
            swing, turn = start[0] - rest, start[1] / omega
            place = rest + swing * cos(omega * s) + turn * sin(omega * s)
            return place, omega * (turn * cos(omega * s) - swing * sin(omega * s))

        ends: list[tuple[float, int]] = [(inf, 0)]
        if side and omega == 0.0:
            ends.append((rate / force, 0))
        elif side:
            turn = atan2(rate, (x + force / slope) * omega) / omega
            ends.append((turn + (pi / omega if turn < 1e-12 else 0.0), 0))
        else:
            limit = YIELD_FORCE + isotropic * ratio * STIFFNESS * a
            back = (1.0 - isotropic) * ratio * STIFFNESS * q
            for sign in (1, -1):
                height = (back + sign * limit) / STIFFNESS
                size, phase = hypot(x - q, rate / omega), atan2(rate / omega, x - q)
                for angle in (
                    (phase - acos(height / size), phase + acos(height / size)) if abs(height) < size else ()
                ):
                    s = (angle % (2 * pi)) / omega
                    if sign * at(s)[1] > 1e-9:
                        ends.append((s, sign))
        length, following = min(ends)
        while done < len(times) and times[done] <= time + length:
            place, speed = at(times[done] - time)
            own = (1.0 - hardening) * (place - side * radius / STIFFNESS) if side else q
            found[done] = place, speed, own, a if not side else kept + side * own
            done += 1
        if done == len(times):
            return found, events
        x, rate = at(length)
        if side:
            q, rate = (1.0 - hardening) * (x - side * radius / STIFFNESS), 0.0
            a = kept + side * q
        time, side = time + length, following
        events.append(time)


def integrate_net(structure: Structure, t_end: float) -> tuple[Array, Array]:
    """Return coordinates and plastic elongations at t_end of springs that yield, by SciPy with events.

    The textbook form: q and a are integrated, t = mu (x - q); a kinematic and isotropic back force.
    """
    places, n = structure.coordinate_node_axis, structure.n_coordinates
    ends, mu, rest = structure.connectivity, structure.mu, structure.rest_length
    mass = structure.node_mass[places[:, 0]]
    limit, h, b = (structure.member_value(k) for k in ("yield_elongation", "hardening", "isotropic"))
    plastic = limit > 0
    hard, m = h / (1.0 - h) * mu, structure.n_members
    cable = structure.tension_only

    def measure(state: Array) -> tuple[Array, Array, Array]:
        position, velocity = structure.node_position.copy(), np.zeros((structure.n_nodes, 3))
        position[places[:, 0], places[:, 1]] = state[:n]
        velocity[places[:, 0], places[:, 1]] = state[n : 2 * n]
        d, v = (field[ends[:, 0]] - field[ends[:, 1]] for field in (position, velocity))
        length = np.linalg.norm(d, axis=1)
        return length - rest, (d * v).sum(axis=1) / length, d / length[:, None]

    def tension(x: Array, q: Array) -> Array:
        pull = mu * (x - q)
        return np.where(cable, np.maximum(pull, 0.0), pull)

    def rate(_: float, state: Array, sides: Array) -> Array:
        x, speed, direction = measure(state)
        pull = tension(x, state[2 * n : 2 * n + m])
        force = structure.node_load + structure.node_mass[:, None] * structure.gravity
        np.add.at(force, ends[:, 0], -pull[:, None] * direction)
        np.add.at(force, ends[:, 1], pull[:, None] * direction)
        flow = np.where(sides != 0, mu * speed / (mu + hard), 0.0)
        acceleration = force[places[:, 0], places[:, 1]] / mass
        return np.concatenate([state[n : 2 * n], acceleration, flow, sides * flow])

    def room(state: Array, sides: Array, e: int, sign: int) -> float:
        x, speed, _ = measure(state)
        q, a = state[2 * n : 2 * n + m], state[2 * n + m :]
        if sides[e] == sign:
            return float(max(-sign * speed[e], -(x - q)[e] if cable[e] and sign < 0 else -np.inf))
        back = (1.0 - b[e]) * hard[e] * q[e]
        reach = mu[e] * limit[e] + b[e] * hard[e] * a[e]
        return float((reach - sign * (tension(x, q)[e] - back)) / mu[e])

    state = np.concatenate([structure.node_position[places[:, 0], places[:, 1]], np.zeros(n + 2 * m)])
    state[n : 2 * n] = structure.node_velocity[places[:, 0], places[:, 1]]
    time, sides = 0.0, np.zeros(m, dtype=int)
    keys = [(int(e), sign) for e in np.flatnonzero(plastic) for sign in (1, -1)]
    while True:
        watched = []
        for e, sign in keys:

            def event(_: float, z: Array, sides: Array, e: int = e, sign: int = sign) -> float:
                return room(z, sides, e, sign)

            event.terminal, event.direction = True, 1 if sides[e] == sign else -1  # type: ignore[attr-defined]
            watched.append(event)
        run = scipy.integrate.solve_ivp(
            rate, (time, t_end), state, "DOP853", events=watched, args=(sides,), rtol=1e-12, atol=1e-13
        )
        time, state = float(run.t[-1]), run.y[:, -1].copy()
        if run.status != 1:
            return state[:n], state[2 * n : 2 * n + m]
        for (e, sign), times in zip(keys, run.t_events, strict=True):
            if len(times):
                ended = sides[e] == sign
                sides[e] = 0 if ended else sign
        # An explicit step beyond the zero, so that rounding does not turn the next run back at once
        step = 1e-9
        state, time = state + step * rate(time, state, sides), time + step
