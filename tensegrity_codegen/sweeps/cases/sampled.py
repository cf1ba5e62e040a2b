"""Samples: rows of values drawn from distributions, by plain random numbers or by sequences that fill evenly.

Rows are functions of seed and row number alone, so that any process computes any rows and gets the same ones.

random            independent numbers of a counter-based generator (Philox)
latin_hypercube   each key has one value in each of n equal parts of its distribution
sobol             Sobol' sequence, scrambled; balanced for n = 2, 4, 8, ...
saltelli          n pairs (A, B) of rows of a Sobol' sequence in 2 D dimensions, each of which gives D + 2
                  rows: A; A with key 1 from B; ...; A with key D from B; B. This is the layout of SALib's
                  `sobol.sample(problem, n, calc_second_order=False)`, which `SALib.analyze.sobol` reads.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from threading import Lock
from typing import Any

import numpy as np
from scipy.stats import qmc

from tensegrity_codegen.sweeps.cases.distributions import Distribution, read_count, read_distribution
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import check_choice

METHODS = ("random", "latin_hypercube", "sobol", "saltelli")
SMALLEST = 2.0**-54  # probabilities are kept from 0 and 1, where a normal distribution has no value
LARGEST = 1.0 - 2.0**-53
WORDS = 4  # numbers that Philox makes of one value of its counter
BITS = 30  # of the coordinates of a Sobol' sequence


@dataclass(frozen=True)
class Sampling:
    """Random numbers of a sweep: their distributions, how many, and how they are drawn.

    Attributes
    ----------
    distributions : mapping or sequence of str
        Key -> ``"normal(m,s)"``, ``"uniform(a,b)"`` or ``"lognormal(m,s)"``; or ``"KEY=..."``.
    n : int
        Number of samples; of method ``"saltelli"`` the base number, which gives n (D + 2) cases of D keys.
    seed : int
        The same seed gives the same cases.
    method : str
        ``"random"``, ``"latin_hypercube"``, ``"sobol"`` or ``"saltelli"``.
    """

    distributions: Mapping[str, Any] | Sequence[str]
    n: int
    seed: int = 0
    method: str = "random"


class PlainRandom:
    """Independent random numbers, of a generator that can start anywhere."""

    def __init__(self, width: int, seed: int) -> None:
        self.width, self.seed = width, seed

    def rows(self, first: int, last: int) -> FloatArray:
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

    def rows(self, first: int, last: int) -> FloatArray:
        """Return rows first to last - 1, (last - first, width)."""
        return self._columns[:, first:last].T

    @cached_property
    def _columns(self) -> FloatArray:
        columns = np.empty((self.width, self.n))
        for column, seed in enumerate(np.random.SeedSequence(self.seed).spawn(self.width)):
            engine = qmc.LatinHypercube(1, seed=np.random.default_rng(seed))
            columns[column] = engine.random(self.n)[:, 0]
        return columns


class SobolPoints:
    """The scrambled Sobol' sequence of `qmc.Sobol`, each point in the middle of its interval of 2^-30."""

    def __init__(self, width: int, seed: int) -> None:
        self._engine = qmc.Sobol(width, scramble=True, bits=BITS, seed=np.random.default_rng(seed))
        self._lock = Lock()  # of the engine's place, which threads of a Dask worker share

    def rows(self, first: int, last: int) -> FloatArray:
        """Return rows first to last - 1, (last - first, width); ascending ones are the fastest."""
        with self._lock, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the engine warns where it does not draw 2, 4, 8, ... points
            if first < self._engine.num_generated:
                self._engine.reset()
            if first > self._engine.num_generated:
                self._engine.fast_forward(first - self._engine.num_generated)
            points: FloatArray = self._engine.random(last - first) + 2.0 ** -(BITS + 1)
        return points


@dataclass(frozen=True)
class Sample:
    """A sample of some keys.

    keys: keys that vary.
    distributions: distribution of each key; the keys are independent.
    n: number of rows; of method ``"saltelli"`` the number of base rows.
    method: one of METHODS.
    seed: seed: the same seed gives the same rows.
    """

    keys: tuple[str, ...]
    distributions: tuple[Distribution, ...]
    n: int
    method: str
    seed: int

    @property
    def count(self) -> int:
        """Number of rows."""
        return self.n * (len(self.keys) + 2) if self.method == "saltelli" else self.n

    def values(self, first: int, last: int) -> FloatArray:
        """Return rows first to last - 1, (last - first, n_keys)."""
        unit = self._crossed(first, last) if self.method == "saltelli" else self._unit.rows(first, last)
        columns = zip(self.distributions, np.clip(unit, SMALLEST, LARGEST).T, strict=True)
        return np.stack([item.compute_quantile(column) for item, column in columns], axis=1)

    def describe(self) -> dict[str, Any]:
        """Return all that the rows follow from, as plain values."""
        distributions = {key: str(item) for key, item in zip(self.keys, self.distributions, strict=True)}
        return {"method": self.method, "n": self.n, "seed": self.seed, "distributions": distributions}

    def __getstate__(self) -> dict[str, Any]:
        return {key: value for key, value in self.__dict__.items() if key != "_unit"}

    @cached_property
    def _unit(self) -> PlainRandom | LatinHypercube | SobolPoints:
        width = len(self.keys)
        if self.method == "random":
            return PlainRandom(width, self.seed)
        if self.method == "latin_hypercube":
            return LatinHypercube(width, self.n, self.seed)
        return SobolPoints(2 * width if self.method == "saltelli" else width, self.seed)

    def _crossed(self, first: int, last: int) -> FloatArray:
        """Return rows of the layout of method saltelli."""
        width = len(self.keys)
        base, place = np.divmod(np.arange(first, last), width + 2)
        start = first // (width + 2)
        pairs = self._unit.rows(start, -(-last // (width + 2)))[base - start]
        is_b = (place[:, None] - 1 == np.arange(width)) | (place[:, None] == width + 1)
        crossed: FloatArray = np.where(is_b, pairs[:, width:], pairs[:, :width])
        return crossed


def build_sample(
    given: Mapping[str, Any] | Sequence[tuple[str, Any]], n: Any, seed: Any, method: str, where: str
) -> Sample:
    """Return the sample of keys with their distributions, as texts or sequences.

    Raises what `read_distribution` raises, UnknownNameError for a method, InvalidValueError for n or seed.
    """
    check_choice(method, METHODS, "way of sampling", "sampling")
    pairs = list(given.items() if isinstance(given, Mapping) else given)
    return Sample(
        tuple(key for key, _ in pairs),
        tuple(read_distribution(item, f"{where} {key}") for key, item in pairs),
        read_count(n, "n", "number of samples"),
        method,
        read_count(seed, "seed", "seed", least=0),
    )
