"""Samples: rows of values drawn from distributions, by plain random numbers or by sequences that fill evenly.

Rows are functions of seed and row number alone, so that any process computes any rows and gets the same ones.

random            independent numbers of a counter-based generator (Philox)
latin_hypercube   each key has one value in each of n equal parts of its distribution
sobol             Sobol' sequence, scrambled; balanced for n = 2, 4, 8, ...
saltelli          n pairs (A, B) of rows of a Sobol' sequence in 2 D dimensions, each of which gives D + 2
                  rows: A; A with key 1 from B; ...; A with key D from B; B. This is the layout of SALib's
                  `sobol.sample(problem, n, calc_second_order=False)`, which `SALib.analyze.sobol` reads.
"""

import math
import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import qmc

from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, check_choice

_CALL = re.compile(r"\s*([A-Za-z_]\w*)\s*\((.*)\)\s*", re.DOTALL)

# Name -> its two parameters.
DISTRIBUTIONS: Mapping[str, tuple[str, str]] = {
    "normal": ("mean", "standard deviation"),
    "uniform": ("lower bound", "upper bound"),
    "lognormal": ("mean of the logarithm", "standard deviation of the logarithm"),
}


@dataclass(frozen=True)
class Distribution:
    """The distribution of one number.

    kind: ``"normal"``: mean and standard deviation. ``"uniform"``: between two bounds. ``"lognormal"``:
    the natural logarithm is normal with this mean and standard deviation; first, second: its two
    parameters.
    """

    kind: str
    first: float
    second: float

    def compute_quantile(self, probability: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values below which these parts (0 < p < 1) of the distribution lie."""
        if self.kind == "uniform":
            values: NDArray[np.float64] = self.first + (self.second - self.first) * probability
            return values
        values = self.first + self.second * ndtri(probability)
        return np.exp(values) if self.kind == "lognormal" else values

    def __str__(self) -> str:
        return f"{self.kind}({self.first!r},{self.second!r})"


def read_distribution(given: Any, where: str) -> Distribution:
    """Return the distribution that a text as `normal(1,0.1)` states, or a sequence as ("normal", 1, 0.1)."""
    if isinstance(given, Distribution):
        kind, parameters = given.kind, [given.first, given.second]
    elif isinstance(given, str):
        call = _CALL.fullmatch(given)
        if call is None:
            raise _not_a_distribution(given, where)
        kind, parameters = call[1], call[2].split(",")  # type: ignore[assignment]
    else:
        try:
            kind, *parameters = given
        except (TypeError, ValueError):
            raise _not_a_distribution(given, where) from None
    check_choice(kind, DISTRIBUTIONS, "distribution", where)
    if len(parameters) != 2:
        raise _not_a_distribution(given, where)
    labels = DISTRIBUTIONS[kind]
    first, second = (read_number(text, where, label) for text, label in zip(parameters, labels, strict=True))
    if kind == "uniform" and not first < second:
        allowed = "a lower bound less than the upper bound"
        raise InvalidValueError("an empty range", where=where, given=given, allowed=allowed)
    if kind != "uniform" and not second > 0:
        problem = f"the {labels[1]} is not positive"
        raise InvalidValueError(problem, where=where, given=given, allowed="a number greater than 0")
    _check_range(Distribution(kind, first, second), given, where)
    return Distribution(kind, first, second)


def _check_range(distribution: Distribution, given: Any, where: str) -> None:
    """Raise NonFiniteError for a distribution whose values overflow, as lognormal(1000, 1)."""
    with np.errstate(over="ignore"):
        ends = distribution.compute_quantile(np.array([1e-17, 1.0 - 2.0**-53]))
    if not (np.isfinite(ends).all() and math.isfinite(distribution.second - distribution.first)):
        problem = "values of this distribution are too large for a number"
        raise NonFiniteError(problem, where=where, given=given, allowed="parameters of ordinary size")


def _not_a_distribution(given: Any, where: str) -> InvalidValueError:
    allowed = "normal(mean,deviation), uniform(a,b), or lognormal(mean,deviation) of the logarithm"
    return InvalidValueError("not a distribution", where=where, given=given, allowed=allowed)


_NUMBER = re.compile(r"\s*[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?\s*")
_NOT_FINITE = ("nan", "inf", "infinity")


def read_number(given: Any, where: str, what: str = "number") -> float:
    """Return a finite number; raises NonFiniteError or InvalidValueError, which name `where` and `what`."""
    if isinstance(given, str):
        if given.strip().lower().lstrip("+-") in _NOT_FINITE:
            raise NonFiniteError(f"the {what} is not finite", where=where, given=given)
        number = float(given) if _NUMBER.fullmatch(given) else None
    else:
        try:
            number = None if isinstance(given, bool) else float(given)
        except (TypeError, ValueError, OverflowError):
            number = None
    if number is None:
        problem = f"the {what} is not a number"
        raise InvalidValueError(problem, where=where, given=given, allowed="a number such as 0.25 or 1e-3")
    if not math.isfinite(number):
        raise NonFiniteError(f"the {what} is not finite", where=where, given=given)
    return number


def read_count(given: Any, where: str, what: str, least: int = 1) -> int:
    """Return a whole number from `least` on; raises InvalidValueError."""
    number = read_number(given, where, what)
    if not number.is_integer() or number < least:
        problem = f"the {what} is not possible"
        raise InvalidValueError(problem, where=where, given=given, allowed=f"a whole number from {least} on")
    return int(number)


METHODS = ("random", "latin_hypercube", "sobol", "saltelli")
SMALLEST = 2.0**-54  # probabilities are kept from 0 and 1, at which a normal distribution has no value
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
            warnings.simplefilter("ignore")  # the engine warns unless it draws 2, 4, 8, ... points
            if first < self._engine.num_generated:
                self._engine.reset()
            if first > self._engine.num_generated:
                self._engine.fast_forward(first - self._engine.num_generated)
            points: FloatArray = self._engine.random(last - first) + 2.0 ** -(BITS + 1)
        return points


@dataclass(frozen=True)
class Sample:
    """A sample of some keys."""

    keys: tuple[str, ...]  # keys that vary
    distributions: tuple[Distribution, ...]  # distribution of each key; the keys are independent
    n: int  # number of rows; of method ``"saltelli"`` the number of base rows
    method: str  # one of METHODS
    seed: int  # seed: the same seed gives the same rows

    @property
    def count(self) -> int:
        """Number of rows."""
        return self.n * (len(self.keys) + 2) if self.method == "saltelli" else self.n

    def values(self, first: int, last: int) -> FloatArray:
        """Return rows first to last - 1, (last - first, n_keys)."""
        unit = self._crossed(first, last) if self.method == "saltelli" else self._unit.rows(first, last)
        columns = zip(self.distributions, np.clip(unit, SMALLEST, LARGEST).T, strict=True)
        return np.stack([distribution.compute_quantile(column) for distribution, column in columns], axis=1)

    def describe(self) -> dict[str, Any]:
        """Return all that the rows follow from, as plain values."""
        distributions = {key: str(law) for key, law in zip(self.keys, self.distributions, strict=True)}
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
        base, row = np.divmod(np.arange(first, last), width + 2)
        start = first // (width + 2)
        pairs = self._unit.rows(start, -(-last // (width + 2)))[base - start]
        is_b = (row[:, None] - 1 == np.arange(width)) | (row[:, None] == width + 1)
        crossed: FloatArray = np.where(is_b, pairs[:, width:], pairs[:, :width])
        return crossed


def build_sample(
    given: Mapping[str, Any] | Sequence[tuple[str, Any]], n: Any, seed: Any, method: str, where: str
) -> Sample:
    """Return the sample of keys with their distributions, as texts or sequences."""
    check_choice(method, METHODS, "way of sampling", "sampling")
    pairs = list(given.items() if isinstance(given, Mapping) else given)
    return Sample(
        tuple(key for key, _ in pairs),
        tuple(read_distribution(distribution, f"{where} {key}") for key, distribution in pairs),
        read_count(n, "n", "number of samples"),
        method,
        read_count(seed, "seed", "seed", least=0),
    )
