"""Kinds of trouble that a controller meets: times and states that are not those of its structure."""

from collections.abc import Callable, Iterator
from itertools import count

import numpy as np

from tests.control.feedback.pinned_prism import Array

Reading = tuple[float, Array]  # time [s], state
Trouble = Callable[[int, float, Array, np.random.Generator], Reading]


def _jump(degrees: float, rate: float = 0.0) -> Trouble:
    """Angles and their rates [rad/s] off by another sign at every sample."""

    def trouble(k: int, time: float, state: Array, rng: np.random.Generator) -> Reading:
        n = len(state) // 2
        angles, rates = np.radians(degrees) * rng.choice([-1.0, 1.0], n), rate * rng.normal(size=n)
        return time, state + np.concatenate([angles, rates])

    return trouble


def _noise(degrees: float, rate: float) -> Trouble:
    """Normal noise of angles and their rates [rad/s]."""

    def trouble(k: int, time: float, state: Array, rng: np.random.Generator) -> Reading:
        size = np.repeat([np.radians(degrees), rate], len(state) // 2)
        return time, state + size * rng.normal(size=len(state))

    return trouble


def _put(value: float) -> Trouble:
    """One number of the state is replaced."""

    def trouble(k: int, time: float, state: Array, rng: np.random.Generator) -> Reading:
        state[rng.integers(len(state))] = value
        return time, state

    return trouble


def _freeze(every: int) -> Trouble:
    """The state of so many samples ago at most."""
    kept: list[Array] = []

    def trouble(k: int, time: float, state: Array, rng: np.random.Generator) -> Reading:
        if k % every == 0:
            kept[:] = [state + np.radians(3.0)]
        return time, kept[0].copy()

    return trouble


def _change(change: Callable[[int, Array], Array]) -> Trouble:
    """The state changed by a function of sample and state."""
    return lambda k, time, state, rng: (time, change(k, state))


def _tell(change: Callable[[int, float, np.random.Generator], float], degrees: float = 5.0) -> Trouble:
    """Times changed by a function of sample and time, beside jumps of the angles."""

    def trouble(k: int, time: float, state: Array, rng: np.random.Generator) -> Reading:
        return change(k, time, rng), _jump(degrees)(k, time, state, rng)[1]

    return trouble


def _turn(k: int, state: Array, degrees: float = 30.0, samples: int = 200) -> Array:
    """Angles that are driven away by a load, with their rates."""
    n, share = len(state) // 2, min(k / samples, 1.0)
    away = np.radians(degrees) * np.where(np.arange(n) % 2, -1.0, 1.0)
    return np.asarray(state + np.concatenate([away * share, away / (samples * 0.005)]))


TROUBLES: dict[str, Trouble] = {
    "not a number": _put(np.nan),
    "infinite": _put(-np.inf),
    "huge": _put(1e300),
    "large": _put(1e4),
    "turns": _put(20.0),
    "jumps of 2 deg": _jump(2.0),
    "jumps of 5 deg": _jump(5.0),
    "jumps of 10 deg": _jump(10.0),
    "jumps of 20 deg and 10 rad/s": _jump(20.0, 10.0),
    "jumps of 90 deg": _jump(90.0),
    "noise of 0.1 deg and 0.3 rad/s": _noise(0.1, 0.3),
    "noise of 1 deg and 3 rad/s": _noise(1.0, 3.0),
    "noise of 5 deg and 100 rad/s": _noise(5.0, 100.0),
    "frozen": _freeze(1000),
    "every 20th sample": _freeze(20),
    "zero": _change(lambda k, state: 0.0 * state),
    "mirrored": _change(lambda k, state: -state),
    "permuted": _change(lambda k, state: np.asarray(state[::-1])),
    "ten times": _change(lambda k, state: 10.0 * state),
    "driven away": _change(_turn),
    "driven away at once": _change(lambda k, state: _turn(k, state, 60.0, 20)),
    "one spike in ten": _change(lambda k, state: state + 1e3 * (k % 10 == 0)),
    "late": _tell(lambda k, time, rng: 3.0 * time),
    "repeated times": _tell(lambda k, time, rng: time - 0.005 * (k % 3)),
    "times of no use": _tell(lambda k, time, rng: float(rng.choice([np.nan, -1.0, 1e9, time]))),
}


def list_readings(name: str, states: Callable[[float], Array], sample: float, seed: int) -> Iterator[Reading]:
    """Yield times and states of one kind of trouble, sample after sample, for ever.

    states: state of the motion at a time.
    """
    rng, trouble = np.random.default_rng(seed), TROUBLES[name]
    for k in count():
        yield trouble(k, k * sample, states(k * sample).copy(), rng)
