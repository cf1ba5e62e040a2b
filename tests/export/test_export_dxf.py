"""DXF: lines on the layers of their kinds and groups, read back by ezdxf and `import`; samples of motions."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.export.exporter import write_export
from tensegrity_codegen.scene.formats.format import read_files
from tensegrity_codegen.structure.outline import outline_bodies
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import InvalidValueError, MissingExtraError, StructureError
from tests.export.scenes import load_source, write_motion


@pytest.fixture
def ezdxf() -> Any:
    return pytest.importorskip("ezdxf", reason="needs the package ezdxf, the extra `cad`")


def read_lines(ezdxf: Any, path: Path) -> tuple[list[Any], list[str]]:
    """Return ends (n, 2, 3) and layers of the lines of a valid drawing in metres."""
    document = ezdxf.readfile(path)
    assert document.audit().errors == []
    assert document.units == 6
    lines = list(document.modelspace())
    assert {line.dxftype() for line in lines} == {"LINE"}
    return [[line.dxf.start.xyz, line.dxf.end.xyz] for line in lines], [line.dxf.layer for line in lines]


@pytest.mark.parametrize("name", ["prism", "tower", "planar", "svd_tower"])
def test_lines_are_the_members_bit_by_bit(name: str, ezdxf: Any, tmp_path: Path) -> None:
    source = load_source(tmp_path, name)
    exported = write_export("dxf", source, tmp_path / "a.dxf")
    ends, layers = read_lines(ezdxf, tmp_path / "a.dxf")
    outline = outline_bodies(source.structure)
    np.testing.assert_array_equal(ends, outline.node_position[outline.connectivity])
    assert [layer.startswith("bars") for layer in layers] == outline.is_bar.tolist()
    assert exported.facts["n_members"] == outline.n_members


def test_groups_have_layers_the_smallest_first(ezdxf: Any, tmp_path: Path) -> None:
    source = load_source(tmp_path, "tower")
    write_export("dxf", source, tmp_path / "a.dxf")
    layers = read_lines(ezdxf, tmp_path / "a.dxf")[1]
    structure = source.structure
    for name in ("vertical_cables", "saddle_cables", "diagonal_cables"):
        assert {layers[row] for row in structure.groups[name]} == {f"cables-{name}"}
    assert {layers[row] for row in structure.groups["bars"]} == {"bars"}
    document = ezdxf.readfile(tmp_path / "a.dxf")
    assert {document.layers.get(layer).color for layer in layers if layer.startswith("cables")} == {5}


def test_import_reads_nodes_and_members_back(ezdxf: Any, tmp_path: Path) -> None:
    source = load_source(tmp_path, "tower")
    structure = source.structure
    assert isinstance(structure, Structure)
    write_export("dxf", source, tmp_path / "a.dxf")
    document = read_files([tmp_path / "a.dxf"]).document
    back = {key: tuple(node["position"]) for key, node in document["nodes"].items()}
    place = [tuple(row) for row in structure.node_position.tolist()]
    assert sorted(back.values()) == sorted(place)
    ends = [tuple(back[key] for key in member["nodes"]) for member in document["members"].values()]
    assert ends == [(place[i], place[j]) for i, j in structure.connectivity.tolist()]
    kinds = [member["kind"] == "bar" for member in document["members"].values()]
    assert kinds == structure.is_bar.tolist()


def test_a_motion_gives_its_last_or_a_chosen_sample(ezdxf: Any, tmp_path: Path) -> None:
    source = load_source(tmp_path, "prism")
    position = write_motion(tmp_path / "m.npz", source.structure)
    for sample, row, time in ((None, 4, 0.5), (2, 2, 0.25), (-5, 0, 0.0)):
        exported = write_export(
            "dxf", source, tmp_path / "a.dxf", overwrite=True, trajectory=tmp_path / "m.npz", sample=sample
        )
        assert exported.facts["time"] == time
        ends = read_lines(ezdxf, tmp_path / "a.dxf")[0]
        np.testing.assert_array_equal(ends, position[row][source.structure.connectivity])


def test_wrong_samples_and_motions_leave_nothing(ezdxf: Any, tmp_path: Path) -> None:
    source = load_source(tmp_path, "prism")
    good, other = tmp_path / "good.npz", tmp_path / "other.npz"
    write_motion(good, source.structure)
    write_motion(other, load_source(tmp_path, "tower").structure)
    before = sorted(tmp_path.iterdir())
    for options, error, words in (
        ({"sample": 1}, InvalidValueError, "only a motion has samples"),
        ({"trajectory": good, "sample": 5}, InvalidValueError, "no such sample"),
        ({"trajectory": good, "sample": -6}, InvalidValueError, "no such sample"),
        ({"trajectory": other}, StructureError, "another structure"),
    ):
        with pytest.raises(error, match=words):
            write_export("dxf", source, tmp_path / "a.dxf", **options)
        assert sorted(tmp_path.iterdir()) == before


def test_a_missing_package_is_named_with_its_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ezdxf", None)
    source = load_source(tmp_path, "prism")
    with pytest.raises(MissingExtraError, match="DXF files need the package 'ezdxf'") as caught:
        write_export("dxf", source, tmp_path / "a.dxf")
    assert "'.[cad]'" in caught.value.hint
    assert not (tmp_path / "a.dxf").exists()
    (tmp_path / "b.dxf").write_text("0\nEOF\n", encoding="utf-8")
    with pytest.raises(MissingExtraError, match="ezdxf"):
        read_files([tmp_path / "b.dxf"])
