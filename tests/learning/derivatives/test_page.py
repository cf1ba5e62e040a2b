"""Blocks of the page of learning that need JAX or PyTorch."""

import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.codegen.quickly import without_optimisation
from tests.models import EXAMPLES, ROOT

GRADIENTS: dict[str, Any] = {}


@pytest.mark.peers
@pytest.mark.parametrize("package", ["jax", "torch"])
def test_blocks_run_and_give_the_same_gradient(
    package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip(package, reason=f"needs the package {package}")
    for scene in ("pinned_prism", "prism"):
        shutil.copy(EXAMPLES / f"{scene}.toml", tmp_path)
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs" / "learning.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    (block,) = [block for block in blocks if f"import {package}\n" in block]
    names: dict[str, Any] = {}
    with without_optimisation():
        exec(block, names)
    if package == "jax":
        names["jax"].config.update("jax_enable_x64", False)
    gradient = np.asarray(names["gradient"])
    assert gradient.shape == (3,)
    assert (gradient > 0.0).all()  # longer cables, higher nodes
    np.testing.assert_allclose(gradient, GRADIENTS.setdefault("of the first", gradient), rtol=1e-9)
