"""The simulated queue of a sweep against closed forms."""

import pytest

pytest.importorskip("zarr")

from sweep_scaling import Costs, compute_overhead, find_least_size, fit_line, simulate_queue


def test_without_overhead_all_workers_compute_all_the_time() -> None:
    costs = Costs(scheduler=0.0, write=0.0, write_per_case=0.0, fixed=0.0, per_case=1e-3)
    assert simulate_queue(costs, workers=7, size=10, tasks=70) == pytest.approx(10 * 0.01)
    assert compute_overhead(costs, 7, 10) == pytest.approx(0.0, abs=1e-12)


def test_one_worker_pays_for_each_part_of_a_task() -> None:
    costs = Costs(scheduler=1.0, write=0.0, write_per_case=0.0, fixed=2.0, per_case=0.5, latency=0.25)
    alone = simulate_queue(costs, workers=1, size=10, tasks=4, ahead=1)
    assert alone == pytest.approx(4 * (1 + 0.25 + 2 + 5))
    # with the next task at hand only the first order is waited for
    assert simulate_queue(costs, workers=1, size=10, tasks=4) == pytest.approx(1 + 0.25 + 4 * (2 + 5))


def test_many_workers_wait_for_the_scheduler() -> None:
    """With more workers than the scheduler can serve, tasks start one scheduler time apart."""
    costs = Costs(scheduler=1e-3, write=0.0, write_per_case=0.0, fixed=0.0, per_case=1e-4)
    assert simulate_queue(costs, workers=1000, size=100, tasks=5000) == pytest.approx(5000e-3 + 0.01)


def test_many_workers_wait_for_the_writing_of_results() -> None:
    costs = Costs(scheduler=0.0, write=5e-3, write_per_case=1e-5, fixed=0.0, per_case=1e-4)
    time = simulate_queue(costs, workers=1000, size=100, tasks=2000)
    assert time == pytest.approx(0.01 + 2000 * 6e-3)


def test_the_least_size_keeps_the_limit() -> None:
    costs = Costs(scheduler=1e-3, write=0.0, write_per_case=0.0, fixed=1e-3, per_case=1e-3)
    for workers in (1, 100):
        size = find_least_size(costs, workers)
        assert size is not None
        assert compute_overhead(costs, workers, size) < 0.05 <= compute_overhead(costs, workers, size // 2)
    # a task must last as long as the scheduler needs to serve all other workers: 1 s of 1,000 workers
    assert (find_least_size(costs, 1000) or 0) >= 1000


def test_scatter_keeps_the_mean() -> None:
    costs = Costs(scheduler=0.0, write=0.0, write_per_case=0.0, fixed=0.0, per_case=1e-3, spread=0.3)
    assert simulate_queue(costs, workers=1, size=10, tasks=20_000) == pytest.approx(200.0, rel=0.02)


def test_a_line_is_fitted_without_negative_parts() -> None:
    assert fit_line([1, 10, 100], [3.0, 12.0, 102.0]) == pytest.approx((2.0, 1.0))
    a, b = fit_line([1, 10, 100], [0.9, 9.5, 99.0])
    assert a == 0.0
    assert b == pytest.approx(0.95, rel=0.06)
