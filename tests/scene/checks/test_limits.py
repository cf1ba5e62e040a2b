"""Files that are small and would cost much are refused at once, and so are things that are no files."""

import os
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest

from tensegrity_codegen.scene.checks.limits import PART
from tensegrity_codegen.scene.formats.import_tables import import_tables
from tensegrity_codegen.scene.read import parse_scene, read_scene
from tensegrity_codegen.system.errors import SceneError


@pytest.mark.parametrize(
    "make",
    [
        lambda: "loads = [" + "{}," * 1_000_000 + "]\n",
        lambda: "loads = [" + '"",' * 1_500_000 + "]\n",
        lambda: "[[loads]]\n" * 600_000,
        lambda: "[nodes]\n" + "".join(f'"n{i}!" = {{}}\n' for i in range(600_000)),
        lambda: "[nodes.a]\n" + "".join(f"k{i} = 1\n" for i in range(1_200_000)),
        lambda: "[groups]\ng = [" + '"m",' * 1_200_000 + "]\n",
    ],
    ids=["tables", "texts", "headers", "names", "keys", "references"],
)
def test_millions_of_tiny_things_are_refused_before_they_are_built(
    tmp_path: Path, make: Callable[[], str]
) -> None:
    path = tmp_path / "s.toml"
    path.write_text('name = "s"\n' + make(), encoding="utf-8")
    tracemalloc.start()
    try:
        with pytest.raises(SceneError, match="too many"):
            read_scene(path)
        assert tracemalloc.get_traced_memory()[1] < 200 * 2**20
    finally:
        tracemalloc.stop()


def test_errors_of_a_long_section_are_few_and_named(tmp_path: Path) -> None:
    good = [{"node": "a", "force": [1.0, 0.0, 0.0]}] * PART
    with pytest.raises(SceneError) as caught:
        parse_scene({"name": "s", "loads": [*good, *[{}] * 150_000]})
    assert f"loads[{PART}]" in caught.value.where + caught.value.hint
    with pytest.raises(SceneError, match="unknown key"):
        parse_scene({"name": "s", "nodes": {f"n{i}": {"a": 1} for i in range(100_000)}})
    with pytest.raises(SceneError, match="too many entries"):
        parse_scene({"name": "s", "nodes": {f"n{i}": {} for i in range(300_000)}})


def test_a_section_that_is_read_part_by_part_is_the_same() -> None:
    document = {
        "name": "s",
        "nodes": {f"n{i}": {"position": [0.0, 0.0, float(i)]} for i in range(2 * PART + 3)},
        "loads": [{"node": f"n{i}", "force": [0.0, 0.0, 1.0]} for i in range(PART + 1)],
    }
    scene = parse_scene(document)
    assert list(scene.nodes) == list(document["nodes"])
    assert scene.nodes["n700"].position == (0.0, 0.0, 700.0)
    assert len(scene.loads) == PART + 1
    assert scene.model_fields_set == {"name", "nodes", "loads"}


@pytest.mark.parametrize("kind", ["pipe", "folder", "device"])
def test_what_is_no_regular_file_is_refused_at_once(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "x.toml" if kind != "device" else Path("/dev/zero")
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    for read in (read_scene, lambda item: import_tables(item, item)):
        with pytest.raises(SceneError, match=f"this is a {kind}"):
            read(path)


def test_a_table_of_a_million_rows_is_refused_by_import(tmp_path: Path) -> None:
    nodes = tmp_path / "n.csv"
    nodes.write_text("node,x,y,z\n" + "".join(f"n{i},0,0,{i}\n" for i in range(1_000_000)), encoding="utf-8")
    with pytest.raises(SceneError, match="too many rows"):
        import_tables(nodes, nodes)
