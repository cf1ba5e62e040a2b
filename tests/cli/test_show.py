from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Run
from tests.report.live.pages import require_three

pytest.importorskip("matplotlib")
SIGNATURES = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF", ".gif": b"GIF8"}


@pytest.fixture
def motion(run: Run, two_nodes: Path) -> Path:
    run("simulate", two_nodes, "--t-end", 0.2, "--samples", 4, "--out", "motion.npz")
    return Path("motion.npz")


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_a_structure_becomes_a_picture(suffix: str, run: Run, two_nodes: Path) -> None:
    ended = run("show", two_nodes, "--out", f"a{suffix}", "--labels", "--json")
    assert ended.code == 0
    assert ended.facts == {"status": "ok", "out": f"a{suffix}"}
    assert Path(f"a{suffix}").read_bytes().startswith(SIGNATURES[suffix])


@pytest.mark.parametrize("suffix", [".png", ".gif"])
def test_a_motion_becomes_a_picture_or_a_film(suffix: str, run: Run, two_nodes: Path, motion: Path) -> None:
    ended = run("show", two_nodes, "--trajectory", motion, "--out", f"a{suffix}", "--json")
    assert ended.code == 0
    assert Path(f"a{suffix}").read_bytes().startswith(SIGNATURES[suffix])


@pytest.mark.parametrize("modes", [0, 2])
def test_a_motion_becomes_a_live_page(modes: int, run: Run, two_nodes: Path, motion: Path) -> None:
    require_three()
    ended = run("show", two_nodes, "--trajectory", motion, "--out", "a.html", "--modes", modes, "--json")
    assert ended.code == 0
    assert ended.facts["n_frames"] == 4
    assert ended.facts["n_modes"] == min(modes, 1)
    assert ended.facts["bytes"] == Path("a.html").stat().st_size
    assert run("show", two_nodes, "--out", "a.html", "--modes", 0, "--json").code == 0  # its own file
    Path("a.html").write_text("<html>mine</html>", encoding="utf-8")
    assert run("show", two_nodes, "--out", "a.html", "--modes", 0, "--json").code == 2


def test_another_file_than_three_js_is_refused(run: Run, folder: Path, two_nodes: Path) -> None:
    Path("three.whl").write_bytes(b"something else")
    for path in ("three.whl", "missing.whl"):
        ended = run("show", two_nodes, "--out", "a.html", "--three", path, "--json")
        assert ended.code == 2
        assert ended.data["error"] == "MissingSourceError"
        assert "--three" in ended.data["hint"]
    assert not Path("a.html").exists()


def test_a_film_needs_a_motion(run: Run, two_nodes: Path) -> None:
    ended = run("show", two_nodes, "--out", "a.gif", "--json")
    assert ended.code == 2
    assert ended.data["where"] == "--trajectory"
    assert "simulate" in ended.data["hint"]


@pytest.mark.parametrize("out", ["a.xyz", "a", "missing/a.png"])
def test_a_picture_without_format_or_place_is_refused(
    out: str, run: Run, folder: Path, two_nodes: Path
) -> None:
    ended = run("show", two_nodes, "--out", out, "--json")
    assert ended.code == 2
    assert out in str(ended.data["where"]) + str(ended.data["given"])
    assert ended.data["allowed"]
    assert list(folder.iterdir()) == [two_nodes]


@pytest.mark.parametrize("content", [b"", b"rubbish", b"PK\x03\x04rubbish", b"\x93NUMPY\x01", None])
def test_a_file_that_is_no_result_is_refused(content: bytes | None, run: Run, two_nodes: Path) -> None:
    if content is not None:
        Path("a.npz").write_bytes(content)
    ended = run("show", two_nodes, "--trajectory", "a.npz", "--out", "a.png", "--json")
    assert ended.code == 2
    assert ended.data["where"] == "a.npz"
    assert "pickle" not in ended.data["given"]
    assert not Path("a.png").exists()


def test_a_result_of_another_structure_is_refused(run: Run, prism: Path, motion: Path) -> None:
    ended = run("show", prism, "--trajectory", motion, "--out", "a.png", "--json")
    assert ended.code == 2
    assert ended.data["error"] == "StructureError"


@pytest.mark.parametrize("spoil", ["time", "node_position", "status"])
def test_a_result_with_a_part_missing_or_misshapen_is_refused(
    spoil: str, run: Run, two_nodes: Path, motion: Path
) -> None:
    with np.load(motion) as file:
        data = {name: file[name] for name in file.files}
    np.savez("less.npz", allow_pickle=False, **{name: value for name, value in data.items() if name != spoil})
    cut = data | {"node_position": data["node_position"][:, :1]}
    np.savez("cut.npz", allow_pickle=False, **cut)
    for name in ("less.npz", "cut.npz"):
        ended = run("show", two_nodes, "--trajectory", name, "--out", "a.png", "--json")
        assert ended.code == 2
        assert ended.data["where"] == name
