"""Samples that would not fit into memory are refused before anything is integrated."""

from types import SimpleNamespace
from typing import Any

import pytest

from tensegrity_codegen.runtime.simulate.motion_input import MAX_BYTES, check_sample_memory, read_sample_times
from tensegrity_codegen.system.errors import InvalidValueError


def manifest_of(nodes: int, members: int) -> Any:
    return SimpleNamespace(
        coordinate_name=("q",) * (3 * nodes), node_name=("n",) * nodes, member_name=("m",) * members
    )


def test_a_large_tower_may_have_hundreds_of_samples_and_not_ten_thousand() -> None:
    tower = manifest_of(33_336, 100_002)
    check_sample_memory(tower, 1001)
    with pytest.raises(InvalidValueError, match="would not fit into memory") as caught:
        check_sample_memory(tower, 10_001)
    most = int(str(caught.value).split("at most ")[1].split()[0])
    check_sample_memory(tower, most)
    with pytest.raises(InvalidValueError):
        check_sample_memory(tower, most + 1)


def test_a_prism_may_have_a_million() -> None:
    check_sample_memory(manifest_of(6, 12), 1_000_000)
    assert MAX_BYTES > 2**30


def test_a_time_whose_square_is_no_number_is_too_short() -> None:
    with pytest.raises(InvalidValueError, match="too short"):
        read_sample_times(2, 5e-324)
    assert read_sample_times(2, 1e-100).tolist() == [0.0, 1e-100]
