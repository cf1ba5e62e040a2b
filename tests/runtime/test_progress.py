"""The progress of a motion that is integrated several times, and of a search for an equilibrium."""

from __future__ import annotations

import itertools

import pytest

from tensegrity_codegen.runtime.accuracy.joined_runs import join_runs
from tensegrity_codegen.runtime.statics.methods import follow_residual


@pytest.mark.parametrize("n_runs", [1, 2, 3, 8])
def test_it_moves_on_in_every_run_and_never_goes_back(n_runs: int) -> None:
    seen: list[float] = []
    run = join_runs(seen.append)
    assert run is not None
    for fraction in itertools.chain.from_iterable([(0.2, 0.5, 1.0)] * n_runs):
        run(fraction)
    assert len(seen) == 3 * n_runs
    assert all(after > before for before, after in itertools.pairwise(seen))
    assert 0.0 < seen[-1] < 1.0


def test_runs_that_end_early_count_too() -> None:
    seen: list[float] = []
    run = join_runs(seen.append)
    assert run is not None
    for fraction in (0.4, 0.1, 0.3, 0.0, 0.0):
        run(fraction)
    assert seen == sorted(seen)


def test_without_progress_nothing_is_called() -> None:
    assert join_runs(None) is None


def test_a_search_is_as_far_as_its_residual_has_fallen() -> None:
    seen: list[float] = []
    told: list[tuple[int, float]] = []
    progress = follow_residual(
        seen.append, 1e-8, lambda iteration, residual: told.append((iteration, residual))
    )
    for iteration, residual in enumerate((100.0, 1.0, 1000.0, 1e-6, 0.0, float("nan"))):
        progress(iteration, residual)
    assert seen == pytest.approx([0.0, 0.25, 0.0, 1.0])  # decades of eight; zero and NaN say nothing
    assert len(told) == 6
