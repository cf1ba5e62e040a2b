"""The robot of docs/learning.md learns to roll, and its policy in C walks the same way."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import environment, read_policy
from tests.models import ROOT


@pytest.mark.thorough
def test_the_policy_of_the_page_rolls_and_walks_in_c(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Twenty robots that it was not trained with come at least 1 m far in 10 s."""
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs" / "learning.md").read_text(encoding="utf-8")
    section = text.partition("## 7. ")[2].partition("## 9. ")[0]
    names: dict[str, Any] = {"np": np, "environment": environment}
    for block in re.findall(r"```python\n(.*?)```", section, re.DOTALL):
        exec(compile(block, "docs/learning.md", "exec"), names)
    assert names["way"].shape == (20,)
    assert names["way"].min() >= 1.0
    assert np.array_equal(names["first"], names["second"])
    assert np.array_equal(read_policy("policy.npz").weights[0], names["policy"].weights[0])
