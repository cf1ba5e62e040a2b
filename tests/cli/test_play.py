"""The verb play: what is refused before anything is compiled."""

from pathlib import Path

import pytest

from tests.cli.conftest import Run


@pytest.mark.parametrize(
    ("words", "where"),
    [(("--out", "a.png"), "a.png"), (("--out", "missing/a.html"), "missing/a.html"),
     (("--out", "a.html", "--rtol", "0.5"), "--rtol"), (("--out", "a.html", "--rtol", "nan"), "--rtol")],
)  # fmt: skip
def test_bad_input_is_refused(words: tuple[str, ...], where: str, run: Run, two_nodes: Path) -> None:
    ended = run.refused("play", two_nodes, *words, "--json")
    assert ended.data["where"] == where
    assert list(two_nodes.parent.iterdir()) == [two_nodes]


def test_a_scene_without_masses_is_refused(run: Run, folder: Path, two_nodes: Path) -> None:
    text = two_nodes.read_text(encoding="utf-8")
    light = folder / "light.toml"
    light.write_text("\n".join(line for line in text.splitlines() if not line.startswith("node_mass")) + "\n")
    ended = run.refused("play", light, "--out", "a.html", "--json")
    assert "mass" in ended.data["problem"]
    assert not Path("a.html").exists()


def test_an_input_is_not_replaced(run: Run, two_nodes: Path) -> None:
    page = two_nodes.with_suffix(".html")
    page.write_bytes(two_nodes.read_bytes())
    run.refused("play", page, "--out", page, "--json")
    assert page.read_bytes() == two_nodes.read_bytes()


def test_a_profile_of_another_input_is_refused(run: Run, two_nodes: Path) -> None:
    profile = two_nodes.with_suffix(".csv")
    profile.write_text("time,motor\n0,0\n1,0.01\n", encoding="utf-8")
    ended = run.refused("play", two_nodes, "--profile", profile, "--out", "a.html", "--json")
    assert ended.data["where"] == str(profile)
    assert "inputs" in ended.data["problem"]
    run.refused("play", two_nodes, "--profile", profile, "--out", profile.with_suffix(".png"), "--json")
