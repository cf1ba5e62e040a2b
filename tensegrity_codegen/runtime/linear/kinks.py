"""Cables exactly at their rest lengths: their stiffness jumps, a linear model holds on one side only."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import name_list

KINK_QUANTITIES = ("member_length", "member_extension")


def find_kinks(
    model: Model, coordinate: FloatArray, rounding: float, arguments: Mapping[str, Any]
) -> dict[str, bool]:
    """Return the cables that are at their rest lengths within rounding, with whether each counts as taut.

    rounding: difference of length and rest length that counts as such, over the largest of length, rest
    length and coordinates. None of a library without KINK_QUANTITIES, or that was loaded alone.
    """
    structure = getattr(model, "structure", None)
    if structure is None or structure.is_bar.all() or not all(model.has(name) for name in KINK_QUANTITIES):
        return {}
    given = {**arguments, "coordinate": coordinate}
    length = np.asarray(model.compute("member_length", **given))
    extension = np.asarray(model.compute("member_extension", **given))
    scale = np.maximum(np.maximum(length, length - extension), np.abs(coordinate).max(initial=0.0))
    at_rest = ~np.asarray(structure.is_bar) & (np.abs(extension) <= rounding * scale)
    return {model.manifest.member_name[row]: bool(extension[row] > 0.0) for row in np.flatnonzero(at_rest)}


def describe_kinks(kinks: Mapping[str, bool]) -> list[str]:
    """Return the warning about cables at their rest lengths, none without any."""
    sides = [
        f"as {word}: {name_list(names, 10)}"
        for word, is_taut in (("taut", True), ("slack", False))
        if (names := [name for name, taut in kinks.items() if taut is is_taut])
    ]
    if not sides:
        return []
    return [
        f"{len(kinks)} cable{'s are' if len(kinks) > 1 else ' is'} exactly at rest length, where the "
        f"stiffness jumps; the linear model holds on one side only. It treats {'; '.join(sides)}"
    ]
