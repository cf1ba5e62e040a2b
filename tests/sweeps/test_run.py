"""A sweep that is stopped, killed or refused: every case is stored once, and goes on where it stopped."""

import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.sweeps.engines.engine import LocalEngine
from tensegrity_codegen.sweeps.run import SweepOutcome, SweepProgress, run_sweep
from tensegrity_codegen.sweeps.store.folder import find_finished, open_sweep
from tensegrity_codegen.system.errors import InvalidValueError, OutputError
from tensegrity_codegen.system.forked import can_fork
from tests.cases import thorough
from tests.sweeps.engines.conftest import NoLibraries, Square, make_work

pytest.importorskip("zarr", reason="Zarr is missing: pip install '.[sweep]'")
pytest.importorskip("xarray", reason="xarray is missing: pip install '.[sweep]'")
pytestmark = pytest.mark.skipif(not can_fork(), reason="these tests need a system that forks processes")

IDENTITY = {"scene": {"name": "two_nodes"}}


def run(out: Path, operation: Square | None = None, **options: Any) -> SweepOutcome:
    work = make_work(operation or Square(), wrong=options.pop("wrong", -1.0))
    identity = options.pop("identity", IDENTITY)
    engine = LocalEngine(2, NoLibraries())  # type: ignore[arg-type]
    return run_sweep(work, out, engine, identity=identity, facts={"title": "squares"}, **options)


def test_a_sweep_is_stored_and_counted(tmp_path: Path) -> None:
    seen: list[SweepProgress] = []
    outcome = run(tmp_path / "a.zarr", wrong=7.0, on_progress=seen.append)
    assert outcome.counts == {"bad_input": 1, "ok": 39}
    assert outcome.first_message == {"bad_input": "a wrong value"}
    assert (outcome.good, outcome.failed, outcome.computed, outcome.stopped) == (39, 1, 40, False)
    assert [item.finished for item in seen][:: len(seen) - 1] == [0, 40]
    assert seen[-1].fraction == 1.0
    found = open_sweep(tmp_path / "a.zarr")
    expected = np.where(np.arange(40) == 7, np.nan, np.arange(40.0) ** 2)
    assert np.array_equal(found["square"].values, expected, equal_nan=True)
    assert found.attrs["title"] == "squares"
    assert [item.name for item in tmp_path.iterdir()] == ["a.zarr"]


def test_a_finished_sweep_computes_nothing_again_and_another_one_is_refused(tmp_path: Path) -> None:
    run(tmp_path / "a.zarr", wrong=7.0)
    again = run(tmp_path / "a.zarr", wrong=7.0)
    assert (again.computed, again.counts) == (0, {"bad_input": 1, "ok": 39})
    with pytest.raises(OutputError, match=r"scene\.name"):
        run(tmp_path / "a.zarr", identity={"scene": {"name": "prism"}})


def test_it_stops_after_failures_and_goes_on_later(tmp_path: Path) -> None:
    first = run(tmp_path / "a.zarr", wrong=3.0, stop_after=1)
    assert first.stopped
    assert 0 < first.finished < 40
    second = run(tmp_path / "a.zarr", wrong=3.0)
    assert first.computed + second.computed == 40
    assert second.counts == {"bad_input": 1, "ok": 39}
    with pytest.raises(InvalidValueError):
        run(tmp_path / "a.zarr", stop_after=0)


def test_an_error_keeps_what_is_finished_and_leaves_no_lock(tmp_path: Path) -> None:
    (tmp_path / "marks").mkdir()
    broken = Square(folder=str(tmp_path / "marks"), deadly=39.0, lives=9, way="library")
    with pytest.raises(Exception, match="no such library"):
        run(tmp_path / "a.zarr", broken)
    done = len(find_finished(tmp_path / "a.zarr"))
    assert done < 5
    assert run(tmp_path / "a.zarr").computed == 40 - 8 * done
    assert sorted(item.name for item in tmp_path.iterdir()) == ["a.zarr", "marks"]


CLIENT = """
import signal, sys, time
from pathlib import Path
signal.signal(signal.SIGINT, signal.default_int_handler)  # jobs in the background ignore it
from tests.sweeps.engines.conftest import Square
from tests.sweeps.test_run import run
run(Path(sys.argv[1]), on_progress=lambda progress: time.sleep(3600 if progress.computed >= 16 else 0))
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, *thorough(signal.SIGINT)])
def test_a_client_that_is_ended_goes_on_where_it_stopped(tmp_path: Path, number: signal.Signals) -> None:
    out = tmp_path / "a.zarr"
    client = subprocess.Popen([sys.executable, "-c", CLIENT, str(out)], stderr=subprocess.PIPE)
    deadline = time.monotonic() + 120.0
    while len(find_finished(out)) < 2 and time.monotonic() < deadline and client.poll() is None:
        time.sleep(0.02)
    client.send_signal(number)
    client.communicate(timeout=120.0)
    done = find_finished(out)
    assert len(done) == 2
    assert (open_sweep(out)["status"].values == 0).sum() == 16
    run(tmp_path / "b.zarr")
    assert run(out).computed == 24
    first, second = open_sweep(out), open_sweep(tmp_path / "b.zarr")
    assert np.array_equal(first["square"].values, second["square"].values)
    assert find_finished(out) == set(range(5))
    assert not list(tmp_path.rglob("*.partial"))
