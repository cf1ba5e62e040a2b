"""Sweeps on a Dask cluster: the bits of local processes, also after a killed worker and a killed client."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.sweeps.engines.dask_engine import Cluster
from tensegrity_codegen.sweeps.store.folder import find_finished
from tensegrity_codegen.sweeps.sweep import sweep

pytest.importorskip("zarr", reason="Zarr is missing: pip install '.[sweep]'")
pytest.importorskip("distributed", reason="Dask is missing: pip install '.[cluster]'")
pytestmark = [
    pytest.mark.peers,
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
]

SCENE = Path(__file__).resolve().parents[2] / "tensegrity_codegen/scene/examples/prism.toml"
OPTIONS: dict[str, Any] = {
    "do": "simulate",
    "over": {"gravity[2]": "-10:0:20", "rest_length.top1": "0.18:0.185:10"},
    "t_end": 0.2,
    "samples": 5,
    "task_size": 10,
}

CLIENT = """
import sys, time
from tests.sweeps.test_sweep_on_cluster import OPTIONS, SCENE
from tensegrity_codegen.sweeps.engines.dask_engine import Cluster
from tensegrity_codegen.sweeps.sweep import sweep
def slow(progress):
    time.sleep(3600 if progress.computed >= 40 else 0)
sweep(SCENE, **OPTIONS, out=sys.argv[1], workers=Cluster(sys.argv[2]), on_progress=slow)
"""


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    from distributed import LocalCluster

    options = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": ":0"}
    with LocalCluster(**options) as running:
        yield running


def test_a_killed_worker_and_a_killed_client_change_no_bit(cluster: Any, tmp_path: Path) -> None:
    out, address = tmp_path / "cluster.zarr", cluster.scheduler_address
    client = subprocess.Popen([sys.executable, "-c", CLIENT, str(out), address])
    deadline = time.monotonic() + 240.0
    while len(find_finished(out)) < 4 and time.monotonic() < deadline and client.poll() is None:
        time.sleep(0.02)
    client.kill()
    client.wait(timeout=60.0)
    assert len(find_finished(out)) == 4
    killed: list[int] = []

    def kill_one(progress: Any) -> None:
        if progress.computed >= 40 and not killed:
            killed.append(next(iter(cluster.workers.values())).pid)
            os.kill(killed[0], signal.SIGKILL)

    found = sweep(SCENE, **OPTIONS, out=out, workers=Cluster(address, wait=60.0), on_progress=kill_one)
    assert killed
    assert len(find_finished(out)) == 20
    local = sweep(SCENE, **OPTIONS, out=tmp_path / "local.zarr", workers=2)
    assert set(found.data_vars) == set(local.data_vars)
    for name, array in local.data_vars.items():
        kind = array.dtype.kind
        assert np.array_equal(found[name].values, array.values, equal_nan=kind == "f"), name
    assert (local["status"] == 0).all()
