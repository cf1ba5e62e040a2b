"""The robot of examples/learn_to_roll.py learns to roll, and its policy in C walks the same way."""

import ast
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


def test_an_interrupted_training_returns_the_policy_so_far(capsys: pytest.CaptureFixture[str]) -> None:
    """Of 8 generations the sixth is interrupted: the mean is that of five."""
    tree = ast.parse((ROOT / "examples/learn_to_roll.py").read_text(encoding="utf-8"))
    functions = [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == "train"]

    def train(last: int, most: int) -> np.ndarray:
        def walk(numbers: np.ndarray, seed: int) -> np.ndarray:
            if seed == last:
                raise KeyboardInterrupt
            return np.asarray(numbers.sum(axis=1))

        names = {"np": np, "n_moved": 2, "n_seen": 3, "walk": walk}
        exec(compile(ast.Module(functions, []), "train", "exec"), names)
        return np.asarray(names["train"](1e9, most=most))  # type: ignore[operator]

    np.testing.assert_array_equal(train(5, most=8), train(-1, most=5))
    assert "generation 5: " in capsys.readouterr().out
