"""Stored sweeps read for their summary: grids, samples and both, finished or not."""

from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.analyses.cases.statuses import NOT_COMPUTED, STATUSES
from tensegrity_codegen.sweeps.cases.cases import Cases
from tensegrity_codegen.sweeps.summary.results import SweepResults, read_results
from tensegrity_codegen.sweeps.summary.summary import summarize
from tensegrity_codegen.system.errors import OutputError
from tests.sweeps.store.conftest import CASES_OF_KINDS, KINDS, OUTPUTS, make_contents, make_result

pytest.importorskip("zarr")


def write_sweep(path: Path, cases: Cases, *, missing: int = 0) -> SweepResults:
    """Write a sweep of made-up results without its last tasks, and read it."""
    from tensegrity_codegen.sweeps.store.store import SweepStore, create_store

    operation = {"do": "simulate", "keep": ["energy"], "t_end": 0.5}
    create_store(path, make_contents(cases, 4, operation=operation))
    store = SweepStore(path)
    for task in range(store.layout.n_tasks - missing):
        store.write(task, make_result(*store.layout.cases_of(task)), {})
    return read_results(path)


@pytest.mark.parametrize("kind", CASES_OF_KINDS)
def test_cases_and_results_are_those_that_were_written(kind: str, tmp_path: Path) -> None:
    cases = KINDS[kind]
    found = write_sweep(tmp_path / "a.zarr", cases)
    whole = make_result(0, cases.count)
    assert (found.scene, found.operation, dict(found.options)) == ("prism", "simulate", {"t_end": 0.5})
    assert (found.keys, found.method, found.count) == (cases.keys, cases.method, cases.count)
    assert [key for key, _ in found.axes] == [axis.key for axis in cases.axes]
    np.testing.assert_array_equal(found.key_values, cases.values())
    assert found.status.tolist() == whole.status.tolist()
    assert [found.message(case) for case in range(found.count)] == list(whole.messages)
    assert set(found.kept) == {output.name for output in OUTPUTS}
    for output in OUTPUTS:
        quantity = found.kept[output.name]
        assert (quantity.dims, quantity.shape, quantity.unit) == (output.dims, output.shape, output.unit)
        assert quantity.sentence == output.sentence
        values = np.concatenate([block for _, block in quantity.blocks()])
        np.testing.assert_array_equal(values, whole.arrays[output.name])
    assert list(found.kept["tension"].labels[0]) == ["b1", "c1", "c2"]


def test_a_sweep_that_is_not_finished_has_a_summary(tmp_path: Path) -> None:
    found = write_sweep(tmp_path / "a.zarr", KINDS["sample"], missing=2)
    left = int((~found.is_computed).sum())
    assert 4 < left <= 8
    assert found.words[found.status[-1]] == NOT_COMPUTED
    assert set(found.words) == {*STATUSES, NOT_COMPUTED}
    summary = summarize(found, ["tension[c1]"])
    assert summary.headline.endswith(f"{left} not computed yet")
    assert summary.chosen[0].distribution.count == int(found.is_good.sum())


def test_another_folder_is_no_sweep(tmp_path: Path) -> None:
    for name in (".", "none.zarr"):
        with pytest.raises(OutputError, match=r"no such folder|not a sweep"):
            read_results(tmp_path / name)
