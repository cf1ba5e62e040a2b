import math
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tests.cli.conftest import Run
from tests.cli.scenes import FRAME, HANGING, write
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
    ended = run.refused("linearize", path, "--out", "missing/a.npz", "--json")
    assert ended.data["where"] == "missing/a.npz"


def test_a_structure_that_nothing_holds_cannot_settle(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", HANGING.replace("anchored = true", "mass = 1.0"))
    ended = run("linearize", path, "--settle", "--json")
    assert ended.code == 3
    assert ended.data["status"] == "error"
    assert ended.data["evidence"]["status"] == "no_equilibrium"


def test_text_has_a_table_of_frequencies_and_damping_ratios(run: Run, folder: Path) -> None:
    damped = HANGING.replace("rest_length = 0.9", "rest_length = 0.9\ndamping = 2.0")
    path = write(folder / "small.toml", damped)
    text = run("linearize", path, "--settle").out
    assert "damping ratio" in text
    ratio = 2.0 / (2 * math.sqrt(100.0 * 1.0))  # c / 2 sqrt(k m)
    (row,) = (line.split() for line in text.splitlines() if line.split()[:1] == ["3"])
    assert [float(cell) for cell in row[1:]] == pytest.approx([10 / (2 * math.pi), ratio], rel=1e-3)


def test_about_an_equilibrium_the_rate_is_zero_however_far_out(run: Run, folder: Path) -> None:
    far = HANGING.replace("[0, 0, 0]", "[1e4, 0, 0]").replace("[0, 0, -1]", "[1e4, 0, -1]")
    path = write(folder / "small.toml", far + INPUT)
    ended = run("linearize", path, "--settle", "--out", "a.npz", "--json")
    assert ended.data["largest_affine_term"] > 1e4  # x' = A x + B u + c
    assert ended.data["largest_residual_rate"] < 1e-6
    with np.load("a.npz", allow_pickle=False) as file:
        a, b = (
            sparse.coo_array(
                (file[f"{name}_value"], (file[f"{name}_row"], file[f"{name}_column"])),
                shape=file[f"{name}_shape"],
            ).toarray()
            for name in "AB"
        )
        rate = a @ file["state"] + b @ file["input"] + file["c"]
        np.testing.assert_allclose(rate, file["residual_rate"], atol=1e-9 * np.abs(file["c"]).max())
        assert np.abs(file["residual_rate"]).max() == ended.data["largest_residual_rate"]
    assert "largest entry of r" in run("linearize", path, "--settle").out


@pytest.mark.parametrize(("shift", "count"), [(0.0, 1), (1e-15, 1), (1e-9, 0), (-1e-9, 0)])
def test_a_cable_at_its_rest_length_is_named(run: Run, folder: Path, shift: float, count: int) -> None:
    scene = HANGING.replace("rest_length = 0.9", f"rest_length = {1.0 - shift!r}")
    ended = run("linearize", write(folder / "small.toml", scene), "--json")
    assert ended.data["one_sided_cables"] == ["s1"][:count]
    assert ("s1" in ended.err) is bool(count)
    assert ended.code == 0


def test_a_state_that_moves_or_is_out_of_balance_is_a_warning(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", HANGING.replace("mass = 1.0", "mass = 1.0, velocity = [0, 0, 0.2]"))
    warnings = run("linearize", path, "--json").data["warnings"]
    assert any("largest velocity 0.2" in text for text in warnings)
    # 1 kg on 100 N/m, stretched by 0.1 m only.
    assert any("out of balance at x0 (largest acceleration 0.19)" in text for text in warnings)
    settled = run("linearize", path, "--settle", "--json").data
    assert not any("at x0" in text for text in settled.get("warnings", ()))


def test_a_scene_that_equilibrium_writes_is_at_rest_and_in_balance(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", HANGING.replace("mass = 1.0", "mass = 1.0, velocity = [0, 0, 0.2]"))
    run.good("equilibrium", path, "--out", "settled.toml")
    structure, _ = load_scene(folder / "settled.toml")
    assert not structure.node_velocity.any()
    assert run("linearize", "settled.toml", "--json").data.get("warnings", []) == []


def test_on_the_ground_it_settles_with_its_bristles(run: Run, folder: Path) -> None:
    """A frame pushed sideways within friction: at rest, its feet springs and dampers."""
    path = write(folder / "frame.toml", FRAME.replace("[0, -9.81]", "[1, -9.81]"))
    data = run.good("linearize", path, "--settle", "--json").data
    assert data["largest_residual_rate"] < 1e-9
    assert data["state_name"][-3:] == ["left_stick1", "right_stick1", "top_stick1"]
    assert data["growing_eigenvalues"] == 0
    assert run("linearize", path, "--json").data["largest_residual_rate"] > 1.0


def test_feet_at_the_limit_of_friction_are_named(run: Run, folder: Path) -> None:
    path = write(folder / "frame.toml", FRAME.replace("friction = 0.5", "friction = 0.05"))
    warnings = run.good("linearize", path, "--settle", "--json").data["warnings"]
    assert any("feet at the limit of friction: left, right;" in text for text in warnings)
