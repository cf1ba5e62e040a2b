from pathlib import Path

import numpy as np
import pytest
import typer

from tensegrity_codegen.cli.app import app
from tensegrity_codegen.cli.verbs.examples import read_example
from tests.cases import thorough
from tests.cli.conftest import Run
from tests.live.pages import require_three
from tests.report.samples import png_size

pytest.importorskip("matplotlib")
Image = pytest.importorskip("PIL.Image")
SIGNATURES = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF", ".gif": b"GIF8"}


@pytest.fixture
def motion(run: Run, two_nodes: Path) -> Path:
    run("simulate", two_nodes, "--t-end", 0.2, "--samples", 4, "--out", "motion.npz")
    return Path("motion.npz")


@pytest.mark.parametrize("suffix", [".svg", *thorough(".png", ".pdf")])
def test_a_structure_becomes_a_picture(suffix: str, run: Run, two_nodes: Path) -> None:
    ended = run.good("show", two_nodes, "--out", f"a{suffix}", "--labels", "--json")
    assert ended.facts == {"status": "ok", "out": f"a{suffix}"}
    assert Path(f"a{suffix}").read_bytes().startswith(SIGNATURES[suffix])


@pytest.mark.parametrize("suffix", [".png", *thorough(".gif")])
def test_a_motion_becomes_a_picture_or_a_film(suffix: str, run: Run, two_nodes: Path, motion: Path) -> None:
    run.good("show", two_nodes, "--trajectory", motion, "--out", f"a{suffix}", "--json")
    assert Path(f"a{suffix}").read_bytes().startswith(SIGNATURES[suffix])


@pytest.mark.parametrize("modes", [0, 2])
def test_a_motion_becomes_a_live_page(modes: int, run: Run, two_nodes: Path, motion: Path) -> None:
    require_three()
    ended = run.good("show", two_nodes, "--trajectory", motion, "--out", "a.html", "--modes", modes, "--json")
    assert ended.facts["n_frames"] == 4
    assert ended.facts["n_modes"] == min(modes, 1)
    assert ended.facts["bytes"] == Path("a.html").stat().st_size
    run.good("show", two_nodes, "--out", "a.html", "--modes", 0, "--overwrite")
    Path("a.html").write_text("<html>mine</html>", encoding="utf-8")
    run.refused("show", two_nodes, "--out", "a.html", "--modes", 0, "--json")


def test_another_file_than_three_js_is_refused(run: Run, folder: Path, two_nodes: Path) -> None:
    Path("three.whl").write_bytes(b"something else")
    for path in ("three.whl", "missing.whl"):
        ended = run.refused("show", two_nodes, "--out", "a.html", "--three", path, "--json")
        assert ended.data["error"] == "MissingSourceError"
        assert "--three" in ended.data["hint"]
    assert not Path("a.html").exists()


def test_choices_reach_pictures_and_films(run: Run, two_nodes: Path, motion: Path) -> None:
    options = ("--view", "front", "--size", "400x300", "--color", "force_density", "--no-forces", "--json")
    for more in (("--settle", "--labels", "nodes"), ("--trajectory", motion, "--follow")):
        run.good("show", two_nodes, *more, *options, "--out", "a.png", "--overwrite")
        assert png_size(Path("a.png")) == (400, 300)
    film = ("--trajectory", motion, "--fps", 10, "--size", "201x200", "--out", "a.gif")
    run.good("show", two_nodes, *film, "--json")
    with Image.open("a.gif") as images:
        assert getattr(images, "n_frames", 1) == 3
        assert images.size == (201, 200)


@pytest.mark.parametrize(
    ("options", "where"),
    [
        (("--fps", 10, "--out", "a.png"), "--fps"),
        (("--slow-down", 1, "--out", "a.html"), "--slow-down"),
        (("--slow-down", 3, "--trajectory", "motion.npz", "--out", "a.png"), "--slow-down"),
        (("--modes", 6, "--out", "a.svg"), "--modes"),
        (("--three", "missing.whl", "--trajectory", "motion.npz", "--out", "a.gif"), "--three"),
        (("--follow", "--out", "a.pdf"), "--follow"),
        (("--follow", "--out", "a.html"), "--follow"),
        (("--size", "400x300", "--out", "a.html"), "--size"),
        (("--fps", 10, "--out", "a.html"), "--fps"),
        (("--no-forces", "--out", "a.html"), "--no-forces"),
        (("--color", "kind", "--out", "a.html"), "--color"),
        (("--settle", "--trajectory", "motion.npz", "--out", "a.png"), "--settle"),
        (("--view", "top,3", "--out", "a.png"), "--view"),
        (("--size", "12", "--out", "a.png"), "--size"),
        (("--labels", "names", "--out", "a.png"), "--labels"),
        (("--color", "red", "--out", "a.png"), "--color"),
        (("--trajectory", "motion.npz", "--fps", 0, "--out", "a.gif"), "--fps"),
    ],
)
def test_options_that_a_kind_of_file_cannot_have_are_refused(
    options: tuple[object, ...], where: str, run: Run, two_nodes: Path, motion: Path
) -> None:
    before = set(Path().iterdir())
    ended = run.refused("show", two_nodes, *options, "--json")
    assert ended.data["where"] == where
    assert ended.data["allowed"]
    assert set(Path().iterdir()) == before


@pytest.mark.parametrize(
    "words",
    [
        ("--labels", "two_nodes.toml", "-o", "a.png"),
        ("two_nodes.toml", "-o", "a.png", "--labels"),
        ("two_nodes.toml", "--labels", "-o", "a.png"),
        ("two_nodes.toml", "--labels", "nodes,members", "-o", "a.png"),
        ("two_nodes.toml", "--labels=members,nodes", "-o", "a.png"),
    ],
)
def test_labels_without_a_value_are_all_names(words: tuple[str, ...], two_nodes: Path) -> None:
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    context = commands["show"].make_context("show", list(words))  # parses, does not run
    assert set(context.params["labels"].split(",")) == {"nodes", "members"}
    assert context.params["scene"] == two_nodes.relative_to(two_nodes.parent)


def test_names_that_are_left_out_are_stated(run: Run, folder: Path) -> None:
    Path("mast.toml").write_text(read_example("tower"), encoding="utf-8")
    ended = run.good("show", "mast.toml", "--labels", "members", "--out", "a.png", "--json")
    assert ended.data["labels_left_out"] == [{"kind": "members", "count": 48, "limit": 30}]
    assert "48" in ended.err
    assert any("members" in text for text in ended.data["warnings"])


def test_a_structure_without_equilibrium_is_not_drawn_settled(run: Run, folder: Path) -> None:
    text = read_example("two_nodes").replace("anchor_first = true", "anchor_first = false")
    Path("loose.toml").write_text(text, encoding="utf-8")
    ended = run("show", "loose.toml", "--settle", "--out", "a.png", "--json")
    assert ended.code == 3
    assert ended.data["evidence"]["status"]
    assert not Path("a.png").exists()


def test_a_film_needs_a_motion(run: Run, two_nodes: Path) -> None:
    ended = run.refused("show", two_nodes, "--out", "a.gif", "--json")
    assert ended.data["where"] == "--trajectory"
    assert "simulate" in ended.data["hint"]


@pytest.mark.parametrize("out", ["a.xyz", "a", "missing/a.png"])
def test_a_picture_without_format_or_place_is_refused(
    out: str, run: Run, folder: Path, two_nodes: Path
) -> None:
    ended = run.refused("show", two_nodes, "--out", out, "--json")
    assert out in str(ended.data["where"]) + str(ended.data["given"])
    assert ended.data["allowed"]
    if "/" not in out:
        assert ended.data["where"] == "--out"
        assert all(kind in ended.data["allowed"] for kind in (*SIGNATURES, ".mp4", ".html"))
    assert list(folder.iterdir()) == [two_nodes]


@pytest.mark.parametrize("content", [b"", b"rubbish", b"PK\x03\x04rubbish", b"\x93NUMPY\x01", None])
def test_a_file_that_is_no_result_is_refused(content: bytes | None, run: Run, two_nodes: Path) -> None:
    if content is not None:
        Path("a.npz").write_bytes(content)
    ended = run.refused("show", two_nodes, "--trajectory", "a.npz", "--out", "a.png", "--json")
    assert ended.data["where"] == "a.npz"
    assert "pickle" not in ended.data["given"]
    assert not Path("a.png").exists()


def test_a_result_of_another_structure_is_refused(run: Run, prism: Path, motion: Path) -> None:
    ended = run.refused("show", prism, "--trajectory", motion, "--out", "a.png", "--json")
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
        ended = run.refused("show", two_nodes, "--trajectory", name, "--out", "a.png", "--json")
        assert ended.data["where"] == name


def test_a_picture_out_of_balance_is_stated(run: Run, folder: Path, prism: Path) -> None:
    """The stated prestress of the prism carries no weight."""
    ended = run.good("show", prism, "-o", folder / "a.svg", "--forces", "--json")
    (text,) = [text for text in ended.data["warnings"] if "not in balance" in text]
    assert "--settle" in text
    ended = run.good("show", prism, "-o", folder / "b.svg", "--forces", "--settle", "--json")
    assert "warnings" not in ended.data
