"""Points of the unit cube, row by row: any rows on demand, the same however they are divided."""

import warnings
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

WORDS = 4  # numbers that Philox makes of one value of its counter
BITS = 30  # of the coordinates of a Sobol' sequence


class UnitPoints(Protocol):
    """Rows of numbers from 0 to 1."""

    def rows(self, first: int, last: int) -> NDArray[np.float64]:
        """Return rows first to last - 1, (last - first, width)."""
        ...


class PlainRandom:
    """Independent random numbers, of a generator that can start anywhere."""

    def __init__(self, width: int, seed: int) -> None:
        self.width, self.seed = width, seed

    def rows(self, first: int, last: int) -> NDArray[np.float64]:
        """Return rows first to last - 1, (last - first, width)."""
        start, stop = first * self.width, last * self.width
        bits = np.random.Philox(seed=np.random.SeedSequence(self.seed))
        bits.advance(start // WORDS)
        skipped = start % WORDS
        numbers = np.random.Generator(bits).random(skipped + stop - start)
        return numbers[skipped:].reshape(-1, self.width)


class LatinHypercube:
    """One point in each of n equal parts, along each axis: qmc.LatinHypercube, axis by axis."""

    def __init__(self, width: int, n: int, seed: int) -> None:
        self.width, self.n, self.seed = width, n, seed

    def rows(self, first: int, last: int) -> NDArray[np.float64]:
        """Return rows first to last - 1, (last - first, width)."""
        return self._columns[:, first:last].T

    @cached_property
    def _columns(self) -> NDArray[np.float64]:
        columns = np.empty((self.width, self.n))
        for column, seed in enumerate(np.random.SeedSequence(self.seed).spawn(self.width)):
            engine = qmc.LatinHypercube(1, seed=np.random.default_rng(seed))
            columns[column] = engine.random(self.n)[:, 0]
        return columns


class SobolPoints:
    """The first n points of a scrambled Sobol' sequence of `qmc.Sobol`, any rows of it.

    Point k is the shift, xor the direction numbers of the bits of k xor k >> 1. The direction numbers follow
    from the points 0, 1, 2, 4, ... of the engine, in whole numbers of 2^-30.
    """

    def __init__(self, width: int, n: int, seed: int) -> None:
        self.width, self.n, self.seed = width, n, seed

    def rows(self, first: int, last: int) -> NDArray[np.float64]:
        """Return rows first to last - 1, (last - first, width), each in the middle of its interval."""
        shift, directions = self._numbers
        index = np.arange(first, last, dtype=np.uint64)
        gray = index ^ (index >> np.uint64(1))
        points: NDArray[np.uint64] = np.repeat(shift[None, :], last - first, axis=0)
        for bit, direction in enumerate(directions):
            is_set = (gray >> np.uint64(bit)) & np.uint64(1)
            points ^= is_set[:, None] * direction
        return np.asarray((points + 0.5) * 2.0**-BITS, dtype=np.float64)

    @cached_property
    def _numbers(self) -> tuple[NDArray[np.uint64], list[NDArray[np.uint64]]]:
        """Return the shift (width,) and the direction numbers (width,) of each bit of the row number."""
        engine = qmc.Sobol(self.width, scramble=True, bits=BITS, seed=np.random.default_rng(self.seed))
        with warnings.catch_warnings():  # the engine warns where it does not draw 2, 4, 8, ... points
            warnings.simplefilter("ignore")
            drawn, at = {}, 0
            for row in (0, *(1 << bit for bit in range(max(self.n - 1, 0).bit_length()))):
                if row > at:
                    engine.fast_forward(row - at)
                drawn[row] = _whole(engine.random(1)[0])
                at = row + 1
        shift = drawn.pop(0)
        directions, before = [], np.zeros(self.width, dtype=np.uint64)
        for point in drawn.values():
            before = point ^ shift ^ before
            directions.append(before)
        return shift, directions


def _whole(point: NDArray[np.float64]) -> NDArray[np.uint64]:
    return np.rint(point * 2.0**BITS).astype(np.uint64)
