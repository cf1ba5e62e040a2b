"""Jacobians of the state derivative x' = (q', q'') whose upper half is zero."""

from typing import Any

import casadi as ca

from tensegrity_codegen.symbolic.arguments import SymbolicArguments
from tensegrity_codegen.system.errors import FormulationError

Matrix = Any


def below_zeros(matrix: Matrix, n_internal: int = 0) -> Matrix:
    """Return dx'/dy from dq''/dy (n, k): (n_states, k), zero elsewhere: q' and z' do not depend on y."""
    return ca.vertcat(ca.SX(*matrix.shape), matrix, ca.SX(n_internal, matrix.shape[1]))


def by_inputs(acceleration: Matrix, arguments: SymbolicArguments) -> Matrix:
    """Return dx'/du, sparse (n_states, n_inputs)."""
    return below_zeros(ca.jacobian(acceleration, arguments.symbols["input"]), _count_internal(arguments))


def by_parameters(slopes: Matrix, arguments: SymbolicArguments) -> Matrix:
    """Return dx'/dp to all run-time parameters, sparse (n_states, n_parameters); slopes: (q'', z')."""
    stacked = arguments.parameter_symbols()
    if stacked.numel() == 0:
        raise FormulationError(
            "parameter_jacobian needs run-time parameters, and the scene keeps none",
            where=f"{arguments.structure.name}: model.quantities",
            hint='name some under [parameters], for example rest_length = "all"',
        )
    upper = ca.SX(slopes.numel() - _count_internal(arguments), stacked.numel())
    return ca.vertcat(upper, ca.jacobian(slopes, stacked))


def _count_internal(arguments: SymbolicArguments) -> int:
    return len(arguments.structure.internal_name)
