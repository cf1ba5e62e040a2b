"""Tasks cut the cases into consecutive ranges, and chunks of a regular grid hold one task each."""

import itertools

import numpy as np
import pytest

from tensegrity_codegen.sweeps.cases.layout import CaseLayout

SHAPES = [(1,), (7,), (1000,), (3, 10, 4), (2, 1, 13), (101, 101), (5, 300), (300, 5), (2, 3, 4, 5)]


@pytest.mark.parametrize(("shape", "size"), list(itertools.product(SHAPES, [1, 2, 8, 20, 64, 10**6])))
def test_each_box_holds_the_cases_of_its_task_and_every_case_is_in_one(
    shape: tuple[int, ...], size: int
) -> None:
    layout = CaseLayout.of(shape, size)
    number = np.arange(layout.count).reshape(shape)
    after = 0
    for task in range(layout.n_tasks):
        first, last = layout.cases_of(task)
        assert first == after
        assert 0 < last - first <= max(size, 1)
        assert number[layout.box_of(task)].ravel().tolist() == list(range(first, last))
        for part, place, c in zip(layout.box_of(task), layout.place_of(task), layout.chunk, strict=True):
            assert part.start == place * c
            assert part.stop - part.start <= c
        after = last
    assert after == layout.count
    assert CaseLayout.of(shape, layout.task_size) == layout  # a resumed sweep has the tasks of the first


def test_tasks_are_of_about_equal_size_and_of_whole_lanes() -> None:
    layout = CaseLayout.of((1_000_000,), 8192)
    sizes = [last - first for first, last in map(layout.cases_of, range(layout.n_tasks))]
    assert max(sizes) - min(sizes) < 8 * layout.n_tasks
    assert layout.chunk[0] % 8 == 0


def test_a_task_that_does_not_exist_is_an_index_error() -> None:
    with pytest.raises(IndexError):
        CaseLayout.of((10,), 5).place_of(2)
