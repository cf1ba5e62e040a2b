"""Cables with friction at rings, and their motion by an independent program with NumPy and SciPy."""

from itertools import product
from typing import Any

import numpy as np
import scipy.integrate
from numpy.typing import NDArray

from tensegrity_codegen.structure.structure import Structure
from tests.scene.samples import build

Array = NDArray[Any]
GRAVITY = 9.81
BAR = {"kind": "bar"}


def make_atwood(
    friction: float, wrap_deg: float = 0.0, stiffness: float = 1e5, **tension: float
) -> Structure:
    """Return 1 kg and 1.2 kg on one cable over a ring; left, right: tensions at the start [N]."""
    strand = {"kind": "cable", "axial_stiffness": stiffness, "damping": 100.0}
    pull = {"left": 10.0, "right": 10.0} | tension
    return build(
        {
            "name": "atwood",
            "axes": "xz",
            "gravity": [0, -GRAVITY],
            "nodes": {
                "left": {"position": [0, -1], "mass": 1.0, "anchored": "x"},
                "ring": {"position": [0, 0], "anchored": True},
                "right": {"position": [0, -1], "mass": 1.2, "anchored": "x"},
            },
            "members": {
                "left": {**strand, "nodes": ["left", "ring"], "prestress": pull["left"]},
                "right": {**strand, "nodes": ["ring", "right"], "prestress": pull["right"]},
            },
            "sliding": {"rope": {"strands": ["left", "right"], "friction": friction, "wrap_deg": wrap_deg}},
        }
    )[0]


def make_swing(friction: float = 0.15, *, damping: float = 3.0, **more: Any) -> Structure:
    """Return two masses in the plane on one cable over a ring that hangs in two springs, with a winch."""
    return build(
        {
            "name": "swing",
            "axes": "xz",
            "gravity": [0, -GRAVITY],
            "nodes": {
                "a": {"position": [-0.6, -0.8], "mass": 1.0, "velocity": [0.3, 0.2]},
                "ring": {"position": [0.1, 0.0], "mass": 0.5},
                "b": {"position": [0.9, -0.7], "mass": 1.4},
                "west": {"position": [-1, 1], "anchored": True},
                "east": {"position": [1, 1], "anchored": True},
            },
            "members": {
                "hang": {**BAR, "nodes": ["west", "ring"], "spring_constant": 300.0, "rest_length": 1.3},
                "rope": {
                    "kind": "cable",
                    "nodes": ["a", "ring", "b"],
                    "axial_stiffness": 400.0,
                    "damping": damping,
                    "rest_length": 1.96,
                    "friction": friction,
                },
                "hold": {**BAR, "nodes": ["east", "ring"], "spring_constant": 200.0, "rest_length": 1.2},
            },
            "inputs": [{"kind": "rest_length", "name": "winch", "members": ["rope"]}],
            **more,
        }
    )[0]  # fmt: skip


def make_loop() -> Structure:
    """Return a cable between two held nodes over a held ring, with a winch, beside a mass on a spring."""
    held = {"a": [-1, 0], "ring": [0, 0], "b": [0, -1], "top": [3, 0]}
    return build(
        {
            "name": "loop",
            "axes": "xz",
            "nodes": {
                **{name: {"position": at, "anchored": True} for name, at in held.items()},
                "mass": {"position": [3, -1], "mass": 1.0, "anchored": "x"},
            },
            "members": {
                "rope": {
                    "kind": "cable", "nodes": ["a", "ring", "b"], "axial_stiffness": 2000.0, "damping": 60.0,
                    "prestress": 300.0, "friction": 0.1,
                },
                "spring": {**BAR, "nodes": ["top", "mass"], "spring_constant": 50.0, "rest_length": 0.9},
            },
            "inputs": [{"kind": "rest_length", "name": "winch", "members": ["rope"]}],
        }
    )[0]  # fmt: skip


def make_garland(rings: int = 3) -> Structure:
    """Return masses in a row on one cable over free rings, each in a spring; strands go slack and slip."""
    n = rings
    place = {f"r{k}": [0.5 * k, 0.1 * (k % 2), 0.0] for k in range(1, n + 1)}
    nodes = {name: {"position": at, "mass": 0.3 + 0.1 * k} for k, (name, at) in enumerate(place.items())}
    speed = np.random.default_rng(7).normal(size=(n, 3))
    for row, v in zip(nodes.values(), speed.tolist(), strict=True):
        row["velocity"] = v
    nodes |= {f"h{k}": {"position": [0.5 * k, 0.0, 0.6], "anchored": True} for k in range(1, n + 1)}
    nodes |= {
        "a": {"position": [0, 0, 0], "anchored": True},
        "b": {"position": [0.5 * (n + 1), 0, 0], "mass": 0.8, "velocity": [-1.5, 0.4, 0.0]},
    }
    members: dict[str, Any] = {
        f"s{k}": {"kind": "bar", "nodes": [f"h{k}", f"r{k}"], "spring_constant": 60.0, "rest_length": 0.55}
        for k in range(1, n + 1)
    }
    members["line"] = {
        "kind": "cable",
        "nodes": ["a", *place, "b"],
        "axial_stiffness": 150.0,
        "damping": 1.5,
        "prestress": 4.0,
        "friction": [0.1 + 0.05 * k for k in range(n)],
        "wrap_deg": [0.0, 90.0, *([0.0] * n)][:n],
    }
    gravity = [0, 0, -GRAVITY]
    return build({"name": "garland", "gravity": gravity, "nodes": nodes, "members": members})[0]


def find_flows(pull: Array, giving: Array, taking: Array, ratio: Array) -> tuple[Array, Array, float]:
    """Return flows, tensions and the margin of the least certain decision, by trying all cases.

    pull: tensions without slip; giving, taking: damping on what strands give and take; ratio: exp(mu theta).
    Each ring sticks or slips in one of two directions, each strand gives or takes: of all these linear
    systems the one whose solution contradicts its case least.
    """
    n = len(ratio)
    modes, signs = (np.array([*product(*items)]) for items in ([(-1, 0, 1)] * n, [(False, True)] * (n + 1)))
    mode = np.repeat(modes, len(signs), axis=0)
    takes = np.tile(signs, (len(modes), 1))
    damping = np.where(takes, taking, giving)
    # T = pull - damping * (D v), (D v)_k = v_(k-1) - v_k
    matrix = np.zeros((len(mode), n + 1, n), dtype=damping.dtype)
    for k in range(n):
        matrix[:, k, k], matrix[:, k + 1, k] = damping[:, k], -damping[:, k + 1]
    forth = np.where(mode > 0, -ratio, np.where(mode < 0, 1.0, 0.0))
    back = np.where(mode > 0, 1.0, np.where(mode < 0, -ratio, 0.0))
    system = forth[:, :, None] * matrix[:, :-1] + back[:, :, None] * matrix[:, 1:]
    right = -(forth * pull[:-1] + back * pull[1:])
    for k in range(n):
        system[mode[:, k] == 0, k, k] = 1.0
    flow = np.linalg.solve(system, right[:, :, None])[:, :, 0]
    tension = pull + np.einsum("mkn,mn->mk", matrix, flow)
    slide = -np.diff(np.pad(flow, ((0, 0), (1, 1))), axis=1)
    above = tension[:, 1:].real - (ratio * tension[:, :-1]).real
    below = tension[:, :-1].real - (ratio * tension[:, 1:]).real
    size = np.abs(pull.real).sum() + 1e-300
    wrong = np.where(mode == 0, np.maximum(above, below), -mode * flow.real * taking.real.min()) / size
    turned = np.where(takes, -slide.real, slide.real) * taking.real.min() / size
    worst = np.maximum(wrong.max(axis=1), turned.max(axis=1))
    best = int(worst.argmin())
    return flow[best], tension[best], float(worst[best])


class Motion:
    """The equations of motion of a structure with linear members and one cable with friction at rings."""

    def __init__(self, structure: Structure) -> None:
        self.structure = structure
        self.places = structure.coordinate_node_axis
        (self.cable,) = structure.sliding
        self.n = structure.n_coordinates
        self.n_rings = len(self.cable.friction)

    def start(self) -> Array:
        """Return coordinates, velocities and what has slid at the start."""
        fields = (self.structure.node_position, self.structure.node_velocity)
        states = (field[self.places[:, 0], self.places[:, 1]] for field in fields)
        return np.concatenate([*states, np.zeros(self.n_rings)])

    def solve(self, state: Array, u: Any = 0.0) -> tuple[Array, Array, Array, Array]:
        """Return tensions, directions, flows and the margins of kinks (all positive or negative apart)."""
        one, n = self.structure, self.n
        rows = list(self.cable.members)
        position, velocity = (field.astype(state.dtype) for field in (one.node_position, one.node_velocity))
        position[self.places[:, 0], self.places[:, 1]] = state[:n]
        velocity[self.places[:, 0], self.places[:, 1]] = state[n : 2 * n]
        ends = one.connectivity
        d, rate = (field[ends[:, 0]] - field[ends[:, 1]] for field in (position, velocity))
        length = np.sqrt((d * d).sum(axis=1))
        direction = d / length[:, None]
        rest = one.rest_length.astype(state.dtype)
        slid = np.concatenate([[0.0], state[2 * n :], [0.0]])
        rest[rows] += slid[:-1] - slid[1:]
        rest[rows[0]] += u
        tension = (one.spring_constant + one.axial_stiffness / rest) * (length - rest)
        slack = (tension.real < 0) & one.tension_only
        elastic = np.where(slack, 0.0, tension)[rows]
        c, stiffness = one.damping[rows], one.axial_stiffness[rows]
        push = c * ((rate * direction).sum(axis=1))[rows]
        size = np.sqrt(elastic**2 + push**2)
        pull = elastic + np.where(elastic == 0, 0.0, push * elastic / np.where(size == 0, 1.0, size))
        giving = c * (elastic + 1e-7 * stiffness) / (elastic + 1e-4 * stiffness)
        cosine = (direction[rows[:-1]] * direction[rows[1:]]).sum(axis=1)
        turn = np.radians(np.array(self.cable.wrap_deg))
        ratio = np.exp(np.array(self.cable.friction) * np.where(turn > 0, turn, np.arccos(cosine)))
        flow, tension[rows], _ = find_flows(pull, giving, c.astype(pull.dtype), ratio)
        idle = (pull[1:].real + pull[:-1].real) <= 0.0  # both strands slack: no kink there
        pairs = np.stack([pull[1:] - ratio * pull[:-1], pull[:-1] - ratio * pull[1:]]) - idle
        margin = np.concatenate([(length - rest).real[rows], pairs.real.ravel()])
        return tension, direction, flow, margin

    def rate(self, _: float, state: Array, u: Any = 0.0) -> Array:
        """Return the rate of the state."""
        one, n = self.structure, self.n
        tension, direction, flow, _margin = self.solve(state, u)
        force = (one.node_load + one.node_mass[:, None] * one.gravity).astype(state.dtype)
        np.add.at(force, one.connectivity[:, 0], -tension[:, None] * direction)
        np.add.at(force, one.connectivity[:, 1], tension[:, None] * direction)
        acceleration = force[self.places[:, 0], self.places[:, 1]] / one.node_mass[self.places[:, 0]]
        return np.concatenate([state[n : 2 * n], acceleration, flow])

    def integrate(
        self,
        t_end: float,
        method: str = "DOP853",
        rtol: float = 1e-12,
        begin: tuple[float, Array] | None = None,
    ) -> Array:
        """Return the state at t_end; steps of one ring end where it begins or ends to slip or a strand.

        begin: time and state to go on from.
        """
        now, state = begin or (0.0, self.start())
        watched = [self._watch(k) for k in range(4)] if self.n_rings == 1 else None
        while True:
            run = scipy.integrate.solve_ivp(
                self.rate, (now, t_end), state, method, events=watched, rtol=rtol, atol=1e-2 * rtol
            )
            now, state = float(run.t[-1]), run.y[:, -1].copy()
            if run.status != 1:
                return state
            step = 1e-9  # an explicit step beyond the kink, so that the next run does not begin at it
            state, now = state + step * self.rate(now, state), now + step

    def _watch(self, k: int) -> Any:
        def event(_: float, state: Array) -> float:
            return float(self.solve(state)[3][k])

        event.terminal = True  # type: ignore[attr-defined]
        return event
