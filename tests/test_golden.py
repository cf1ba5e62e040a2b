"""What is generated for the shipped scenes, kept in `generated/`: header and manifest, C for the smallest.

`pytest tests/test_golden.py --update-golden` (or `make golden`) rewrites the files. Words must be the same;
numbers may differ in the last digits, since sines and square roots may on another machine.
"""

import re
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.pipeline.compile_scene import load_scene

pytestmark = pytest.mark.optimised

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = sorted((ROOT / "tensegrity_codegen/scene/examples").glob("*.toml"))
SMALLEST = "two_nodes"
NUMBER = re.compile(r"(?<![\w.])-?\d+\.\d*(?:e[+-]?\d+)?|(?<![\w.])-?\d+e[+-]?\d+")
HASH = re.compile(r"[0-9a-f]{64}|[\"']?casadi[\"']?:? ?\"?3\.8\.\d+\"?")


def generate(scene: Path) -> dict[str, str]:
    """Return the files of a scene that are kept, name -> text."""
    files = emit(*load_scene(scene)).files
    whole = scene.stem == SMALLEST
    kept = [name for name in files if whole or name.endswith(".h") or name == "manifest.json"]
    return {name: files[name] for name in kept}


def words(text: str) -> list[str]:
    return NUMBER.sub("#", HASH.sub("@", text)).split()


def numbers(text: str) -> np.ndarray:
    return np.array([float(found) for found in NUMBER.findall(HASH.sub("@", text))])


LARGE = ("icosahedron", "svd_tower", "tower")


@pytest.mark.parametrize(
    "scene",
    [
        pytest.param(path, marks=[pytest.mark.thorough] * (path.stem in LARGE), id=path.stem)
        for path in EXAMPLES
    ],
)
def test_generated_files_are_the_kept_ones(scene: Path, update_golden: bool) -> None:
    folder = ROOT / "generated" / scene.stem
    files = generate(scene)
    if update_golden:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            (folder / name).write_text(text, encoding="utf-8", newline="\n")
    assert sorted(path.name for path in folder.iterdir()) == sorted(files)
    for name, text in files.items():
        kept = (folder / name).read_text(encoding="utf-8")
        assert words(text) == words(kept), f"{name}: run `make golden` if the change is wanted"
        np.testing.assert_allclose(numbers(text), numbers(kept), rtol=1e-11, atol=1e-15)


def test_a_kept_file_that_differs_is_noticed() -> None:
    kept = "const double a[2] = {1.5, 2.0}; /* scene */"
    assert words(kept) != words(kept.replace("scene", "scenes"))
    assert words(kept) == words(kept.replace("1.5", "1.50000000000001"))
    assert not np.allclose(numbers(kept), numbers(kept.replace("1.5", "1.6")))
