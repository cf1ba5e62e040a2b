"""A Dask cluster of two processes: every task once, the same bits as local processes, and clear errors."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.sweeps.engines.dask_engine import DaskEngine, check_versions, describe_versions
from tensegrity_codegen.sweeps.engines.engine import FinishedTask
from tensegrity_codegen.sweeps.engines.work import SweepWork
from tensegrity_codegen.system.errors import ClusterError
from tests.sweeps.engines.conftest import Square, make_work
from tests.sweeps.status_words import decode_statuses

pytest.importorskip("distributed", reason="Dask is missing: pip install '.[cluster]'")
pytestmark = [
    pytest.mark.peers,
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
]


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    import dask
    from distributed import LocalCluster

    with dask.config.set({"distributed.scheduler.allowed-failures": 1}):
        options = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": ":0"}
        with LocalCluster(**options) as running:
            yield running


def run_all(work: SweepWork, address: str) -> dict[int, FinishedTask]:
    with DaskEngine(address, wait=60.0).run(work, work.plan.tasks) as stream:
        finished = list(stream)
    assert sorted(item.task.number for item in finished) == [task.number for task in work.plan.tasks]
    return {item.task.number: item for item in finished}


def collect(found: dict[int, FinishedTask]) -> tuple[np.ndarray, list[str]]:
    rows = [found[number] for number in sorted(found)]
    words = [word for item in rows for word in decode_statuses(item.result.status)]
    return np.concatenate([item.result.arrays["square"] for item in rows]), words


def test_every_case_has_its_result(cluster: Any) -> None:
    values, words = collect(run_all(make_work(Square(), wrong=5.0), cluster.scheduler_address))
    expected = np.where(np.arange(40) == 5, np.nan, np.arange(40.0) ** 2)
    assert np.array_equal(values, expected, equal_nan=True)
    assert [k for k, word in enumerate(words) if word != "ok"] == [5]


def test_the_task_of_a_killed_worker_runs_again(cluster: Any, tmp_path: Path) -> None:
    work = make_work(Square(folder=str(tmp_path), deadly=17.0, lives=1))
    values, words = collect(run_all(work, cluster.scheduler_address))
    assert np.array_equal(values, np.arange(40.0) ** 2)
    assert set(words) == {"ok"}


def test_a_task_that_ends_two_workers_is_set_aside(cluster: Any, tmp_path: Path) -> None:
    work = make_work(Square(folder=str(tmp_path), deadly=33.0, lives=9))
    values, words = collect(run_all(work, cluster.scheduler_address))
    aside = [k for k, word in enumerate(words) if word == "set_aside"]
    assert set(range(32, 40)) <= set(aside)
    assert np.array_equal(np.delete(values, aside), np.delete(np.arange(40.0) ** 2, aside))
    assert len(list(tmp_path.iterdir())) == 2


def test_a_failing_task_is_set_aside_but_not_an_error_of_this_package(cluster: Any, tmp_path: Path) -> None:
    work = make_work(Square(folder=str(tmp_path / "no"), deadly=17.0, lives=9))
    _, words = collect(run_all(work, cluster.scheduler_address))
    assert [k for k, word in enumerate(words) if word == "set_aside"] == list(range(16, 24))
    broken = make_work(Square(folder=str(tmp_path), deadly=17.0, lives=9, way="library"))
    with pytest.raises(Exception, match="no such library"):
        run_all(broken, cluster.scheduler_address)


def test_other_versions_of_a_worker_are_named() -> None:
    mine = describe_versions()
    check_versions(mine, dict(mine), "tcp://a")
    with pytest.raises(ClusterError, match="other versions") as caught:
        check_versions(mine, {**mine, "scipy": "1.0.0"}, "tcp://a")
    assert "scipy 1.0.0" in str(caught.value)
    assert f"scipy {mine['scipy']}" in str(caught.value)
