"""Structure files that are small and stand for a lot, or for numbers without end, are refused."""

import os
from pathlib import Path

import pytest

from tensegrity_codegen.scene.formats.import_ntrt import import_ntrt
from tensegrity_codegen.system.errors import SceneError

LAUGHS = "".join(
    f"  k{i}: &l{i} [{', '.join([f'*l{i - 1}'] * 10)}]\n" if i else "  k0: &l0 [[a, b]]\n" for i in range(9)
)
PAIRS = (
    "nodes: {a: [0, 0, 0], b: [1, 0, 0]}\nbuilders: {rod: {class: tgRodInfo}}\npair_groups:\n  rod: &p ["
    + "[a, b], " * 20_000
    + "]\n"
)


@pytest.mark.parametrize(
    "text",
    [
        "pair_groups:\n" + LAUGHS,
        PAIRS + "".join(f"  t{i}: *p\n" for i in range(1000)),
        PAIRS.replace("20_000", "1") + "  x: &x [[a, b], *x]\n",
        "nodes: " + "[" * 20_000,
        "nodes:\n  a: [1e300, 0, 0]\n",
    ],
    ids=["laughs", "aliases", "circle", "deep", "large number"],
)
def test_what_stands_for_too_much_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SceneError):
        import_ntrt(path)


@pytest.mark.thorough
def test_pairs_are_counted_as_substructures_repeat_them(tmp_path: Path) -> None:
    (tmp_path / "part.yaml").write_text(PAIRS, encoding="utf-8")
    names = "/".join(f"p{i}" for i in range(200))
    path = tmp_path / "s.yaml"
    path.write_text(f"substructures:\n  {names}: {{path: part.yaml}}\n", encoding="utf-8")
    with pytest.raises(SceneError, match="too many substructures"):
        import_ntrt(path)


def test_a_chain_of_files_and_a_large_body_are_refused(tmp_path: Path) -> None:
    for i in range(60):
        text = f"substructures: {{c: {{path: f{i + 1}.yaml}}}}\n"
        (tmp_path / f"f{i}.yaml").write_text(text, encoding="utf-8")
    (tmp_path / "f60.yaml").write_text("nodes: {a: [0, 0, 0]}\n", encoding="utf-8")
    with pytest.raises(SceneError, match="too many substructures"):
        import_ntrt(tmp_path / "f0.yaml")
    nodes = "".join(f"  n{i}: [{i}, {i * i}, 0]\n" for i in range(150))
    rods = "".join(f"    - [n{i}, n{i + 1}]\n" for i in range(149))
    path = tmp_path / "body.yaml"
    path.write_text(f"nodes:\n{nodes}pair_groups:\n  rod:\n{rods}", encoding="utf-8")
    with pytest.raises(SceneError, match="rigid bodies"):
        import_ntrt(path)


def test_a_pipe_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "s.yaml")
    with pytest.raises(SceneError, match="a pipe"):
        import_ntrt(tmp_path / "s.yaml")
