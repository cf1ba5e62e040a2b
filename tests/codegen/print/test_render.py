"""Lists of numbers in generated text."""

import numpy as np
import pytest

from tensegrity_codegen.codegen.print.render import wrap_values


@pytest.mark.parametrize("values", [[], [7], list(range(1000)), [0.1, -1e-300, 1e300] * 40, ["x" * 200, "y"]])
def test_a_list_keeps_its_values_in_short_lines(values: list[object]) -> None:
    text = wrap_values(values)
    assert [word for word in text.replace("\n", "").replace(" ", "").split(",") if word] == list(
        map(str, values)
    )
    assert all(len(line) <= 110 or len(line.split()) == 1 for line in text.splitlines())


def test_all_lines_but_the_last_hold_equally_many() -> None:
    counts = [line.count(",") for line in wrap_values(range(10_000)).splitlines()]
    assert len(set(counts[:-1])) == 1
    assert counts[-1] < counts[0]


def test_arrays_are_taken_too() -> None:
    assert wrap_values(np.array([3, 1, 2], dtype=np.int32)) == "3, 1, 2"
    assert wrap_values(str(k) for k in range(3)) == "0, 1, 2"
