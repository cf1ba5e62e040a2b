"""Effects of the values of inputs on a structure: rest lengths and loads with them."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure


def add_inputs_to_rest_length(
    subject: Structure | BodySystem, values: Mapping[str, float]
) -> NDArray[np.float64]:
    """Return the rest lengths [m] with these values [m, K] of inputs, by name, (n_members,)."""
    rest_length = np.array(subject.rest_length)
    for entry in subject.inputs:
        for e, gain in entry.rest_length_gain.items() if entry.name in values else ():
            rest_length[e] += gain * values[entry.name]
    return rest_length


def find_input_force(structure: Structure, values: Mapping[str, float]) -> NDArray[np.float64]:
    """Return the forces of these values [N] of force inputs, by name, on all nodes, (n_nodes, 3) [N]."""
    force = np.zeros((structure.n_nodes, 3))
    for entry in structure.inputs:
        if entry.kind == "force" and entry.name in values:
            force[list(entry.targets)] += values[entry.name] * np.array(entry.direction)
    return force
