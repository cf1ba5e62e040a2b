"""How the example program names the entries of a result: by nodes, members, coordinates and inputs."""

from collections.abc import Mapping
from typing import Any

from tensegrity_codegen.tables.manifest import FunctionSpec, Manifest
from tensegrity_codegen.tables.quantities import QUANTITIES

INDEX = {"format": "[%d]", "value": "@"}


def label_entries(manifest: Manifest, spec: FunctionSpec) -> Mapping[str, Any]:
    """Return how C prints the place of an entry of a result.

    Each label has the `format` of printf and the `value` that it takes, with @ for the index. A matrix has
    the labels `rows` and `columns`, any other result has `entries`.
    """
    sizes = {
        "node": len(manifest.node_name),
        "member": len(manifest.member_name),
        "coordinate": len(manifest.coordinate_name),
        "input": len(manifest.input_name),
        "bar_pair": len(manifest.bar_pair),
    }
    shape = QUANTITIES[spec.quantity].shape
    if spec.pattern is not None:
        rows, columns = spec.pattern.shape
        return {
            "rows": _label(manifest, shape[0], rows, sizes),
            "columns": _label(manifest, shape[1], columns, sizes),
        }
    if len(spec.shape) == 2:
        return {"rows": None, "entries": _label_vectors(manifest, shape[0], spec.shape, sizes)}
    if not spec.shape:
        return {"rows": None, "entries": {"format": "value", "value": ""}}
    return {"rows": None, "entries": _label(manifest, shape[0], spec.shape[0], sizes)}


def _label(manifest: Manifest, dimension: str, count: int, sizes: Mapping[str, int]) -> Mapping[str, str]:
    """Return the label of an index that runs over a dimension of the table of quantities."""
    kind = dimension.removeprefix("n_").removesuffix("s")
    if sizes.get(kind) == count and count:
        return {"format": "%s", "value": f"{manifest.name}_{kind}_name[@]"}
    n = sizes["coordinate"]
    if kind == "state" and count == 2 * n and n:
        name = f"{manifest.name}_coordinate_name[@ % {n}]"
        return {"format": "%s%s", "value": f'{name}, @ < {n} ? "" : "\'"'}
    return INDEX


def _label_vectors(
    manifest: Manifest, dimension: str, shape: tuple[int, ...], sizes: Mapping[str, int]
) -> Mapping[str, str]:
    """Return the label of an entry of a table of vectors, whose rows run over a dimension."""
    count, width = shape
    kind = dimension.removeprefix("n_").removesuffix("s")
    if sizes.get(kind) != count or not count or width != len(manifest.axes):
        return INDEX
    axes = "".join("xyz"[axis] for axis in manifest.axes)
    value = f'{manifest.name}_{kind}_name[@ / {width}], "{axes}"[@ % {width}]'
    return {"format": "%s_%c", "value": value}
