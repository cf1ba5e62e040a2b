"""The progress of a motion that is integrated several times, and of a search for an equilibrium."""

import itertools
from collections.abc import Callable

import pytest

from tensegrity_codegen.runtime.accuracy.integrate import join_runs
from tensegrity_codegen.runtime.statics.newton import follow_residual
from tensegrity_codegen.system.progress import watched_passes, work_pass


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


class Watcher:
    """What is shown: the title of what runs."""

    title = "working"

    def begin(self, title: str) -> Callable[[float], None]:
        self.title = title
        return lambda fraction: None

    def end(self) -> None:
        self.title = "ended"


def test_a_search_says_its_iteration_and_residual_where_no_part_is_known_to_be_done() -> None:
    told: list[tuple[int, float]] = []
    progress = follow_residual(lambda iteration, residual: told.append((iteration, residual)))
    watcher = Watcher()
    with watched_passes(watcher), work_pass("outer"):
        with work_pass("finding the equilibrium"):
            progress(4120, 2e-5)
            assert watcher.title == "finding the equilibrium: iteration 4,120, residual 2e-05 N"
        assert watcher.title == "outer"
    progress(4121, float("nan"))
    assert [row[0] for row in told] == [4120, 4121]
