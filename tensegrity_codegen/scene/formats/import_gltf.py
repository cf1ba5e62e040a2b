"""Import of lines from glTF 2.0 (.glb, .gltf): primitives of lines, at the places that their nodes give them.

Lines whose node, mesh or material has a name that begins with "bar" or "strut" become bars, or what the key
`kind` of a node's `extras` states; all other lines become cables. y is up in the file, z in the scene.
"""

import struct
from base64 import b64decode
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.checks.limits import MAX_ENTRIES
from tensegrity_codegen.scene.formats.files.documents import parse_json
from tensegrity_codegen.scene.formats.files.lines import Line, build_lines, is_bar
from tensegrity_codegen.scene.formats.format import Format
from tensegrity_codegen.scene.formats.imported import ImportResult, read_bytes
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import SceneSyntaxError

MAX_GLTF_BYTES = 128 * 2**20  # bytes
WHAT = "a scene of glTF 2.0 with its data in the same file"
MAGIC, JSON, BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942  # of a .glb file and its two chunks
LINES, LINE_LOOP, LINE_STRIP = 1, 2, 3
COMPONENTS = {5121: "<u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}


def import_gltf(
    path: str | Path,
    *,
    name: str | None = None,
    gravity: Sequence[float] | None = None,
    tolerance: float | None = None,
    axial_stiffness: float | None = None,
) -> ImportResult:
    """Return the scene document of the lines of a glTF file, and notes."""
    path = Path(path)
    data = read_bytes(path, MAX_GLTF_BYTES, WHAT)
    try:
        text, binary = _split(data) if data[:4] == struct.pack("<I", MAGIC) else (data, b"")
        file = _File(parse_json(text.decode("utf-8-sig"), path), binary)
        with np.errstate(all="ignore"):  # places are checked later
            lines, named = file.list_lines(str(path))
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, struct.error) as error:
        problem = f"the file cannot be read as glTF: {type(error).__name__}: {str(error)[:200]}"
        raise SceneSyntaxError(problem, where=str(path), allowed=WHAT) from error
    notes = ["y is up in the file: its (x, y, z) became (x, -z, y)"]
    return build_lines(lines, path, name, gravity, tolerance, axial_stiffness, named, notes)


def _split(data: bytes) -> tuple[bytes, bytes]:
    """Return the text and the data of a .glb file: two chunks behind 12 bytes, each with size and kind."""
    chunks, start = {}, 12
    while start < len(data):
        size, kind = struct.unpack_from("<II", data, start)
        chunks[kind] = data[start + 8 : start + 8 + size]
        if len(chunks[kind]) < size:
            raise ValueError("the file ends within a chunk")
        start += 8 + size
    return chunks[JSON], chunks.get(BINARY, b"")


class _File:
    """The content of a file; what is wrong in it raises one of Python's errors of values and look-ups."""

    def __init__(self, content: Any, binary: bytes) -> None:
        if not content["asset"]["version"].startswith("2."):
            raise ValueError(f"version {content['asset']['version']}")
        self.content, self.binary = content, binary
        self._decoded: dict[str, bytes] = {}
        self._ends: dict[int, list[tuple[FloatArray, tuple[str, str]]]] = {}  # of each mesh

    def entry(self, section: str, number: Any) -> dict[str, Any]:
        """Return an entry of a section."""
        if type(number) is not int or number < 0:
            raise ValueError(f"{section}: {number!r:.40} is not the number of an entry")
        value: dict[str, Any] = self.content[section][number]
        return value

    def list_lines(self, where: str) -> tuple[list[Line], dict[str, FloatArray]]:
        """Return all lines of the scene, and the places of nodes that are nothing but a place."""
        lines, named, seen = list[Line](), dict[str, FloatArray](), set[int]()
        roots = self.entry("scenes", self.content.get("scene", 0))["nodes"]
        waiting = [(number, np.eye(4)) for number in reversed(roots)]
        while waiting:
            number, above = waiting.pop()
            node, title = self.entry("nodes", number), str(self.entry("nodes", number).get("name", ""))
            if number in seen:
                raise ValueError(f"node {number} stands in the tree twice")
            seen.add(number)
            matrix, children = above @ _find_matrix(node), node.get("children", [])
            waiting += [(child, matrix) for child in reversed(children)]
            if "mesh" not in node:
                if title and not children and "camera" not in node:
                    named.setdefault(title, _turn(matrix[:3, 3]))
                continue
            if len(lines) > MAX_ENTRIES:
                break
            mesh = self.entry("meshes", node["mesh"])
            if node["mesh"] not in self._ends:
                self._ends[node["mesh"]] = self.list_ends(mesh)
            segments = self._ends[node["mesh"]]
            location, extras = f"{where}: meshes[{node['mesh']}]", node.get("extras")
            kind = extras.get("kind") if isinstance(extras, dict) else None
            for k, (ends, names) in enumerate(segments):
                bar = kind == "bar" if kind in ("bar", "cable") else is_bar(title, *names)
                label = f"{title}_{k + 1}" if title and len(segments) > 1 else title
                lines.append(Line(_turn(ends @ matrix[:3, :3].T + matrix[:3, 3]), bar, location, label))
        return lines, named

    def list_ends(self, mesh: dict[str, Any]) -> list[tuple[FloatArray, tuple[str, str]]]:
        """Return the ends (2, 3) of each line of a mesh, with the names of mesh and material."""
        segments = []
        for primitive in mesh["primitives"]:
            mode = primitive.get("mode", 4)
            if mode not in (LINES, LINE_LOOP, LINE_STRIP):
                continue
            positions = self.read_accessor(primitive["attributes"]["POSITION"], (5126,), 3)
            if "indices" in primitive:
                rows = self.read_accessor(primitive["indices"], (5121, 5123, 5125), 1)[:, 0]
            else:
                rows = np.arange(min(len(positions), 2 * MAX_ENTRIES + 2))
            rows = rows[: 2 * MAX_ENTRIES + 2]
            material = self.entry("materials", primitive["material"]) if "material" in primitive else {}
            names = str(mesh.get("name", "")), str(material.get("name", ""))
            second = np.roll(rows, -1) if mode == LINE_LOOP else rows[1:]
            pairs = np.stack([rows[: len(second)], second], axis=1)[:: 2 if mode == LINES else 1]
            segments += [(positions[pair].astype(float), names) for pair in pairs[: MAX_ENTRIES + 1]]
            if len(segments) > MAX_ENTRIES:
                break
        return segments

    def read_accessor(self, number: Any, components: tuple[int, ...], width: int) -> NDArray[Any]:
        """Return an array (count, width) of numbers of one of the kinds of components."""
        accessor = self.entry("accessors", number)
        if accessor["componentType"] not in components or "sparse" in accessor:
            raise ValueError(f"accessor {number} is sparse, or has other components than {components}")
        view, dtype = self.entry("bufferViews", accessor["bufferView"]), COMPONENTS[accessor["componentType"]]
        size = np.dtype(dtype).itemsize
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        strides = view.get("byteStride", width * size), size
        data, shape = self.read_buffer(view["buffer"]), (accessor["count"], width)
        if min(start, *shape) < 0 or strides[0] < width * size:
            raise ValueError(f"accessor {number} has a negative size, or a stride below that of an element")
        return np.ndarray(shape, dtype, data, start, strides)  # which checks that they lie in the buffer

    def read_buffer(self, number: Any) -> bytes:
        """Return the bytes of a buffer: the data of a .glb file, or those in base 64 in the text."""
        uri = self.entry("buffers", number).get("uri")
        if uri is None:
            return self.binary
        head, _, text = uri.partition(";base64,")
        if not head.startswith("data:"):
            raise ValueError(f"the data are in another file, {uri[:80]}")
        self._decoded[uri] = self._decoded.get(uri) or b64decode(text, validate=True)
        return self._decoded[uri]


def _turn(place: FloatArray) -> FloatArray:
    """Return places (..., 3) of the file in the scene."""
    turned: FloatArray = place[..., [0, 2, 1]] * (1.0, -1.0, 1.0) + 0.0  # no -0.0
    return turned


def _find_matrix(node: dict[str, Any]) -> FloatArray:
    """Return the matrix (4, 4) of a node: its own, column by column, or translation, rotation and scale."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=float).reshape(4, 4).T
    x, y, z, w = np.array(node.get("rotation", (0, 0, 0, 1)), dtype=float)
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.array(node.get("scale", (1, 1, 1)), dtype=float).reshape(3)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


FORMAT = Format(
    title="lines of a scene (glTF)", sources=("lines.glb",), endings=(".glb", ".gltf"), read=import_gltf,
    options=("tolerance", "axial_stiffness"), order=11,
)  # fmt: skip
