"""Results of libraries with other nodes or members, stored in one array: the union of their labels."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.sweeps.tasks.operation import Output
from tensegrity_codegen.system.errors import InvalidValueError


def join_outputs(parts: Sequence[tuple[Output, ...]]) -> tuple[Output, ...]:
    """Return outputs that hold the results of several libraries.

    Parameters
    ----------
    parts : sequence of tuple of Output
        Outputs of each library.

    Returns
    -------
    tuple of Output
        One for each name, in the order of first appearance. An axis with labels, such as nodes or members,
        has those of all libraries; cases that lack one have NAN there.

    Raises
    ------
    InvalidValueError
        Libraries differ in the size of an axis without labels, or in the axes of an output.
    """
    labels: dict[str, dict[Any, None]] = {}
    first: dict[str, Output] = {}
    for outputs in parts:
        for output in outputs:
            first.setdefault(output.name, output)
            for dim, names in output.coordinates.items():
                labels.setdefault(dim, {}).update(dict.fromkeys(names))
    joint = {name: _widen(output, labels) for name, output in first.items()}
    for outputs in parts:
        for output in outputs:
            _check_fits(output, joint[output.name])
    return tuple(joint.values())


def _widen(output: Output, labels: dict[str, dict[Any, None]]) -> Output:
    coordinates = {dim: tuple(labels[dim]) for dim in output.coordinates}
    sizes = zip(output.dims, output.shape, strict=True)
    shape = tuple(len(coordinates[dim]) if dim in coordinates else size for dim, size in sizes)
    return replace(output, shape=shape, coordinates=coordinates)


def _check_fits(output: Output, joint: Output) -> None:
    fixed = [k for k, dim in enumerate(output.dims) if dim not in joint.coordinates]
    if output.dims != joint.dims or any(output.shape[k] != joint.shape[k] for k in fixed):
        raise InvalidValueError(
            "results have another size in cases of another library",
            where="keep",
            given=f"{output.name}: {output.shape} and {joint.shape}",
            allowed="results with the same axes in all cases, or with names of nodes or members",
            hint="keep numbers, such as max(member_tension), or sweep these cases by themselves",
        )


def find_places(own: Output, joint: Output) -> tuple[NDArray[np.int64], ...] | None:
    """Return where a library's results are along the axes of the joint ones; None: everywhere."""
    if own.shape == joint.shape and dict(own.coordinates) == dict(joint.coordinates):
        return None
    places = []
    for dim, size in zip(own.dims, own.shape, strict=True):
        if dim in joint.coordinates:
            at = {name: k for k, name in enumerate(joint.coordinates[dim])}
            places.append(np.array([at[name] for name in own.coordinates[dim]], dtype=np.int64))
        else:
            places.append(np.arange(size))
    return tuple(places)
