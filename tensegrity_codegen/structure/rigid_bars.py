"""Bars of a structure that keep their length in a formulation."""

import numpy as np

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import BoolArray
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.request import ModelRequest, complete_options


def find_rigid_bars(structure: Structure, request: ModelRequest) -> BoolArray:
    """Return (n_members,): the members that keep their length in the requested formulation."""
    if not find_formulation(request.formulation).has_rigid_bars:
        return np.zeros(structure.n_members, dtype=np.bool_)
    choice = complete_options(request.formulation, request.options)["bars"]
    return np.asarray(structure.is_rigid | (structure.is_bar & (choice == "all")))
