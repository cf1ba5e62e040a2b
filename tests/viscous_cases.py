"""Structures with viscous members, and their motion by an independent integration."""

from typing import Any

import numpy as np
import scipy.integrate
from numpy.typing import NDArray

from tensegrity_codegen.structure.structure import Structure
from tests.runtime.build import cable, make_structure, spring

Array = NDArray[np.float64]
MU, TIME, FRACTION = 1e3, 0.2, 0.3


def with_viscous(structure: Structure, time: Any, fraction: Any) -> Structure:
    """Return the structure with viscous members; a relaxation time of 0: the member is elastic."""
    times = np.broadcast_to(np.asarray(time, dtype=float), structure.n_members).copy()
    fractions = np.where(times > 0, np.asarray(fraction, dtype=float), 0.0)
    own = {"relaxation_time": times, "relaxed_fraction": fractions}
    return structure.with_changes(law_parameter={**structure.law_parameter, **own})


def make_mass(kind: Any = cable, **member: Any) -> Structure:
    """Return 2 kg on a viscous member of 1 m and 1e3 N/m along x, stretched by 0.05, and pulled by 8 N."""
    one = make_structure(
        [[0.0, 0.0, 0.0], [1.05, 0.0, 0.0]],
        [kind(0, 1, 1.0, MU, **member)],
        anchored={0: "xyz", 1: "yz"},
        load={1: (8.0, 0.0, 0.0)},
        mass=2.0,
    )
    return with_viscous(one, TIME, FRACTION)


def make_net() -> Structure:
    """Return two masses in viscous cables that go slack, a viscous spring and an elastic one."""
    place = [[0, 0, 1], [1, 0, 1], [0.3, 0.9, 1], [0.4, 0.3, 0.2], [0.5, 0.35, -0.3]]
    cables = [(0, 3, 0.94, 2000.0), (1, 3, 1.04, 2000.0), (2, 3, 1.0, 3000.0), (3, 4, 0.51, 1500.0)]
    springs = [spring(0, 4, 1.43, 800.0), spring(1, 4, 1.42, 500.0)]
    net = make_structure(
        place,
        [*(cable(*item) for item in cables), *springs],
        anchored=dict.fromkeys(range(3), "xyz"),
        gravity=(0.0, 0.0, -9.81),
        mass=np.array([1.0, 1.0, 1.0, 1.0, 2.0]),
    )
    velocity = np.zeros((5, 3))
    velocity[3:] = [[2.0, -1.0, -2.0], [1.0, 0.5, -4.0]]
    times, fractions = [0.2, 0.05, 0.5, 0.1, 0.3, 0.0], [0.3, 0.5, 0.2, 0.6, 0.4, 0.0]
    return with_viscous(net, times, fractions).with_changes(node_velocity=velocity)


def integrate_net(structure: Structure, start: Array, t_end: float) -> tuple[Array, Array, float, int]:
    """Return coordinates, dashpots, what these have taken [J] and the number of kinks at t_end, by SciPy.

    The springs and the dashpot of the textbook: c p' = t - k p, where t = mu (x - p) pulls; events end the
    steps at x = p. start: p of all members, of elastic ones 0.
    """
    places, n, m = structure.coordinate_node_axis, structure.n_coordinates, structure.n_members
    ends, mu, rest, only = structure.connectivity, structure.mu, structure.rest_length, structure.tension_only
    mass = structure.node_mass[places[:, 0]]
    time, h = (structure.member_value(key) for key in ("relaxation_time", "relaxed_fraction"))
    viscous = time > 0
    spring_beside = np.where(viscous, h * mu / (1.0 - h), 0.0)
    dashpot = np.where(viscous, time * (mu + spring_beside), 1.0)

    def stretch(state: Array) -> tuple[Array, Array]:
        position = structure.node_position.copy()
        position[places[:, 0], places[:, 1]] = state[:n]
        d = position[ends[:, 0]] - position[ends[:, 1]]
        length = np.linalg.norm(d, axis=1)
        return length - rest - state[2 * n : 2 * n + m], d / length[:, None]

    def rate(_: float, state: Array) -> Array:
        y, direction = stretch(state)
        pull = mu * np.where(only, np.maximum(y, 0.0), y)
        force = structure.node_load + structure.node_mass[:, None] * structure.gravity
        np.add.at(force, ends[:, 0], -pull[:, None] * direction)
        np.add.at(force, ends[:, 1], pull[:, None] * direction)
        flow = np.where(viscous, (pull - spring_beside * state[2 * n : 2 * n + m]) / dashpot, 0.0)
        acceleration = force[places[:, 0], places[:, 1]] / mass
        return np.concatenate([state[n : 2 * n], acceleration, flow, [dashpot @ flow**2]])

    def watch(e: int) -> Any:
        def event(_: float, state: Array) -> float:
            return float(stretch(state)[0][e])

        event.terminal = True  # type: ignore[attr-defined]
        return event

    watched = [watch(int(e)) for e in np.flatnonzero(only)]
    places_of = [structure.node_position, structure.node_velocity]
    state = np.concatenate([*(field[places[:, 0], places[:, 1]] for field in places_of), start, [0.0]])
    now, kinks = 0.0, 0
    while True:
        run = scipy.integrate.solve_ivp(
            rate, (now, t_end), state, "DOP853", events=watched, rtol=1e-12, atol=1e-13
        )
        now, state = float(run.t[-1]), run.y[:, -1].copy()
        if run.status != 1:
            return state[:n], state[2 * n : 2 * n + m], float(state[-1]), kinks
        kinks += 1
        # An explicit step beyond the zero, so that the next run does not begin at it
        step = 1e-9
        state, now = state + step * rate(now, state), now + step
