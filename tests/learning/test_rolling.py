"""The robot of examples/learn_to_roll.py learns to roll, and its policy in C walks the same way."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen import read_policy
from tests.models import ROOT


@pytest.mark.thorough
@pytest.mark.timeout(1800)
def test_the_policy_of_the_example_rolls_and_walks_in_c(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Twenty robots that it was not trained with come at least 1 m far in 10 s."""
    pytest.importorskip("gymnasium")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["learn_to_roll.py"])
    names = runpy.run_path(str(ROOT / "examples/learn_to_roll.py"))
    assert names["way"].shape == (20,)
    assert names["way"].min() >= 1.0
    assert np.array_equal(names["first"], names["second"])
    assert np.array_equal(read_policy("policy.npz").weights[0], names["policy"].weights[0])
