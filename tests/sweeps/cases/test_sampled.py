"""Samples: the same rows however they are divided, stratified, of their distributions, in SALib's layout."""

import pickle
import warnings

import numpy as np
import pytest
from scipy import stats
from scipy.stats import qmc

from tensegrity_codegen.sweeps.cases.cases import Axis, Cases
from tensegrity_codegen.sweeps.cases.sampled import BITS, METHODS, Sample, SobolPoints, build_sample
from tensegrity_codegen.system.errors import (
    InvalidValueError,
    NonFiniteError,
    TensegrityError,
    UnknownNameError,
)

THREE = {"a": "normal(2,0.5)", "b": "uniform(-1,3)", "c": "lognormal(0,0.25)"}


def sample(method: str, n: int = 257, seed: int = 7) -> Sample:
    return build_sample(THREE, n, seed, method, "sample")


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("size", [1, 13, 100])
def test_rows_are_the_same_however_they_are_divided(method: str, size: int) -> None:
    cases = Cases((), sample(method, 50))
    pieces = [cases.values(first, min(first + size, cases.count)) for first in range(0, cases.count, size)]
    assert np.array_equal(np.concatenate(pieces), cases.values())
    other = pickle.loads(pickle.dumps(cases))
    assert np.array_equal(other.values(7, 29), cases.values(7, 29))


@pytest.mark.parametrize("method", METHODS)
def test_the_seed_decides_the_rows(method: str) -> None:
    first, again, other = (sample(method, seed=seed) for seed in (7, 7, 8))
    assert np.array_equal(first.values(0, 100), again.values(0, 100))
    assert not np.isin(first.values(0, 100), other.values(0, 100)).any()
    assert first.describe() == again.describe() != other.describe()


@pytest.mark.parametrize("method", ["latin_hypercube", "sobol"])
def test_samples_are_stratified_along_every_key(method: str) -> None:
    n = 256
    values = sample(method, n).values(0, n)
    laws = (stats.norm(2, 0.5), stats.uniform(-1, 4), stats.lognorm(0.25))
    for column, law in zip(values.T, laws, strict=True):
        strata = np.floor(law.cdf(column) * n).astype(int)
        assert sorted(strata) == list(range(n))


@pytest.mark.parametrize("method", METHODS)
def test_values_have_the_stated_distributions(method: str) -> None:
    values = sample(method, 2000).values(0, sample(method, 2000).count)
    laws = (stats.norm(2, 0.5), stats.uniform(-1, 4), stats.lognorm(0.25))
    for column, law in zip(values.T, laws, strict=True):
        assert stats.kstest(column, law.cdf).statistic < 0.04


def test_points_are_those_of_the_sobol_engine_of_scipy() -> None:
    engine = qmc.Sobol(4, scramble=True, bits=BITS, seed=np.random.default_rng(3))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        expected = engine.random(300)
    assert np.abs(SobolPoints(4, 3).rows(0, 300) - expected).max() <= 2.0**-BITS


def test_saltelli_has_the_layout_that_salib_reads() -> None:
    salib = pytest.importorskip("SALib.sample.sobol", reason="SALib is not installed: pip install SALib")
    problem = {"num_vars": 3, "names": list("abc"), "bounds": [[0.0, 1.0]] * 3}
    expected = salib.sample(problem, 64, calc_second_order=False, seed=np.random.default_rng(5))
    own = build_sample(dict.fromkeys("abc", "uniform(0,1)"), 64, 5, "saltelli", "sample")
    assert own.count == 64 * 5
    assert np.abs(own.values(0, own.count) - expected).max() < 2.0**-29


def test_first_order_and_total_indices_of_a_linear_function_are_their_closed_form() -> None:
    width, n = 3, 4096
    own = build_sample({"a": "normal(0,1)", "b": "normal(5,2)", "c": "uniform(0,1)"}, n, 1, "saltelli", "")
    weights, deviation = np.array([3.0, 1.0, 6.0]), np.array([1.0, 2.0, 1 / np.sqrt(12)])
    exact = (weights * deviation) ** 2 / ((weights * deviation) ** 2).sum()
    y = (own.values(0, own.count) @ weights).reshape(n, width + 2)
    a, mixed, b = y[:, 0], y[:, 1:-1], y[:, -1]
    first = (b[:, None] * (mixed - a[:, None])).mean(axis=0) / np.var(np.concatenate([a, b]))
    total = 0.5 * ((a[:, None] - mixed) ** 2).mean(axis=0) / np.var(np.concatenate([a, b]))
    assert np.abs(first - exact).max() < 0.02
    assert np.abs(total - exact).max() < 0.02


def test_a_sample_varies_faster_than_a_grid() -> None:
    drawn = sample("random", 5)
    cases = Cases((Axis("g", np.array([1.0, 2.0])),), drawn)
    assert (cases.keys, cases.shape, cases.method, cases.seed) == (("g", "a", "b", "c"), (2, 5), "random", 7)
    values = cases.values()
    assert np.array_equal(values[:, 0], np.repeat([1.0, 2.0], 5))
    assert np.array_equal(values[5:, 1:], drawn.values(0, 5))
    assert np.array_equal(cases.values(3, 8), values[3:8])


@pytest.mark.parametrize(
    ("distribution", "error", "words"),
    [
        ("normal(1,0)", InvalidValueError, "not positive"),
        ("normal(1,-1)", InvalidValueError, "not positive"),
        ("lognormal(0,0)", InvalidValueError, "not positive"),
        ("uniform(1,1)", InvalidValueError, "empty range"),
        ("uniform(2,1)", InvalidValueError, "empty range"),
        ("normal(nan,1)", NonFiniteError, "mean is not finite"),
        ("uniform(0,inf)", NonFiniteError, "upper bound is not finite"),
        ("lognormal(1000,1)", NonFiniteError, "too large"),
        ("normal(1)", InvalidValueError, "not a distribution"),
        ("normal(1,2,3)", InvalidValueError, "not a distribution"),
        ("normal", InvalidValueError, "not a distribution"),
        ("normal(a,b)", InvalidValueError, "not a number"),
        ("gauss(0,1)", UnknownNameError, "normal, uniform, lognormal"),
        (3.0, InvalidValueError, "not a distribution"),
        (("normal", 1.0), InvalidValueError, "not a distribution"),
    ],
)
def test_a_wrong_distribution_is_a_named_error(
    distribution: object, error: type[TensegrityError], words: str
) -> None:
    with pytest.raises(error) as caught:
        build_sample({"shape.height": distribution}, 10, 0, "random", "--sample")
    assert words in str(caught.value)
    assert "--sample shape.height" in str(caught.value)


@pytest.mark.parametrize(("n", "seed"), [(0, 0), (-1, 0), (2.5, 0), (float("nan"), 0), ("x", 0), (5, -1)])
def test_a_wrong_number_of_samples_or_seed_is_a_named_error(n: object, seed: object) -> None:
    with pytest.raises(InvalidValueError, match=r"^(n|seed): "):
        build_sample(THREE, n, seed, "random", "--sample")


def test_an_unknown_method_lists_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match="latin_hypercube"):
        sample("lhs")
