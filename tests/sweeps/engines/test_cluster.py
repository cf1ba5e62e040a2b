"""Schedulers that are not there, or have no workers."""

import socket

import pytest

from tensegrity_codegen.sweeps.engines.dask_engine import DaskEngine
from tensegrity_codegen.system.errors import ClusterError, InvalidValueError
from tests.sweeps.engines.conftest import Square, make_work

pytest.importorskip("distributed", reason="Dask is missing: pip install '.[cluster]'")
pytestmark = [
    pytest.mark.peers,
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
]


def test_a_scheduler_that_is_not_there_or_has_no_workers_is_an_error() -> None:
    from distributed import LocalCluster

    work = make_work(Square())
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        for wrong in (address, "nowhere", "tcp://"):
            with pytest.raises(ClusterError, match="no scheduler answered") as caught:
                DaskEngine(wrong, wait=1.0).run(work, work.plan.tasks).__enter__()
            assert caught.value.exit_code == 2
    with LocalCluster(n_workers=0, dashboard_address=":0") as empty:
        engine = DaskEngine(empty.scheduler_address, wait=0.5)
        with pytest.raises(ClusterError, match="no workers after"):
            engine.run(work, work.plan.tasks).__enter__()
    with pytest.raises(InvalidValueError):
        DaskEngine(address, wait=float("nan")).run(work, work.plan.tasks).__enter__()
