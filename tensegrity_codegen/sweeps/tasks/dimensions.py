"""Axes of quantities by name, with their labels: a result over `n_members` has the axis `member`."""

from typing import Any

from tensegrity_codegen.runtime.model.state_names import name_states
from tensegrity_codegen.sweeps.tasks.operation import Output
from tensegrity_codegen.tables.manifest import FunctionSpec, Manifest
from tensegrity_codegen.tables.precision import find_precision
from tensegrity_codegen.tables.quantities import QUANTITIES

AXES = ("x", "y", "z")


def describe_quantity(manifest: Manifest, spec: FunctionSpec) -> Output:
    """Return one quantity of a library as an output; sparse matrices become dense arrays."""
    row = QUANTITIES[spec.quantity]
    dims: list[str] = []
    labels: dict[str, tuple[Any, ...]] = {}
    for word, size in zip(row.shape, spec.shape, strict=True):
        dim, names = label_axis(manifest, word, spec.quantity)
        while dim in dims:  # columns of a square matrix
            dim = f"{dim}_column"
        dims.append(dim)
        if len(names) == size:
            labels[dim] = names
    return Output(
        name=spec.quantity,
        dims=tuple(dims),
        shape=tuple(spec.shape),
        dtype=real_dtype(manifest),
        unit=spec.unit,
        sentence=spec.sentence,
        coordinates=labels,
    )


def label_axis(manifest: Manifest, word: str, quantity: str) -> tuple[str, tuple[str, ...]]:
    """Return name and labels of an axis that the table of quantities calls `word`, such as "n_members"."""
    names: dict[str, tuple[str, ...]] = {
        "n_nodes": manifest.node_name,
        "n_members": manifest.member_name,
        "n_coordinates": manifest.coordinate_name,
        "n_states": name_states(manifest),
        "n_inputs": manifest.input_name,
        "n_bar_pairs": manifest.bar_pair_name,
        "n_axes": tuple(AXES[axis] for axis in manifest.axes),
    }
    if word == "n_axes":  # axes of planar scenes are fewer than those of positions in space
        return "axis" if len(manifest.axes) == len(AXES) else "plane_axis", names[word]
    return _name_axis(word, quantity), names.get(word, ())


def _name_axis(word: str, quantity: str) -> str:
    if word.startswith("n_"):
        return word.removeprefix("n_").removesuffix("s").replace("switche", "switch")
    return f"{quantity}_{word}"


def list_axis_names() -> frozenset[str]:
    """Return the names that axes of any quantity of any structure have."""
    names = {_name_axis(word, name) for name, row in QUANTITIES.items() for word in row.shape}
    names |= {"axis", "plane_axis", "mode"}
    return frozenset(names | {f"{name}_column" for name in names})


def real_dtype(manifest: Manifest) -> str:
    """Return the type of the library's numbers, "float64" or "float32"."""
    return str(find_precision(manifest.precision).dtype)
