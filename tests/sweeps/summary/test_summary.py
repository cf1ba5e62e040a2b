"""The summary as data: endings, keys of failures, distributions, correlations, worst cases."""

import json

import numpy as np
import pytest

from tensegrity_codegen.cli.verbs.sweep import build_commands
from tensegrity_codegen.sweeps.summary.figures import bin_means, find_edges, is_logarithmic, make_bins
from tensegrity_codegen.sweeps.summary.statistics import compute_rank_correlation, describe_distribution
from tensegrity_codegen.sweeps.summary.summary import summarize
from tensegrity_codegen.system.errors import UnknownNameError
from tensegrity_codegen.system.files import plain
from tests.sweeps.summary.sweeps import make_grid, make_sample, make_sweep


def test_endings_are_counted_with_their_first_message() -> None:
    sweep = make_sample(2000)
    summary = summarize(sweep)
    counts = {item.status: item.count for item in summary.endings}
    assert counts == {
        "converged": int((sweep.status == 1).sum()),
        "no_equilibrium": int((sweep.status == 2).sum()),
        "not_converged": 1,
    }
    failed = {item.status: item for item in summary.endings if not item.good}
    assert failed["not_converged"].first == 0
    assert failed["not_converged"].message == "no convergence in 100 steps"
    assert failed["no_equilibrium"].first == int(np.flatnonzero(sweep.status == 2)[0])
    failed_count = 2000 - counts["converged"]
    assert summary.headline == f"{counts['converged']:,} of 2,000 cases converged, {failed_count} did not"


def test_cases_that_are_not_computed_are_no_failures() -> None:
    sweep = make_sweep(np.zeros((4, 1)), ["a"], [], status=[1, 4, 1, 4])
    summary = summarize(sweep)
    assert summary.headline == "2 of 4 cases converged, 2 not computed yet"
    assert summary.failing == ()
    assert summary.worst == ()


def test_the_key_that_failures_depend_on_is_found() -> None:
    failing = {row.key: row for row in summarize(make_sample(2000)).failing}
    assert failing["loads[0].force[2]"].distance > 0.5
    assert failing["loads[0].force[2]"].failed > 0.8
    assert failing["shape.height"].distance < 0.2


def test_worst_cases_are_failures_and_extremes_once_each() -> None:
    sweep = make_sample(500)
    summary = summarize(sweep)
    cases = [item.case for item in summary.worst]
    assert len(set(cases)) == len(cases)
    energy = summary.chosen[0].result.values
    largest = next(item for item in summary.worst if "largest elastic_energy" in item.reason)
    assert largest.case == int(np.nanargmax(energy))
    assert list(largest.keys.values()) == sweep.key_values[largest.case].tolist()
    assert {item.status for item in summary.worst} >= {"no_equilibrium", "not_converged"}


def test_commands_have_the_options_of_the_sweep() -> None:
    values = np.arange(3.0)[:, None]
    options = {"method": "rk853", "t_end": 0.5, "step": None, "unknown": 3}
    sweep = make_sweep(values, ["a"], [], status=[0, 3, 0], operation="simulate", options=options)
    (worst,) = summarize(sweep, build_commands=build_commands).worst
    assert worst.commands == (
        "tensegrity-codegen sweep case made.zarr 1 --out case1.toml",
        "tensegrity-codegen simulate case1.toml --t-end 0.5 --method rk853",
    )


def test_commands_set_inputs() -> None:
    values = np.array([[0.5, 2.0], [0.25, -1.0]])
    keys = ["input.motor 1", "gravity[2]"]
    sweep = make_sweep(values, keys, [], status=[1, 2])
    assert summarize(sweep, build_commands=build_commands).worst[0].commands[1] == (
        "tensegrity-codegen equilibrium case1.toml --input 'motor 1=0.25'"
    )
    evaluated = make_sweep(values, keys, [], status=[0, 4], operation="evaluate", kept_names=["a.max"])
    assert build_commands(evaluated, 1)[1] == (
        "tensegrity-codegen sweep case1.toml --do evaluate --over 'input.motor 1=0.25' --keep a.max "
        "--out case1.zarr"
    )


def test_all_of_it_is_plain_json() -> None:
    for sweep in (make_grid(failed=3), make_sample(300), make_sweep(np.zeros((1, 0)), [], [])):
        data = json.loads(json.dumps(plain(summarize(sweep).as_dict()), allow_nan=False))
        assert data["n_cases"] == sweep.count
        assert sum(item["count"] for item in data["endings"]) == sweep.count
    assert json.dumps(plain(summarize(make_grid()).as_dict())).count('"indices"') == 3


def test_a_key_that_does_not_vary_is_named() -> None:
    with pytest.raises(UnknownNameError, match="does not vary") as caught:
        summarize(make_grid(), over=["loads[0].force[1]"])
    assert "loads[0].force[2]" in str(caught.value)


def test_distributions_and_correlations() -> None:
    found = describe_distribution(np.array([1.0, np.nan, 3.0, 2.0]))
    assert (found.count, found.least, found.median, found.largest, found.deviation) == (3, 1, 2, 3, 1)
    assert describe_distribution(np.full(2, np.nan)).count == 0
    x = np.linspace(0.1, 1, 50)
    keys = np.column_stack([x, -x, np.ones(50)])
    np.testing.assert_allclose(compute_rank_correlation(keys, np.exp(9 * x)), [1, -1, np.nan], atol=1e-12)


def test_bins_hold_all_values() -> None:
    for values in (np.array([3.0, 3.0]), np.zeros(4), np.array([-1e9, 2.0]), np.geomspace(1e-6, 1e6, 99)):
        edges = make_bins(values, 10)
        assert np.histogram(values, edges)[0].sum() == len(values)
        assert (np.diff(edges) > 0).all()
    assert is_logarithmic(np.geomspace(1, 1e4, 9))
    assert not is_logarithmic(np.linspace(1, 1e4, 9))
    points = np.array([1.0, 2.0, 4.0])
    assert find_edges(points).tolist() == [0.5, 1.5, 3.0, 5.0]


def test_means_of_bins() -> None:
    x, y = np.array([0.0, 0.0, 1.0, 1.0]), np.array([0.0, 0.0, 0.0, 1.0])
    edges = np.array([-0.5, 0.5, 1.5])
    means = bin_means(x, y, np.array([1.0, 3.0, np.nan, 5.0]), edges, edges)
    np.testing.assert_array_equal(means, [[2.0, np.nan], [np.nan, 5.0]])
