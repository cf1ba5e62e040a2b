"""Export to glTF 2.0 (.glb), for viewers: bars as cylinders or lines, cables as lines, motions as animations.

Every member is a node of the file that scales and turns one mesh: a segment or cylinder from 0 to 1 along y.
A motion animates translation, rotation and scale of these nodes, which every viewer plays; morph targets,
the other way, are limited in number, and skins do not move lines in three.js.
(Khronos Group, "glTF 2.0 Specification".) y is up: (x, y, z) of the scene is (x, z, -y) of the file.
"""

import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.export.exporter import Exported, Exporter, ExportSource, Shapes, read_shapes
from tensegrity_codegen.scene.formats.import_gltf import BINARY, JSON, LINES, MAGIC
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError

TRIANGLES, FLOAT, UINT16 = 4, 5126, 5123
VERTICES, INDICES = 34962, 34963  # targets of buffer views
SIDES = 12  # of cylinders
ROUND = "bar with radius"
BROWN, BLUE = (0.55, 0.35, 0.15, 1.0), (0.1, 0.2, 0.6, 1.0)  # red, green, blue, alpha


class _Writer:
    """The content of a file, and the buffer that its accessors lead to."""

    def __init__(self, name: str) -> None:
        self.buffer = bytearray()
        self.nodes: list[dict[str, Any]] = [{"name": name, "children": []}]
        asset = {"version": "2.0", "generator": "tensegrity_codegen"}
        self.content: dict[str, Any] = {"asset": asset, "scene": 0, "scenes": [{"nodes": [0]}]}
        self.content |= {"nodes": self.nodes, "bufferViews": [], "accessors": []}

    def add_array(self, values: ArrayLike, component: int = FLOAT, target: int | None = None) -> int:
        """Return the number of a new accessor of vectors or scalars."""
        array = np.asarray(values, dtype="<f4" if component == FLOAT else "<u2")
        view = {"buffer": 0, "byteOffset": len(self.buffer), "byteLength": array.nbytes}
        self.buffer += array.tobytes() + bytes(-array.nbytes % 4)
        self.content["bufferViews"].append(view if target is None else {**view, "target": target})
        number, rows = len(self.content["accessors"]), array.reshape(len(array), -1)
        accessor: dict[str, Any] = {"bufferView": number, "componentType": component, "count": len(array)}
        accessor |= {"type": "SCALAR" if array.ndim == 1 else f"VEC{array.shape[1]}"}
        self.content["accessors"].append(
            accessor | {"min": rows.min(0).tolist(), "max": rows.max(0).tolist()}
        )
        return number

    def add_node(self, name: str, **keys: Any) -> int:
        """Return the number of a new node below the first one."""
        self.nodes[0]["children"].append(len(self.nodes))
        self.nodes.append({"name": name, **keys})
        return len(self.nodes) - 1

    def pack(self) -> bytes:
        """Return the file: header, text, buffer, each of whole words of four bytes."""
        self.content["buffers"] = [{"byteLength": len(self.buffer)}]
        dumped = json.dumps(self.content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
        content = dumped.encode()
        content += b" " * (-len(content) % 4)
        head = struct.pack("<5I", MAGIC, 2, 28 + len(content) + len(self.buffer), len(content), JSON)
        return head + content + struct.pack("<2I", len(self.buffer), BINARY) + self.buffer


def write_gltf(source: ExportSource, path: Path, *, trajectory: Path | None = None) -> Exported:
    """Write the shape of a scene, or a motion, which then is the animation of the file, as .glb."""
    shapes = read_shapes(source, trajectory)
    structure = shapes.structure
    writer = _Writer(structure.name)
    paths = [*_add_nodes(writer, shapes), *_add_members(writer, shapes)]
    facts = {"n_nodes": structure.n_nodes, "n_members": structure.n_members}
    if trajectory is not None:
        _animate(writer, shapes, paths)
        facts["n_samples"] = len(shapes.time)
    path.write_bytes(writer.pack())
    lost = "the file has shapes alone: no stiffnesses, masses, anchors, loads and tensions"
    return Exported(facts, (lost, *shapes.notes))


def _turn(place: FloatArray) -> FloatArray:
    """Return places (..., 3) of the scene in the file, whose y axis is up."""
    turned: FloatArray = place[..., [0, 2, 1]] * (1.0, 1.0, -1.0) + 0.0  # no -0.0
    return turned


def _add_nodes(writer: _Writer, shapes: Shapes) -> Iterator[tuple[int, str, FloatArray]]:
    """Add a node for each node of the scene; yield its number, its channel, and the values (n_t, 3)."""
    for row, name in enumerate(shapes.structure.node_name):
        values = _turn(shapes.node_position[:, row])
        yield writer.add_node(name, translation=values[0].tolist()), "translation", values


def _add_members(writer: _Writer, shapes: Shapes) -> Iterator[tuple[int, str, FloatArray]]:
    """Add a node for each member; yield its number with each of its translation, rotation and scale."""
    structure, ends = shapes.structure, _turn(shapes.node_position)[:, shapes.structure.connectivity]
    vector = ends[:, :, 1] - ends[:, :, 0]
    length = np.linalg.norm(vector, axis=2)
    rotation = _compute_rotations(vector / np.where(length > 0, length, 1.0)[..., None])
    kinds = np.where(structure.is_bar, np.where(structure.radius > 0, ROUND, "bar"), "cable").tolist()
    names = _add_meshes(writer, sorted(set(kinds)))
    for row, (name, kind) in enumerate(zip(structure.member_name, kinds, strict=True)):
        across = np.full(len(length), structure.radius[row] if kind == ROUND else 1.0)
        scale = np.stack([across, length[:, row], across], axis=1)
        paths = {"translation": ends[:, row, 0], "rotation": rotation[:, row], "scale": scale}
        at_start = {key: values[0].tolist() for key, values in paths.items()}
        extras = {"kind": kind.partition(" ")[0]}
        node = writer.add_node(name, mesh=names.index(kind), extras=extras, **at_start)
        yield from ((node, key, values) for key, values in paths.items())


def _add_meshes(writer: _Writer, kinds: list[str]) -> list[str]:
    """Add a mesh and a material for each kind: a segment from 0 to 1 along y, for round bars a cylinder."""
    segment = {"POSITION": writer.add_array([[0, 0, 0], [0, 1, 0]], target=VERTICES)}
    writer.content |= {"meshes": [], "materials": []}
    for number, kind in enumerate(kinds):
        primitives: list[dict[str, Any]] = [{"attributes": segment, "mode": LINES, "material": number}]
        if kind == ROUND:
            k = np.arange(SIDES)
            angle = 2 * np.pi * np.concatenate([k, k]) / SIDES
            surface = np.stack([np.sin(angle), np.repeat([0, 1], SIDES), np.cos(angle)], axis=1)
            after, fan = (k + 1) % SIDES, k[1:-1]
            corners = [(k, after, after + SIDES), (k, after + SIDES, k + SIDES)]
            corners += [(0 * fan, fan + 1, fan), (0 * fan + SIDES, fan + SIDES, fan + 1 + SIDES)]
            faces = np.concatenate([np.stack(triangle, axis=1).ravel() for triangle in corners])
            around = {"POSITION": writer.add_array(surface, target=VERTICES)}
            triangles = {"attributes": around, "mode": TRIANGLES, "material": number}
            primitives.append({**triangles, "indices": writer.add_array(faces, UINT16, INDICES)})
        look = {"baseColorFactor": BLUE if kind == "cable" else BROWN, "metallicFactor": 0.0}
        writer.content["materials"].append({"name": kind, "pbrMetallicRoughness": look})
        writer.content["meshes"].append({"name": kind, "primitives": primitives})
    return kinds


def _animate(writer: _Writer, shapes: Shapes, paths: list[tuple[int, str, FloatArray]]) -> None:
    """Add the animation; constant values have no channel."""
    time = shapes.time.astype(np.float32)
    if not (np.diff(time) > 0).all():
        raise InvalidValueError(
            "samples have the same time in single precision, which the format has",
            where="trajectory",
            given=f"{len(time)} samples from {time[0]:g} to {time[-1]:g} s",
            allowed="times that increase",
        )
    animation: dict[str, Any] = {"name": shapes.structure.name, "samplers": [], "channels": []}
    start = writer.add_array(time)
    for node, key, values in paths:
        if (values != values[0]).any():
            target = {"sampler": len(animation["samplers"]), "target": {"node": node, "path": key}}
            animation["channels"].append(target)
            animation["samplers"].append({"input": start, "output": writer.add_array(values)})
    if animation["channels"]:
        writer.content["animations"] = [animation]


def _compute_rotations(direction: FloatArray) -> FloatArray:
    """Return unit quaternions (n_t, n_members, 4), x y z w, that turn y to directions (n_t, n_members, 3).

    Each sample turns the one before by the shortest way, so that between samples nothing spins about itself.
    """
    turned = np.empty((*direction.shape[:2], 4))
    is_down = direction[0, :, 1:2] < 0  # begins with half a turn about x, far from which rounding is least
    before = np.where(is_down, (0.0, -1.0, 0.0), (0.0, 1.0, 0.0))
    rotation = np.where(is_down, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    for sample, after in enumerate(direction):
        # Half of the rotation from one unit vector to the other; about x or z where they are opposite
        step = np.concatenate([np.cross(before, after), 1.0 + (before * after).sum(axis=1)[:, None]], axis=1)
        back = np.linalg.norm(step, axis=1) < 1e-7
        aside = np.where(np.abs(before[:, :1]) < 0.9, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
        step[back, :3] = np.cross(before, aside)[back]
        a, b, v, w = step[:, :3], rotation[:, :3], step[:, 3:], rotation[:, 3:]
        vector = v * b + w * a + np.cross(a, b)
        rotation = np.concatenate([vector, v * w - (a * b).sum(axis=1)[:, None]], axis=1)
        rotation = rotation / np.linalg.norm(rotation, axis=1)[:, None]
        turned[sample], before = rotation, after
    return turned


EXPORTER = Exporter(
    name="gltf",
    title="bars and cables, and a motion as an animation, for viewers (glTF: .glb)",
    endings=(".glb",),
    write=write_gltf,
    options=("trajectory",),
    order=60,
)
