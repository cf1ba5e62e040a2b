"""Comparing results entry by entry, at a scale that belongs to the quantity."""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from tensegrity_codegen.codegen.emitter import PrunedFunction
from tensegrity_codegen.structure.structure import Structure

Array = NDArray[np.float64]


def dense(value: Any) -> Array:
    """Return a float, array or sparse matrix as a plain array."""
    return value.toarray() if sparse.issparse(value) else np.atleast_1d(np.asarray(value, dtype=float))


def run_in_casadi(function: PrunedFunction, arguments: dict[str, Array]) -> Array:
    """Evaluate a pruned function in CasADi's virtual machine, in the shape of the quantity."""
    values = [np.asarray(arguments[name]).T for name in function.arguments]
    (result,) = function.function.call([ca.DM(value) for value in values])
    if function.quantity.sparse:
        return np.array(ca.densify(result))
    return np.array(result).T.reshape(-1) if len(function.quantity.shape) < 2 else np.array(result).T


def largest_terms(structure: Structure) -> float:
    """Return a bound of the terms that enter forces: mu l, weights, loads [N]."""
    mu = structure.spring_constant + structure.axial_stiffness / structure.rest_length
    length = np.maximum(structure.member_length(), structure.rest_length)
    speed = np.abs(structure.node_velocity).max(initial=0.0)
    weight = (structure.node_mass.sum() + structure.member_mass.sum()) * np.abs(structure.gravity).max()
    terms = [(mu * length).max(), structure.damping.max() * speed, weight, np.abs(structure.node_load).max()]
    return float(max(terms))
