"""The verbs `export` and `import` with shapes, motions and lines: exit codes, nothing half written."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen import load_scene
from tensegrity_codegen.scene.write import write_scene
from tests.cli.conftest import Run, write_example
from tests.export.scenes import write_motion
from tests.rigid_scenes import HANGING as RODS


@pytest.fixture
def motion(prism: Path, folder: Path) -> Path:
    """A result file of a motion of the prism."""
    write_motion(folder / "m.npz", load_scene(prism)[0])
    return folder / "m.npz"


@pytest.mark.parametrize(
    ("format_name", "out", "written"),
    [
        ("csv", "tables", ["tables/members.csv", "tables/motion.csv", "tables/nodes.csv"]),
        ("gltf", "a.glb", ["a.glb"]),
        ("vtk", "a.pvd", ["a.pvd", *(f"a/sample_{k:05d}.vtp" for k in range(5))]),
    ],
)
def test_a_motion_is_exported(
    format_name: str, out: str, written: list[str], run: Run, prism: Path, motion: Path, folder: Path
) -> None:
    before = set(folder.rglob("*"))
    ended = run.good("export", format_name, prism, "--trajectory", motion, "-o", out, "--json")
    assert ended.facts["out"] == out
    assert (ended.facts["n_nodes"], ended.facts["n_members"], ended.facts["n_samples"]) == (6, 12, 5)
    files = {path for path in set(folder.rglob("*")) - before if path.is_file()}
    assert sorted(path.relative_to(folder).as_posix() for path in files) == written


def test_tables_come_back(run: Run, prism: Path, folder: Path) -> None:
    run.good("export", "csv", prism, "-o", "tables")
    words = ("--name", "prism", "--gravity", "0,0,-9.81", "-o", "back.toml")
    run.good("import", "tables/nodes.csv", "tables/members.csv", *words)
    for name in ("node_position", "rest_length", "spring_constant", "member_mass"):
        found, known = (getattr(load_scene(path)[0], name) for path in (folder / "back.toml", prism))
        np.testing.assert_array_equal(found, known)


def test_lines_come_back_with_a_stiffness(run: Run, prism: Path, folder: Path) -> None:
    run.good("export", "gltf", prism, "-o", "a.glb")
    words = ("--axial-stiffness", "2e4", "--tolerance", "1e-4", "-o", "back.toml")
    ended = run.good("import", "a.glb", *words, "--json")
    assert (ended.facts["n_nodes"], ended.facts["n_members"]) == (6, 12)
    structure, known = load_scene(folder / "back.toml")[0], load_scene(prism)[0]
    np.testing.assert_array_equal(structure.axial_stiffness, np.where(known.is_bar, 0.0, 2e4))  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("words", "where", "hint"),
    [
        (("vtk", "prism.toml", "-o", "a.vtu"), "a.vtu", ".vtp"),
        (("gltf", "prism.toml", "-o", "a.gltf"), "a.gltf", ".glb"),
        (("csv", "prism.toml", "-o", "a.csv"), "a.csv", "without an ending"),
        (("csv", "svd_tower.toml", "-o", "tables"), "svd_tower.toml", "no bodies"),
        (("vtk", "prism.toml", "-o", "a.vtp", "--trajectory", "m.npz"), "a.vtp", ".pvd"),
        (("gltf", "tower.toml", "-o", "a.glb", "--trajectory", "m.npz"), "m.npz", "48 members of tower"),
        (("gltf", "prism.toml", "-o", "a.glb", "--trajectory", "nan.npz"), "nan.npz", "finite"),
        (("gltf", "prism.toml", "-o", "a.glb", "--trajectory", "no.npz"), "no.npz", "simulate"),
        (("gltf", "prism.toml", "-o", "a.glb", "--sample", "1"), "--sample", "with dxf, acados only"),
        (
            ("mjcf", "prism.toml", "-o", "a.xml", "--trajectory", "m.npz"),
            "--trajectory",
            "csv, dxf, gltf, vtk",
        ),
    ],
)
@pytest.mark.usefixtures("motion")
def test_wrong_input_is_refused(
    words: tuple[str, ...], where: str, hint: str, run: Run, prism: Path, folder: Path
) -> None:
    for name in ("tower", "svd_tower"):
        write_example(folder, name)
    position = np.full((5, 6, 3), np.nan)
    write_motion(folder / "nan.npz", load_scene(prism)[0], node_position=position)
    before = sorted(folder.rglob("*"))
    ended = run.refused("export", *words, "--json")
    assert ended.data["where"] == where
    assert hint in ended.out
    assert sorted(folder.rglob("*")) == before


def test_a_motion_is_never_replaced(run: Run, prism: Path, motion: Path) -> None:
    before = motion.read_bytes()
    run.refused("export", "gltf", prism, "--trajectory", motion, "-o", motion, "--overwrite")
    assert motion.read_bytes() == before


def test_a_missing_package_ends_with_code_2(
    run: Run, prism: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "ezdxf", None)
    (folder / "a.dxf").write_text("0\nEOF\n", encoding="utf-8")
    for words in (("export", "dxf", prism, "-o", "b.dxf"), ("import", "a.dxf", "-o", "b.toml")):
        ended = run.refused(*words)
        assert "pip install '.[cad]'" in ended.err
    assert not (folder / "b.dxf").exists()
    assert not (folder / "b.toml").exists()


def test_shapes_have_points_of_bodies_and_tables_refuse_them(run: Run, folder: Path) -> None:
    write_scene(RODS, folder / "rods.toml", overwrite=False)
    motion = folder / "rods.npz"
    run.good("simulate", "rods.toml", "--t-end", "0.02", "--samples", "3", "--out", motion)
    for name, out in (("gltf", "rods.glb"), ("vtk", "rods.pvd")):
        ended = run.good("export", name, "rods.toml", "--trajectory", motion, "--out", out, "--json")
        assert (ended.data["n_nodes"], ended.data["n_members"], ended.data["n_samples"]) == (4, 2, 3)
        assert any("rigid bodies are not in the file" in note for note in ended.data["warnings"])
    ended = run("export", "csv", "rods.toml", "--out", "tables", "--json")
    assert ended.code == 2
    assert "rigid bodies are not supported here: tables" in ended.data["problem"]
    run.good("export", "json", "rods.toml", "--out", "rods.json")
    document = json.loads((folder / "rods.json").read_text(encoding="utf-8"))
    assert document["bodies"]["block"]["mass"] == 0.5
