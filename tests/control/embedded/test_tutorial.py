"""The tutorial of docs/control.md: its Python writes a controller, its C drives it."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.control.embedded.build_controller import ControllerBundle
from tensegrity_codegen.control.embedded.loaded import load_controller
from tensegrity_codegen.control.embedded.parts import CONTROL_STATUS
from tests.codegen.build_c import STRICT, run
from tests.codegen.compilers import require_compiler

ROOT = Path(__file__).resolve().parents[3]
EXAMPLES = ROOT / "tensegrity_codegen" / "scene" / "examples"


def read_section() -> str:
    text = (ROOT / "docs" / "control.md").read_text(encoding="utf-8")
    return text.split("## A controller in C\n")[1].split("\n## ")[0]


def read_block(language: str) -> str:
    return read_section().split(f"```{language}\n")[1].split("```")[0]


def compile_robot(folder: Path) -> Path:
    """Compile the program of the tutorial by its command, in the folder that has `ctl`."""
    (folder / "robot.c").write_text(read_block("c"), encoding="utf-8")
    (command,) = re.findall(r"^cc (.*)$", read_section(), re.MULTILINE)
    run([*require_compiler("gcc").command, *STRICT, *command.split()], folder)
    return folder / "robot"


def drive(robot: Path, rows: np.ndarray) -> tuple[np.ndarray, str]:
    """Return the rest lengths that the program writes for measurements, and its messages."""
    text = "\n".join(" ".join(map(repr, row)) for row in rows.tolist())
    done = subprocess.run([str(robot)], input=text, capture_output=True, text=True, check=True)
    return np.array([line.split() for line in done.stdout.splitlines()], dtype=float), done.stderr


def test_the_program_writes_what_the_controller_says(bundle: ControllerBundle, tmp_path: Path) -> None:
    shutil.copytree(bundle.folder, tmp_path / "ctl")
    rows = 0.3 + 0.001 * np.random.default_rng(0).normal(size=(20, 9))
    rows[7, 3] = 0.0
    written, messages = drive(compile_robot(tmp_path), rows)
    controller = bundle.load()
    controller.init()
    expected = [controller.step(0.005 * k, row) for k, row in enumerate(rows)]
    np.testing.assert_allclose(written, [rest for _, rest in expected], rtol=0, atol=1e-6)
    assert "0.035 s: a measured length is not above 0" in messages


@pytest.mark.thorough
def test_from_the_scene_to_the_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy(EXAMPLES / "pinned_prism.toml", tmp_path)
    monkeypatch.chdir(tmp_path)
    exec(compile(read_block("python"), "docs/control.md", "exec"), {})
    controller = load_controller("ctl")
    controller.init()
    rows = np.full((5, 9), 0.3)
    expected = [controller.step(0.005 * k, row)[1] for k, row in enumerate(rows)]
    np.testing.assert_allclose(drive(compile_robot(tmp_path), rows)[0], expected, rtol=0, atol=1e-6)


def test_the_page_lists_every_status_with_its_number() -> None:
    rows = re.findall(r"^\| (\d+) \| `(\w+)` \|", read_section(), re.MULTILINE)
    assert rows == [(str(k), word.upper()) for k, word in enumerate(CONTROL_STATUS)]


def test_the_header_numbers_the_statuses_alike(bundle: ControllerBundle) -> None:
    text = (bundle.folder / "pinned_prism_control.h").read_text(encoding="utf-8")
    for number, word in enumerate(CONTROL_STATUS):
        assert f"  PINNED_PRISM_CONTROL_{word.upper()} = {number}" in text
    assert [bundle.load().status_text(k) for k in range(3)] == list(CONTROL_STATUS.values())[:3]
