"""Use of the limits of members by each case."""

import numpy as np

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.structure.member_limits import check_members
from tensegrity_codegen.sweeps.tasks.case_arguments import CaseArguments
from tensegrity_codegen.system.arrays import FloatArray

LIMIT_USE = "limit_use"
OF_STIFFNESS = ("spring_constant", "axial_stiffness", "rest_length")
BEYOND = "members buckle, are strained by more than 1 %, or exceed a limit"
LIMIT_USE_RESULT = (
    "float64",
    "1",
    "Largest part that a member uses of its limits, of Euler's load and of 1 % strain; above 1: exceeded.",
)


def compute_limit_use(
    model: CompiledModel, given: CaseArguments, rows: slice, tension: FloatArray, length: FloatArray
) -> FloatArray:
    """Return the largest use of a limit in each case, (count,); NaN with a library that was loaded alone.

    rows: the cases, of those in `given`; tension, length: (count, ..., n_members) [N, m].
    """
    structure, count = model.structure, len(tension)
    if structure is None or not structure.n_members:
        return np.full(count, np.nan)
    values = {name: getattr(structure, name) for name in OF_STIFFNESS}
    for item in model.manifest.arguments:
        if item.name in values and item.name in given.all:
            array = np.tile(values[item.name], (count, 1))
            places = [structure.member_name.index(name) for name in item.over]
            array[:, places] = (
                given.rows[item.name][rows] if item.name in given.rows else given.shared[item.name]
            )
            values[item.name] = array
    elastic = values["axial_stiffness"] + values["spring_constant"] * values["rest_length"]
    if elastic.ndim == 2:
        elastic = elastic.reshape(count, *(1,) * (tension.ndim - 2), -1)
    use = check_members(structure, tension, length, elastic=elastic).largest_use
    return np.asarray(np.fmax.reduce(use.reshape(count, -1), axis=1))
