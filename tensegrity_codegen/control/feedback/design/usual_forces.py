"""Forces that the tensions of a motion cause, from which estimators take how large disturbances are."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.named_inputs import INPUT
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.system.arrays import FloatArray

UNKNOWN = 0.1  # of the usual forces, by which disturbances change in a second


def find_usual_forces(model: CompiledModel, motion: Motion, given: Mapping[str, Any]) -> FloatArray:
    """Return the force of the largest tension on each coordinate, (n_coordinates,) [N or N m].

    given: run-time parameters where they differ from the scene; inputs as one array.
    """
    n = motion.coordinate.shape[1]
    at = {**given, "coordinate": motion.coordinate[-1], "velocity": np.zeros(n), INPUT: motion.input[-1]}
    matrix = model.compute("equilibrium_matrix", **at)
    dense = np.asarray(matrix.toarray() if hasattr(matrix, "toarray") else matrix)
    lever: FloatArray = np.linalg.norm(dense, axis=1)
    return float(np.abs(motion.member_tension).max(initial=0.0)) * lever
