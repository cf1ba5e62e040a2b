"""Structures with stiff bars, and how they move if their bars are rigid: an independent reference."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from tensegrity_codegen.structure.structure import Structure
from tests.runtime.build import bar, cable, make_structure, prism

Array = NDArray[np.float64]


def prism_of_ratio(ratio: float, **more: Any) -> Structure:
    """Prism off its equilibrium, cables of 100 N/m, bars `ratio` times that."""
    return prism(140.0, bar_stiffness=100.0 * ratio, strain=0.25, **more)


def pendulums(ratio: float) -> Structure:
    """Two pendulums in a plane, one with a damped stiff bar, one with a heavy bar, joined by a cable."""
    members = [
        bar(0, 1, 1.0, 100.0 * ratio, damping=0.05 * ratio),
        bar(2, 3, 1.0, 100.0 * ratio, mass=0.6),
        cable(1, 3, 0.7, damping=0.5),
    ]
    position = [[0, 0, 0], [0.8, 0, -0.6], [2, 0, 0], [2.6, 0, -0.8]]
    anchored = {0: "xyz", 2: "xyz"}
    return make_structure(
        position, members, anchored=anchored, axes="xz", gravity=(0.0, 0.0, -9.81), mass=0.8
    )


def class_two(ratio: float, mass: float = 0.0) -> Structure:
    """Four bars in a chain that share nodes, hung up at one end, held by cables."""
    position = np.array([[0, 0, 0], [0.8, 0, -0.6], [0.8, 0.6, -1.4], [0.2, 1.0, -1.4], [0.2, 1.2, -2.2]])
    length = np.linalg.norm(np.diff(position, axis=0), axis=1)
    members = [bar(k, k + 1, float(length[k]), 100.0 * ratio, mass=mass) for k in range(4)]
    members += [cable(0, 3, 1.0, 60.0), cable(1, 4, 1.2, 60.0), cable(0, 2, 1.0, 40.0)]
    return make_structure(position, members, anchored={0: "xyz"}, gravity=(0.0, 0.0, -9.81), mass=0.5)


def move_rigidly(structure: Structure, time: Array) -> tuple[Array, Array]:
    """Free coordinates (n_t, n) and bar tensions (n_t, n_bars) with bars of the lengths that they have.

    H q'' + G^T t = f, G q'' = -G' q': both solved densely, then DOP853 at 1e-12.
    """
    axes = list(structure.axes)
    free = np.flatnonzero(~structure.node_anchored[:, axes].ravel())
    bars, cables = np.flatnonzero(structure.is_bar), np.flatnonzero(~structure.is_bar)
    mass = _mass(structure)
    load = (structure.node_load + mass.sum(axis=1)[:, None] * structure.gravity)[:, axes]
    h = np.kron(mass, np.eye(len(axes)))[np.ix_(free, free)]

    def unfold(values: Array, rest: Array) -> Array:
        full = rest.copy()
        full.ravel()[free] = values
        return full

    def solve(x: Array) -> tuple[Array, Array]:
        n = len(free)
        r = unfold(x[:n], structure.node_position[:, axes])
        v = unfold(x[n:], np.zeros_like(r))
        i, j = structure.connectivity.T
        d, w = r[i] - r[j], v[i] - v[j]
        length = np.linalg.norm(d, axis=1)
        rate = np.sum(d * w, axis=1) / length
        tension = structure.spring_constant * (length - structure.rest_length) + structure.damping * rate
        pulls = (tension > 0) & (length > structure.rest_length)
        force = load.copy()
        for e in cables[pulls[cables]]:
            force[i[e]] -= tension[e] * d[e] / length[e]
            force[j[e]] += tension[e] * d[e] / length[e]
        g = np.zeros((len(bars), *r.shape))
        for row, e in enumerate(bars):
            g[row, i[e]], g[row, j[e]] = d[e] / length[e], -d[e] / length[e]
        g = g.reshape(len(bars), -1)[:, free]
        turning = (np.sum(w * w, axis=1) - rate * rate)[bars] / length[bars]
        matrix = np.block([[h, g.T], [g, np.zeros((len(bars), len(bars)))]])
        found = np.linalg.solve(matrix, np.concatenate([force.ravel()[free], -turning]))
        return found[:n], found[n:]

    q0 = structure.node_position[:, axes].ravel()[free]
    v0 = structure.node_velocity[:, axes].ravel()[free]
    n = len(free)
    run = solve_ivp(
        lambda _, x: np.concatenate([x[n:], solve(x)[0]]),
        (0.0, float(time[-1])),
        np.concatenate([q0, v0]),
        "DOP853",
        t_eval=time,
        rtol=1e-12,
        atol=1e-13,
    )
    return run.y[:n].T, np.array([solve(x)[1] for x in run.y.T])


def _mass(structure: Structure) -> Array:
    mass = np.diag(structure.node_mass)
    for e in np.flatnonzero(structure.member_mass):
        i, j = structure.connectivity[e]
        mass[np.ix_([i, j], [i, j])] += structure.member_mass[e] / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
    return mass
