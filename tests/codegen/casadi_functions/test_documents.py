"""The example of docs/casadi_functions.md: it runs as it stands, and finds what it says."""

import re
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from tensegrity_codegen import build_library, load_scene
from tests.codegen.quickly import without_optimisation

ROOT = Path(__file__).resolve().parents[3]


def test_the_example_of_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (ROOT / "docs/casadi_functions.md").read_text(encoding="utf-8")
    (block,) = [text for text in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "nlpsol" in text]
    prism = (ROOT / "tensegrity_codegen/scene/examples/prism.toml").read_text(encoding="utf-8")
    (tmp_path / "held.toml").write_text(re.sub('anchor_bottom = "z"', "anchor_bottom = true", prism))
    monkeypatch.chdir(tmp_path)
    names = {"ca": ca, "np": np, "replace": replace, "build_library": build_library, "load_scene": load_scene}
    quiet = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
    with without_optimisation():
        exec(block.replace('"g": g})', f'"g": g}}, {quiet!r})'), names)
    assert names["solver"].stats()["return_status"] == "Solve_Succeeded"  # type: ignore[attr-defined]
    found = np.array(names["found"]["x"]).ravel()  # type: ignore[index]
    n = len(names["q0"])  # type: ignore[arg-type]
    tension = np.array(names["tension"](found[:n], found[n:])).ravel()  # type: ignore[operator]
    assert tension[3:].min() >= 1.0 - 1e-6
    rise = found[names["height"]] - names["q0"][names["height"]]  # type: ignore[index]
    assert rise == pytest.approx(0.01, abs=1e-7)
