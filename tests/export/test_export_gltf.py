"""glTF: a reader written from the specification finds members where the scene has them, at every sample."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tensegrity_codegen import load_scene
from tensegrity_codegen.export.export_gltf import _compute_rotations
from tensegrity_codegen.export.exporter import write_export
from tensegrity_codegen.scene.formats.format import read_files
from tensegrity_codegen.scene.write import write_scene
from tensegrity_codegen.structure.outline import outline_bodies
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import InvalidValueError, SceneSyntaxError, StructureError
from tests.export.scenes import load_source, write_motion

Array = NDArray[np.float64]
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


class Glb:
    """A file as "glTF 2.0 Specification", section 4.4, describes it."""

    def __init__(self, path: Path) -> None:
        data = path.read_bytes()
        magic, version, length, size, kind = struct.unpack_from("<4sIII4s", data)
        assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
        assert size % 4 == 0
        self.content = json.loads(data[20 : 20 + size])
        count, kind = struct.unpack_from("<I4s", data, 20 + size)
        assert kind == b"BIN\0"
        self.data = data[28 + size :]
        assert len(self.data) == count == self.content["buffers"][0]["byteLength"]
        assert count % 4 == 0

    def read(self, number: int) -> Any:
        accessor = self.content["accessors"][number]
        view = self.content["bufferViews"][accessor["bufferView"]]
        dtype = {5126: "<f4", 5123: "<u2"}[accessor["componentType"]]
        assert view["byteOffset"] % 4 == 0
        part = self.data[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        width = WIDTHS[accessor["type"]]
        array = np.frombuffer(part, dtype).reshape(accessor["count"], width)
        assert accessor["min"] == array.min(axis=0).tolist()
        assert accessor["max"] == array.max(axis=0).tolist()
        return array[:, 0] if width == 1 else array

    def find_ends(self, sample: int | None = None) -> dict[str, Array]:
        """Return the ends (2, 3) of each member in the axes of a scene, at a sample of the animation."""
        nodes = [dict(node) for node in self.content["nodes"]]
        if sample is not None:
            animation = self.content["animations"][0]
            for channel in animation["channels"]:
                sampler, target = animation["samplers"][channel["sampler"]], channel["target"]
                nodes[target["node"]][target["path"]] = self.read(sampler["output"])[sample]
        found = {}
        for node in nodes[1:]:
            if "mesh" not in node:
                continue
            part = self.content["meshes"][node["mesh"]]["primitives"][0]
            assert part["mode"] == 1
            place = self.read(part["attributes"]["POSITION"])
            turn = Rotation.from_quat(np.array(node["rotation"]))
            ends = turn.apply(place * np.array(node["scale"])) + np.array(node["translation"])
            found[node["name"]] = ends[:, [0, 2, 1]] * [1, -1, 1]
        return found

    def find_nodes(self, sample: int) -> dict[str, Array]:
        """Return the places of empty nodes at a sample."""
        channels = self.content["animations"][0]
        moved = {item["target"]["node"]: item["sampler"] for item in channels["channels"]}
        return {
            node["name"]: self.read(channels["samplers"][moved[k]]["output"])[sample][[0, 2, 1]] * [1, -1, 1]
            for k, node in enumerate(self.content["nodes"])
            if k and "mesh" not in node
        }


def check_ends(found: dict[str, Array], structure: Structure, position: Array, tolerance: float) -> None:
    assert list(found) == list(structure.member_name)
    for name, ends in zip(structure.member_name, structure.connectivity, strict=True):
        np.testing.assert_allclose(found[name], position[ends], rtol=0, atol=tolerance, err_msg=name)


@pytest.mark.parametrize("name", ["prism", "tower", "icosahedron", "svd_tower"])
def test_members_are_where_the_scene_has_them(name: str, tmp_path: Path) -> None:
    source = load_source(tmp_path, name)
    write_export("gltf", source, tmp_path / "a.glb")
    glb, outline = Glb(tmp_path / "a.glb"), outline_bodies(source.structure)
    check_ends(glb.find_ends(), outline, outline.node_position, 4e-15)
    kinds = [node["extras"]["kind"] == "bar" for node in glb.content["nodes"] if "mesh" in node]
    assert kinds == outline.is_bar.tolist()
    assert "animations" not in glb.content


def test_bars_are_closed_cylinders_of_their_radius(tmp_path: Path) -> None:
    write_export("gltf", load_source(tmp_path, "prism"), tmp_path / "a.glb")
    glb = Glb(tmp_path / "a.glb")
    bar = next(node for node in glb.content["nodes"] if node["name"] == "bar1")
    assert bar["scale"][0] == bar["scale"][2] == 0.004
    part = glb.content["meshes"][bar["mesh"]]["primitives"][1]
    place, faces = glb.read(part["attributes"]["POSITION"]), glb.read(part["indices"]).reshape(-1, 3)
    np.testing.assert_allclose(np.hypot(place[:, 0], place[:, 2]), 1.0, rtol=1e-7)
    corners = place[faces].astype(float)
    volume = np.einsum("ni,ni->n", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    # The prism over a regular polygon of 12 sides, positive where all triangles face outwards
    assert volume == pytest.approx(12 / 2 * np.sin(2 * np.pi / 12), rel=1e-6)
    edges = {(a, b) for face in faces.tolist() for a, b in zip(face, face[1:] + face[:1], strict=True)}
    assert all((b, a) in edges for a, b in edges)
    cable = next(node for node in glb.content["nodes"] if node["name"] == "top1")
    assert len(glb.content["meshes"][cable["mesh"]]["primitives"]) == 1


@pytest.mark.parametrize(("name", "n_samples"), [("prism", 9), ("prism", 2), ("svd_tower", 5)])
def test_the_animation_has_every_sample(name: str, n_samples: int, tmp_path: Path) -> None:
    source = load_source(tmp_path, name)
    position = write_motion(tmp_path / "m.npz", source.structure, n_samples)
    write_export("gltf", source, tmp_path / "a.glb", trajectory=tmp_path / "m.npz")
    glb, outline = Glb(tmp_path / "a.glb"), outline_bodies(source.structure)
    samplers = glb.content["animations"][0]["samplers"]
    assert {item["input"] for item in samplers} == {samplers[0]["input"]}
    np.testing.assert_allclose(glb.read(samplers[0]["input"]), np.linspace(0, 0.5, n_samples), rtol=1e-7)
    for sample in range(n_samples):
        check_ends(glb.find_ends(sample), outline, position[sample], 4e-7)
        nodes = glb.find_nodes(sample)
        np.testing.assert_allclose([nodes[key] for key in outline.node_name], position[sample], atol=2e-7)


def test_what_does_not_move_has_no_channel(tmp_path: Path) -> None:
    source = load_source(tmp_path, "two_nodes")
    structure = source.structure
    assert isinstance(structure, Structure)
    still = np.broadcast_to(structure.node_position, (3, 2, 3))
    write_motion(tmp_path / "m.npz", structure, 3, node_position=still)
    write_export("gltf", source, tmp_path / "a.glb", trajectory=tmp_path / "m.npz")
    assert "animations" not in Glb(tmp_path / "a.glb").content


def test_rotations_go_the_shortest_way_and_through_half_turns() -> None:
    angle = np.linspace(0.0, 7.0, 40)
    around = np.stack([np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    flips = np.array([[0, -1, 0], [0, 1, 0], [1, 0, 0], [-1, 0, 0]] * 10, dtype=float)
    direction = np.stack([around, flips, np.broadcast_to([0.0, -1.0, 0.0], (40, 3))], axis=1)
    turned = _compute_rotations(direction)
    for k in range(3):
        found = Rotation.from_quat(turned[:, k]).apply([0.0, 1.0, 0.0])
        np.testing.assert_allclose(found, direction[:, k], atol=1e-14)
    # About z alone, by the angle between samples: cos of half of it between the quaternions
    np.testing.assert_allclose((turned[1:, 0] * turned[:-1, 0]).sum(axis=1), np.cos(3.5 / 39), rtol=1e-12)
    np.testing.assert_allclose(np.abs(turned[:, 0, :2]).max(), 0.0, atol=1e-15)


@pytest.mark.parametrize("name", ["prism", "tower", "icosahedron", "planar", "two_nodes"])
def test_import_reads_nodes_and_members_back(name: str, tmp_path: Path) -> None:
    source = load_source(tmp_path, name)
    structure = source.structure
    assert isinstance(structure, Structure)
    write_export("gltf", source, tmp_path / f"{name}.glb")
    document = read_files([tmp_path / f"{name}.glb"]).document
    back = {key: node["position"] for key, node in document["nodes"].items()}
    used = set(structure.connectivity.ravel().tolist())
    assert set(back) == {structure.node_name[k] for k in used}
    for k in used:  # in double precision, unchanged
        assert back[structure.node_name[k]] == structure.node_position[k].tolist()
    pairs = [[structure.node_name[end] for end in ends] for ends in structure.connectivity]
    assert [member["nodes"] for member in document["members"].values()] == pairs
    assert list(document["members"]) == list(structure.member_name)
    kinds = [member["kind"] == "bar" for member in document["members"].values()]
    assert kinds == structure.is_bar.tolist()
    write_scene(document, tmp_path / "back.toml", overwrite=False)
    assert load_scene(tmp_path / "back.toml")[0].n_members == structure.n_members


def test_wrong_motions_leave_nothing(tmp_path: Path) -> None:
    source = load_source(tmp_path, "prism")
    late, other, spoiled = (tmp_path / f"{name}.npz" for name in ("late", "other", "spoiled"))
    position = write_motion(late, source.structure, time=1e6 + 1e-3 * np.arange(5))
    write_motion(other, load_source(tmp_path, "icosahedron").structure)
    write_motion(spoiled, source.structure, node_position=np.where(position > 0, np.nan, position))
    before = sorted(tmp_path.iterdir())
    for file, error, words in (
        (late, InvalidValueError, "the same time in single precision"),
        (other, StructureError, "another structure"),
        (spoiled, SceneSyntaxError, "wrong type or shape"),
    ):
        with pytest.raises(error, match=words):
            write_export("gltf", source, tmp_path / "a.glb", trajectory=file)
        assert sorted(tmp_path.iterdir()) == before


@pytest.mark.peers
def test_vtk_plays_the_animation(tmp_path: Path) -> None:
    vtk = pytest.importorskip("vtk", reason="needs the package vtk")
    source = load_source(tmp_path, "tower")
    position = write_motion(tmp_path / "m.npz", source.structure)
    write_export("gltf", source, tmp_path / "a.glb", trajectory=tmp_path / "m.npz")
    reader = vtk.vtkGLTFReader()
    reader.SetFileName(str(tmp_path / "a.glb"))
    reader.SetApplyDeformationsToGeometry(True)
    reader.SetFrameRate(8)
    reader.UpdateInformation()
    assert reader.GetAnimationDuration(0) == 0.5
    reader.EnableAnimation(0)
    lows = []
    for sample in range(5):
        reader.UpdateInformation()
        reader.UpdateTimeStep(0.125 * sample)
        bounds = vtk.vtkBoundingBox()
        items = reader.GetOutput().NewIterator()
        while not items.IsDoneWithTraversal():
            data = items.GetCurrentDataObject()
            if data.GetNumberOfPoints() == 2:
                bounds.AddBounds(data.GetBounds())
            items.GoToNextItem()
        lows.append([*bounds.GetMinPoint(), *bounds.GetMaxPoint()])
    turned = position[..., [0, 2, 1]] * [1, 1, -1]
    expected = np.concatenate([turned.min(axis=1), turned.max(axis=1)], axis=1)
    np.testing.assert_allclose(lows, expected, atol=1e-6)


def test_all_nodes_are_below_one_root(tmp_path: Path) -> None:
    source = load_source(tmp_path, "svd_tower")
    write_export("gltf", source, tmp_path / "a.glb")
    content = Glb(tmp_path / "a.glb").content
    assert content["scenes"] == [{"nodes": [0]}]
    assert content["nodes"][0]["name"] == source.structure.name
    assert len(content["nodes"][0]["children"]) == len(content["nodes"]) - 1 == 19 + 27
