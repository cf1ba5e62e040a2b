from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse

from tensegrity_codegen.pipeline import load_scene
from tests.cli.conftest import Run
from tests.cli.scenes import HANGING, write
from tests.reference import ReferenceModel

INPUT = '\n[[inputs]]\nname = "u1"\nkind = "rest_length"\nmembers = ["s1"]\n'


def test_the_frequencies_of_a_hanging_mass(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", HANGING)
    data = run("linearize", path, "--settle", "--json").data
    pendulum = math.sqrt(9.81 / 0.9981) / (2 * math.pi)
    expected = [pendulum, pendulum, 10 / (2 * math.pi)]
    assert data["natural_frequency"] == pytest.approx(expected, rel=1e-6)
    assert data["damping_ratio"] == pytest.approx([0, 0, 0], abs=1e-9)
    assert (data["n_states"], data["n_inputs"]) == (6, 0)


def test_the_file_holds_the_matrices(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", HANGING + INPUT)
    data = run("linearize", path, "--out", "a.npz", "--json").data
    assert data["input_name"] == ["u1"]
    model = ReferenceModel(load_scene(path)[0], parameters={})
    with np.load("a.npz", allow_pickle=False) as file:
        for name, quantity in (("A", "state_jacobian"), ("B", "input_jacobian")):
            place = (file[f"{name}_row"], file[f"{name}_column"])
            found = sparse.coo_array((file[f"{name}_value"], place), shape=file[f"{name}_shape"])
            np.testing.assert_allclose(
                found.toarray(), model.compute(quantity).toarray(), rtol=1e-12, atol=1e-12
            )
        assert file["state_name"].tolist() == data["state_name"]
        assert file["input_name"].tolist() == ["u1"]


def test_a_result_without_a_place_is_refused(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", HANGING)
    ended = run("linearize", path, "--out", "missing/a.npz", "--json")
    assert ended.code == 2
    assert ended.data["where"] == "missing/a.npz"


def test_a_structure_that_nothing_holds_cannot_settle(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", HANGING.replace("anchored = true", "mass = 1.0"))
    ended = run("linearize", path, "--settle", "--json")
    assert ended.code == 3
    assert ended.data["status"] == "error"
    assert ended.data["evidence"]["status"] == "no_equilibrium"
