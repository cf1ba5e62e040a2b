"""Verbs that end in pictures ask for what draws them before they begin to work."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

# Runs the command line as if a package were not installed.
BLOCKED = (
    "import sys; sys.modules[sys.argv[1]] = None; "
    "from tensegrity_codegen.cli.app import main; main(sys.argv[2:])"
)


def run_without(package: str, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", BLOCKED, package, *words],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("package", "words"),
    [
        ("matplotlib", ("reproduce", "all", "--out", "made")),
        ("matplotlib", ("report", "two_nodes.toml", "--t-end", "1000", "--out", "made")),
        ("matplotlib", ("show", "two_nodes.toml", "--out", "made.png")),
        ("PIL", ("show", "two_nodes.toml", "--trajectory", "motion.npz", "--out", "made.gif")),
    ],
)
def test_a_missing_package_is_named_before_the_work(
    package: str, words: tuple[str, ...], folder: Path, two_nodes: Path
) -> None:
    before = sorted(folder.iterdir())
    done = run_without(package, *words, "--json")
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    data = json.loads(done.stdout)
    assert data["error"] == "MissingExtraError"
    assert ("pillow" if package == "PIL" else package) in data["problem"]
    assert data["hint"].startswith("pip install '.[plot]'")
    assert sorted(folder.iterdir()) == before


@pytest.mark.thorough
def test_tables_alone_need_no_pictures(two_nodes: Path) -> None:
    words = ("stability", "two_nodes.toml", "--no-peers", "--budget", "0.001", "--json")
    done = run_without("matplotlib", *words)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["counts"]["not run"] > 0


@pytest.mark.thorough
def test_without_mujoco_its_rows_say_so(two_nodes: Path) -> None:
    program = f"""
import json, sys
sys.modules["mujoco"] = None
from pathlib import Path
from tensegrity_codegen.pipeline.compile_scene import load_nodes
from tensegrity_codegen.studies.stability.cases import generate_cases
from tensegrity_codegen.studies.stability.judge import judge_peer
from tensegrity_codegen.studies.stability.methods import run_peer
case = next(iter(generate_cases(load_nodes(Path({str(two_nodes)!r})), 0.1)))
ending = run_peer(case, "MuJoCo RK4", 30.0)
print(json.dumps([judge_peer(case, ending, None).verdict, ending.message]))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == ["not able", "not installed: mujoco"]


@pytest.mark.thorough
def test_plans_name_the_solver_that_they_need(folder: Path, two_nodes: Path) -> None:
    done = run_without("daqp", "plan", "two_nodes.toml", "--to", "n2.z=1", "--out", "a.csv", "--json")
    assert done.returncode == 2, done.stderr
    data = json.loads(done.stdout)
    assert data["error"] == "MissingExtraError"
    assert "'daqp'" in data["problem"]
    assert data["hint"].startswith("pip install '.[control]'")
    assert not (folder / "a.csv").exists()
