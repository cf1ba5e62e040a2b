"""Code blocks of the documents: each is run here or by a test that is named, or excluded for a reason.

Pages run one by one, each in an empty folder, block after block; `pytest -rP` prints how many and how long.
"""

import re
import shlex
import time
from collections import Counter
from pathlib import Path

import pytest

from tests.cli.blocks.find_blocks import (
    ROOT,
    Block,
    classify,
    find_blocks,
    is_code_without_language,
    list_pages,
)
from tests.cli.blocks.run_blocks import PageRun
from tests.cli.blocks.surroundings import ELSEWHERE, EXCLUDED
from tests.cli.conftest import Run

BLOCKS = {page: find_blocks(page) for page in list_pages()}
RUN = [page for page, blocks in BLOCKS.items() if any(classify(block) == "run" for block in blocks)]
LANGUAGES = {"sh", "python", "py", "c", "toml", "json", "text"}
NEEDS = {
    "docs/sweep.md": ("zarr", "xarray", "SALib", "distributed"),
    "docs/planning.md": ("daqp",),
    "docs/control.md": ("daqp",),
    "docs/timing.md": ("daqp",),
    "docs/gains.md": ("daqp",),
    "docs/mpc.md": ("daqp",),
    "docs/controllers_in_c.md": ("daqp",),
    "docs/export.md": ("ezdxf",),
    "docs/import.md": ("ezdxf",),
    "docs/learning.md": ("gymnasium",),
    "docs/build_a_robot.md": ("gymnasium",),
    "docs/coming_from/mujoco.md": ("mujoco",),
    "docs/control_and_optimise.md": ("daqp", "zarr", "xarray", "SALib"),
    "docs/gallery/late_prism.md": ("zarr", "xarray", "SALib"),
    "docs/gallery/prism12.md": ("daqp",),
    "docs/gallery/twisted_prism.md": ("daqp",),
    "docs/gallery/pinned_prism.md": ("daqp",),
}


def list_kind(kind: str) -> list[Block]:
    return [block for blocks in BLOCKS.values() for block in blocks if classify(block) == kind]


def test_every_block_that_is_run_has_a_language_that_can_be_run() -> None:
    counts = Counter(block.language for block in list_kind("run"))
    assert set(counts) <= LANGUAGES
    assert counts.total() > 100
    assert len(list_kind("run")) > 5 * len(list_kind("excluded"))
    print("blocks:", *(f"{kind} {len(list_kind(kind))}," for kind in ("run", "elsewhere", "excluded")))


def test_commands_and_programs_have_a_language() -> None:
    """Commands stand between ```sh and ```, Python between ```python and ```: then they are run."""
    blocks = [block for found in BLOCKS.values() for block in found]
    assert [f"{block.page}:{block.line}" for block in blocks if is_code_without_language(block)] == []


def test_exclusions_have_reasons_and_are_used() -> None:
    excluded = [(block.page, block.code) for block in list_kind("excluded")]
    for page, start, reason in EXCLUDED:
        assert len(reason.split()) > 2
        assert any(page == name and code.startswith(start) for name, code in excluded), (page, start)
        for path in re.findall(r"tests/[\w/.]+\w", reason):
            assert (ROOT / path).exists(), path
    for page, test in ELSEWHERE.items():
        assert any(name.startswith(page) for name in BLOCKS), page
        assert (ROOT / test).exists(), test


def test_commands_that_are_not_run_name_verbs_and_options(run: Run) -> None:
    for block in list_kind("excluded"):
        for command in block.commands if block.language == "sh" else []:
            program, *words = shlex.split(command)
            if program == "make" and words[0] != "-C":
                makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
                assert re.search(rf"^{words[0]}:", makefile, re.MULTILINE), command
            if program != "tensegrity-codegen":
                continue
            shown = run(words[0], "--help")
            assert shown.code == 0, command
            missing = [word for word in words if word.startswith("-") and word not in shown.out]
            assert missing == [], command


@pytest.mark.thorough
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("page", RUN)
def test_every_block_of_a_page_runs(page: str, folder: Path, run: Run) -> None:
    for package in NEEDS.get(page, ()):
        pytest.importorskip(package)
    began = time.monotonic()
    done = PageRun(page, folder, run)
    done.all_blocks()
    print(f"{page}: {done.count} blocks in {time.monotonic() - began:.1f} s")
    check_results(page, done.names, folder)


def check_results(page: str, names: dict[str, object], folder: Path) -> None:
    """Check what the programs of a page found."""
    if page == "docs/start.md":
        assert names["rest"].status == "converged"  # type: ignore[attr-defined]
        assert names["motion"].status == "ok"  # type: ignore[attr-defined]
        assert "<canvas" in (folder / "mast.html").read_text(encoding="utf-8")
    if page == "docs/controllers_in_c.md":
        assert (folder / "ctl_tensions" / "pinned_prism_control_daqp.h").exists()
    if page == "docs/guides/stiff_bars.md":
        runs = names["runs"]
        assert [run.status for run in runs.values()] == ["ok", "ok"]  # type: ignore[attr-defined]
        assert "radau" in runs[1e7].method  # type: ignore[index]
    if page == "docs/guides/optimal_control.md":
        assert names["found"].stats()["return_status"] == "Solve_Succeeded"  # type: ignore[attr-defined]
        assert all(2 < angle < 4 for angle in names["turned"][::2])  # type: ignore[index]
