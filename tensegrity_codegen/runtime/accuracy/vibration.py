"""Vibrations of stiff members about their smooth motion, in closed form, for methods that leave them out.

A stiff member whose ends no other one shares stretches by s beyond what its smooth motion asks for, which
is the tension T of a rigid member over mu, at the rate T' / mu:

    s'' + c w s' + mu w s = 0,    w = g H^-1 g^T,    its ends move by H^-1 g^T s / w

with g the row of its directions. w is constant, so that s(t) is a damped cosine; its phase after the time t
is off by what slow members at its ends and turning add to the frequency, and its size by their damping.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from tensegrity_codegen.runtime.accuracy.rates import Rates
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.driven import DrivenArguments
from tensegrity_codegen.system.arrays import FloatArray, IntArray

TENSION_COMPLIANCE = 1e-12  # compliance over w, of members whose tensions their lengths do not determine
AMPLITUDE_SAFETY = 1.5  # amplitudes are those of the start, to first order: a half of them more may come
DAMPED_MARGIN = 2.0  # times an amplitude that implicit steps damp out: it sees it a little differently
MAX_DAMPING_RATIO = 0.5  # damping over critical, below which a member counts as vibrating
RATE_ANGLE = 1e-3  # [rad] of the fastest vibration, over which the rate of the smooth tensions is taken


@dataclass(frozen=True)
class Vibration:
    """The members that vibrate alone; arrays run over them.

    column: place of each among the tensions; law (n, 3): mu, c, frequency omega; ends (n, 2, n_axes):
    coordinates of both ends, -1 where anchored; offset (n, n_axes) [m] of the member vector; share (n, 2):
    how far each end moves for a unit of stretch; stretch, rate (n,): s and s' at the start; drift [1/s]: the
    error of phases in a second, at most; joined (m, 3): vibration [m], [m/s] and [N] of each member that does
    not vibrate alone; fading: how fast these fade [1/s]; meeting: how many stiff members meet in one node.
    """

    column: IntArray
    law: FloatArray
    ends: IntArray
    offset: FloatArray
    share: FloatArray
    stretch: FloatArray
    rate: FloatArray
    drift: FloatArray
    joined: FloatArray
    fading: float
    meeting: int

    @property
    def alone(self) -> FloatArray:
        """Vibration [m], [m/s] and [N] of each member that vibrates alone, (n, 3)."""
        mu, _, omega = self.law.T
        far = np.sqrt(self.stretch**2 + (self.rate / omega) ** 2)
        return np.stack([far, far * omega, far * mu], axis=1)

    @property
    def others(self) -> FloatArray:
        """What members that do not vibrate alone come to at a node [m], [m/s], and in tensions [N]."""
        return np.asarray(self.meeting * self.joined.max(axis=0, initial=0.0))

    def smooth(self, state: FloatArray) -> FloatArray:
        """Return the state (n_states,) at the start without these vibrations."""
        found = state.copy()
        self._move(found, -self.stretch, -self.rate)
        return found

    def add_to(self, raw: RawTrajectory, start: FloatArray) -> RawTrajectory:
        """Return the run from the smooth state with these vibrations in its states and tensions.

        start (n_states,): the state that it really starts from.
        """
        assert raw.tension is not None
        state, tension = raw.state.copy(), raw.tension.copy()
        state[0] = start
        for row in range(len(raw.time)):
            s, rate = self._at(float(raw.time[row]))
            if row:
                self._move(state[row], s, rate)
            tension[row, self.column] += self.law[:, 0] * s + self.law[:, 1] * rate
        return replace(raw, state=state, tension=tension)

    def error(self, first: float, last: float) -> FloatArray:
        """Return by how much positions [m], velocities [m/s] and tensions [N] are off at most.

        first, last: times [s] between which they are asked for.
        """
        off = np.minimum(2.0, self.drift * (last + 1.0 / self.law[:, 2]))
        most = (off[:, None] * self.alone).max(axis=0, initial=0.0)
        return np.asarray(most + self.others * np.exp(-self.fading * first))

    def damped_out(self, most: float) -> FloatArray:
        """Return what vibrations of amplitudes up to `most` [m] come to [m], [m/s], and in tensions [N]."""
        alone, joined = (part[part[:, 0] <= DAMPED_MARGIN * most] for part in (self.alone, self.joined))
        found = alone.max(axis=0, initial=0.0), self.meeting * joined.max(axis=0, initial=0.0)
        return np.asarray(AMPLITUDE_SAFETY * np.maximum(*found))

    def _at(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Return s and s' at a time [s]."""
        mu, c, omega = self.law.T
        decay = 0.5 * c * omega**2 / mu
        turning = np.sqrt(omega**2 - decay**2)
        a, b = self.stretch, (self.rate + decay * self.stretch) / turning
        cos, sin, fade = np.cos(turning * time), np.sin(turning * time), np.exp(-decay * time)
        s = fade * (a * cos + b * sin)
        return s, fade * turning * (b * cos - a * sin) - decay * s

    def _move(self, state: FloatArray, stretch: FloatArray, rate: FloatArray) -> None:
        """Move the ends in a state, in place."""
        n = len(state) // 2
        vector = find_vectors(state[:n], self.ends, self.offset)
        direction = vector / np.linalg.norm(vector, axis=1)[:, None]
        for amount, part in ((stretch, state[:n]), (rate, state[n:])):
            for end in (0, 1):
                moved = (self.share[:, end] * amount)[:, None] * direction
                free = self.ends[:, end] >= 0
                np.add.at(part, self.ends[:, end][free], moved[free])


def find_vibration(motion: Motion, stiff: tuple[int, ...], rates: Rates) -> Vibration:
    """Return how the members `stiff` vibrate at the start of a motion about their smooth motion."""
    model, state, arguments = motion.model, motion.state, motion.arguments
    n = len(state) // 2
    q, v, members = state[:n], state[n:], np.array(stiff, dtype=np.int64)
    every = np.asarray(model.compute("member_law", **arguments))
    law = every[members]
    mass = scipy.sparse.csr_array(model.compute("mass_matrix", **arguments))
    ends, offset = find_end_coordinates(model, members), law[:, 3:]
    vector, moving = find_vectors(q, ends, offset), find_vectors(v, ends, np.zeros_like(offset))
    length = np.linalg.norm(vector, axis=1)
    direction = vector / length[:, None]
    along, square = np.sum(moving * direction, axis=1), np.sum(moving**2, axis=1)
    alone, share, mobility = _shares(ends, mass)
    mu, c = law[:, 1], law[:, 2]
    elastic = mu > 0
    safe = np.where(elastic, mu, 1.0)
    omega = np.sqrt(safe * mobility)

    def pull(q: FloatArray, v: FloatArray, given: Mapping[str, Any]) -> tuple[FloatArray, FloatArray]:
        force = np.asarray(model.compute("cable_force", coordinate=q, velocity=v, **given))
        vector, moving = find_vectors(q, ends, offset), find_vectors(v, ends, 0.0 * offset)
        return _smooth_pull(mass, ends, force, vector, moving, mobility)

    acceleration, tension = pull(q, v, arguments)
    stretch, rate = length - law[:, 0] - tension / safe, along
    if elastic.any():
        step = RATE_ANGLE / float(omega[elastic].max())
        later = _drive(motion, step)
        _, pulled = pull(q + step * (v + 0.5 * step * acceleration), v + step * acceleration, later)
        grown = np.asarray(model.compute("member_law", **later))[members, 0] - law[:, 0]
        rate = along - ((pulled - tension) / safe + grown) / step
    alone &= elastic & (0.5 * c * omega < MAX_DAMPING_RATIO * safe)
    far = np.where(elastic & ~alone, np.sqrt(stretch**2 + (rate / omega) ** 2), 0.0)
    decay = 0.5 * c * mobility
    slowest = omega**2 / np.maximum(omega, decay + np.sqrt(np.maximum(decay**2 - omega**2, 0.0)))
    fading = np.where(decay < omega, decay, slowest)
    stiffness, damping = _slow_parts(model, members, every, share)
    drift = (0.5 * stiffness * mobility + 1.5 * square / length**2) / omega + 0.5 * damping * mobility
    return Vibration(
        column=np.flatnonzero(alone),
        law=np.stack([mu, c, omega], axis=1)[alone],
        ends=ends[alone],
        offset=offset[alone],
        share=share[alone],
        stretch=stretch[alone],
        rate=rate[alone],
        drift=drift[alone],
        joined=np.stack([far, far * omega, far * mu], axis=1)[elastic & ~alone],
        fading=float(fading[elastic & ~alone].min(initial=np.inf)),
        meeting=rates.meeting,
    )


def _drive(motion: Motion, time: float) -> Mapping[str, Any]:
    """Return the arguments of a motion at a time [s], those of the start where no profile changes them."""
    if not isinstance(motion.schedule, DrivenArguments):
        return motion.arguments
    return {**motion.arguments, **motion.schedule(time)}


def _slow_parts(
    model: CompiledModel, members: IntArray, law: FloatArray, share: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return by how much slow members at the ends of each stiff one stiffen and damp its vibration at most.

    An end that moves by its share stretches a member there by no more; (a + b)^2 <= 2 (a^2 + b^2) where one
    joins both ends.
    """
    ends = np.array(model.manifest.connectivity, dtype=np.int64)
    strands = model.manifest.strands
    is_slow = ~np.isin(strands.member, members)
    slow_ends = strands.ends[is_slow]
    pairs = {frozenset(pair) for pair in slow_ends.tolist()}
    twice = np.array([2.0 if frozenset(pair) in pairs else 1.0 for pair in ends[members].tolist()])
    found = []
    for column in (1, 2):
        total = np.zeros(len(model.manifest.node_name))
        for end in (0, 1):
            np.add.at(total, slow_ends[:, end], law[strands.member[is_slow], column])
        found.append(twice * np.sum(share**2 * total[ends[members]], axis=1))
    return found[0], found[1]


def find_end_coordinates(model: CompiledModel, members: IntArray) -> IntArray:
    """Return the coordinates of both ends of members, (n, 2, n_axes), -1 where anchored."""
    manifest = model.manifest
    place = {(int(node), int(axis)): k for k, (node, axis) in enumerate(manifest.coordinate_node_axis)}
    rows = [
        [[place.get((node, axis), -1) for axis in manifest.axes] for node in manifest.connectivity[member]]
        for member in members
    ]
    return np.array(rows, dtype=np.int64).reshape(len(members), 2, len(manifest.axes))


def find_vectors(x: FloatArray, ends: IntArray, offset: FloatArray) -> FloatArray:
    """Return what members are by coordinates (or velocities) x, (n, n_axes)."""
    free = np.where(ends >= 0, x[ends], 0.0)
    return np.asarray(free[:, 0] - free[:, 1] + offset)


def _smooth_pull(
    mass: Any, ends: IntArray, force: FloatArray, vector: FloatArray, moving: FloatArray, mobility: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return a and tensions T of members that keep their lengths: H a + G^T T = f, G a = -turning."""
    length = np.linalg.norm(vector, axis=1)
    direction = vector / length[:, None]
    turning = (np.sum(moving**2, axis=1) - np.sum(moving * direction, axis=1) ** 2) / length
    value = np.stack([direction, -direction], axis=1)
    row = np.broadcast_to(np.arange(len(ends))[:, None, None], ends.shape)
    free = ends >= 0
    g = scipy.sparse.csr_array((value[free], (row[free], ends[free])), shape=(len(ends), len(force)))
    softly = scipy.sparse.diags_array(
        -TENSION_COMPLIANCE * mobility
    )  # where members hold each other's lengths
    saddle = scipy.sparse.block_array([[mass, g.T], [g, softly]], format="csc")
    found = np.asarray(scipy.sparse.linalg.spsolve(saddle, np.concatenate([force, -turning])))
    return found[: len(force)], found[len(force) :]


def _shares(
    ends: IntArray, mass: "scipy.sparse.csr_array"
) -> tuple[NDArray[np.bool_], FloatArray, FloatArray]:
    """Return which members stand alone, how far their ends move for a unit of stretch (n, 2), and w.

    Alone are those that share no coordinate with another one, and no mass but their own. An end that is
    anchored on some axes only does not stand alone: w changes as the member turns.
    """
    free = ends >= 0
    moves = np.asarray(np.any(free, axis=2))
    use = np.bincount(ends[free], minlength=mass.shape[0])
    shared = np.any(free & (use[ends] > 1), axis=(1, 2))
    first = np.where(moves, ends.max(axis=2), 0)
    diagonal = mass.diagonal()[first]
    # Of no members SciPy would return a sparse array.
    coupling = np.asarray(mass[first[:, 0], first[:, 1]]).ravel() if len(ends) else np.zeros(0)
    coupling = np.where(np.all(moves, axis=1), coupling, 0.0)
    joined = np.abs(coupling) > 0
    others = np.diff(mass.indptr)[first] > 1 + joined[:, None]
    partly = np.any(moves != np.all(free, axis=2), axis=1)
    alone = np.asarray(~(partly | shared | np.any(others & moves, axis=1)), dtype=bool)
    determinant = diagonal[:, 0] * diagonal[:, 1] - coupling**2
    one = np.where(moves, 1.0 / diagonal, 0.0) * np.array([1.0, -1.0])
    both = np.stack([diagonal[:, 1] + coupling, -diagonal[:, 0] - coupling], axis=1) / determinant[:, None]
    moved = np.where(joined[:, None], both, one)
    mobility = moved[:, 0] - moved[:, 1]
    return alone, moved / mobility[:, None], mobility
