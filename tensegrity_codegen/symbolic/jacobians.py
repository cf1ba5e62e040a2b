"""Jacobians of the state derivative x' = (q', q'') whose upper half is zero, and of quantities."""

from collections.abc import Iterable
from functools import partial
from typing import Any

import casadi as ca

from tensegrity_codegen.symbolic.arguments import SymbolicArguments
from tensegrity_codegen.symbolic.model import SymbolicModel
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.quantities import SLOPES

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


def add_slopes(model: SymbolicModel, wanted: Iterable[str]) -> None:
    """Offer wanted derivatives of quantities to all their arguments, in the order of their C functions."""

    def differentiate(quantity: str) -> ca.SX:
        value = ca.densify(ca.cse(model.expression(quantity)))
        return ca.jacobian(ca.vec(value), model.stack(model.arguments_of(value)))

    names = [name for name in wanted if SLOPES.get(name) in model.quantities]
    model.offer({name: partial(differentiate, SLOPES[name]) for name in names})


def _count_internal(arguments: SymbolicArguments) -> int:
    return len(arguments.structure.internal_name)
