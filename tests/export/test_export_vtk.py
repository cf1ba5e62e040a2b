"""VTK: a reader written from the format finds every array bit by bit; motions; the reader of VTK itself."""

import base64
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen import load_scene
from tensegrity_codegen.export.exporter import ExportSource, write_export
from tensegrity_codegen.scene.write import write_scene
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.outline import outline_bodies
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import InvalidValueError, OutputError, SceneSyntaxError, StructureError
from tests.export.scenes import HOIST, load_source, write_motion

DTYPES = {"Float64": "<f8", "Int64": "<i8", "Int32": "<i4"}


def read_arrays(path: Path) -> dict[str, Any]:
    """Return the arrays of a PolyData file by name, as "VTK XML file formats" describes them."""
    root = ElementTree.parse(path).getroot()
    assert root.attrib == {
        "type": "PolyData", "version": "1.0", "byte_order": "LittleEndian", "header_type": "UInt64",
    }  # fmt: skip
    found: dict[str, Any] = {}
    for item in root.iter("DataArray"):
        text, name = (item.text or "").strip(), item.get("Name", "")
        if item.get("format") == "ascii":
            found[name] = np.array(text.split(), dtype=float)
            continue
        data = base64.b64decode(text, validate=True)
        assert int.from_bytes(data[:8], "little") == len(data) - 8
        values = np.frombuffer(data[8:], DTYPES[item.get("type", "")])
        width = item.get("NumberOfComponents")
        found[name] = values if width is None else values.reshape(-1, int(width))
    for item in root.iter("Array"):
        codes = bytes(int(word) for word in (item.text or "").split())
        found[item.get("Name", "")] = codes.decode().split("\0")[:-1]
    piece = next(root.iter("Piece"))
    assert int(piece.get("NumberOfPoints", "")) == len(found["Points"])
    assert int(piece.get("NumberOfLines", "")) == len(found["offsets"])
    return found


def check_shape(found: dict[str, Any], structure: Structure, position: NDArray[np.float64]) -> None:
    np.testing.assert_array_equal(found["Points"], position)
    np.testing.assert_array_equal(found["connectivity"].reshape(-1, 2), structure.connectivity)
    assert found["offsets"].tolist() == list(range(2, 2 * structure.n_members + 1, 2))
    assert found["node_name"] == list(structure.node_name)
    assert [found["member_name"][k] for k in found["member"]] == list(structure.member_name)
    assert found["kind"].tolist() == structure.is_bar.astype(int).tolist()


def test_every_array_reads_back_bit_equal(tmp_path: Path) -> None:
    source = load_source(tmp_path, "prism")
    structure = source.structure
    assert isinstance(structure, Structure)
    exported = write_export("vtk", source, tmp_path / "prism.vtp")
    assert exported.facts == {"n_nodes": 6, "n_members": 12}
    found = read_arrays(tmp_path / "prism.vtp")
    check_shape(found, structure, structure.node_position)
    np.testing.assert_array_equal(found["tension"], structure.static_tension())
    np.testing.assert_array_equal(found["load"], structure.node_load)


def test_a_motion_is_a_collection_with_a_file_for_each_sample(tmp_path: Path) -> None:
    source = load_source(tmp_path, "prism")
    structure = source.structure
    assert isinstance(structure, Structure)
    load = np.arange(5 * 6 * 3.0).reshape(5, 6, 3)
    position = write_motion(tmp_path / "m.npz", structure, node_load=load)
    exported = write_export("vtk", source, tmp_path / "a & b.pvd", trajectory=tmp_path / "m.npz")
    assert exported.facts["n_samples"] == 5
    sets = list(ElementTree.parse(tmp_path / "a & b.pvd").getroot().iter("DataSet"))
    assert [float(item.get("timestep", "")) for item in sets] == [0.0, 0.125, 0.25, 0.375, 0.5]
    for sample, item in enumerate(sets):
        found = read_arrays(tmp_path / item.get("file", ""))
        check_shape(found, structure, position[sample])
        assert found["TimeValue"].tolist() == [0.125 * sample]
        np.testing.assert_array_equal(found["load"], load[sample])
        np.testing.assert_array_equal(found["tension"], (1 + 0.125 * sample) * np.arange(1.0, 13.0))


def test_bodies_are_drawn_with_their_bars_and_edges(tmp_path: Path) -> None:
    source = load_source(tmp_path, "svd_tower")
    system = source.structure
    assert isinstance(system, BodySystem)
    exported = write_export("vtk", source, tmp_path / "tower.vtp")
    found, outline = read_arrays(tmp_path / "tower.vtp"), outline_bodies(system)
    check_shape(found, outline, outline.node_position)
    assert np.flatnonzero(np.isnan(found["tension"])).tolist() == list(range(18, 27))
    assert any("bodies are drawn" in note for note in exported.notes)
    position = write_motion(tmp_path / "m.npz", system)
    write_export("vtk", source, tmp_path / "tower.pvd", trajectory=tmp_path / "m.npz")
    check_shape(read_arrays(tmp_path / "tower" / "sample_00004.vtp"), outline, position[4])


def test_cables_through_rings_are_lines_of_their_strands(tmp_path: Path) -> None:
    write_scene(HOIST, tmp_path / "hoist.toml", overwrite=False)
    source = ExportSource(tmp_path / "hoist.toml", *load_scene(tmp_path / "hoist.toml"))
    write_motion(tmp_path / "m.npz", source.structure)
    write_export("vtk", source, tmp_path / "a.vtp")
    write_export("vtk", source, tmp_path / "a.pvd", trajectory=tmp_path / "m.npz")
    for path, tension in ((tmp_path / "a.vtp", [3, 3, 5]), (tmp_path / "a/sample_00000.vtp", [1, 1, 2])):
        found = read_arrays(path)
        assert found["connectivity"].reshape(-1, 2).tolist() == [[0, 1], [1, 2], [1, 3]]
        assert found["member_name"] == ["rope.1", "rope.2", "stay"]
        np.testing.assert_allclose(found["tension"], tension, rtol=1e-12)


def test_a_motion_that_failed_is_noted(tmp_path: Path) -> None:
    source = load_source(tmp_path, "two_nodes")
    write_motion(tmp_path / "m.npz", source.structure, status=np.array("unstable"))
    exported = write_export("vtk", source, tmp_path / "a.pvd", trajectory=tmp_path / "m.npz")
    assert any("unstable" in note for note in exported.notes)


def test_wrong_endings_and_motions_leave_nothing(tmp_path: Path) -> None:
    source = load_source(tmp_path, "prism")
    good, other, spoiled = (tmp_path / f"{name}.npz" for name in ("good", "other", "spoiled"))
    position = write_motion(good, source.structure)
    write_motion(other, load_source(tmp_path, "tower").structure)
    position[2, 3, 1] = np.nan
    write_motion(spoiled, source.structure, node_position=position)
    before = sorted(tmp_path.iterdir())
    for file, options, error, words in (
        ("a.vtk", {}, OutputError, "'.vtk'"),
        ("a.pvd", {}, OutputError, "one shape"),
        ("a.vtp", {"trajectory": good}, OutputError, "a motion"),
        ("a", {"trajectory": good}, OutputError, "a motion"),
        ("a.pvd", {"trajectory": other}, StructureError, "another structure"),
        ("a.pvd", {"trajectory": spoiled}, SceneSyntaxError, "wrong type or shape"),
        ("a.pvd", {"trajectory": source.path}, SceneSyntaxError, "not a result file"),
        ("a.vtp", {"sample": 3}, InvalidValueError, "does not have this option"),
    ):
        with pytest.raises(error, match=words):
            write_export("vtk", source, tmp_path / file, **options)
        assert sorted(tmp_path.iterdir()) == before, file


@pytest.mark.peers
def test_vtk_reads_all_of_it(tmp_path: Path) -> None:
    vtk = pytest.importorskip("vtk", reason="needs the package vtk")
    convert = pytest.importorskip("vtk.util.numpy_support").vtk_to_numpy
    source = load_source(tmp_path, "prism")
    position = write_motion(tmp_path / "m.npz", source.structure)
    write_export("vtk", source, tmp_path / "m.pvd", trajectory=tmp_path / "m.npz")
    for sample in range(5):
        reader = vtk.vtkXMLPolyDataReader()
        reader.SetFileName(str(tmp_path / "m" / f"sample_{sample:05d}.vtp"))
        reader.Update()
        data, own = reader.GetOutput(), read_arrays(tmp_path / "m" / f"sample_{sample:05d}.vtp")
        assert (data.GetNumberOfPoints(), data.GetNumberOfLines(), data.GetNumberOfCells()) == (6, 12, 12)
        np.testing.assert_array_equal(convert(data.GetPoints().GetData()), position[sample])
        for name in ("tension", "kind", "member"):
            np.testing.assert_array_equal(convert(data.GetCellData().GetArray(name)), own[name])
        np.testing.assert_array_equal(convert(data.GetPointData().GetArray("load")), own["load"])
        names = data.GetFieldData().GetAbstractArray("member_name")
        assert [names.GetValue(k) for k in range(12)] == list(source.structure.member_name)
        assert data.GetFieldData().GetArray("TimeValue").GetValue(0) == 0.125 * sample
