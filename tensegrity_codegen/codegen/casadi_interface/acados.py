"""The functions that acados' integrators call, by the names of its templates.

The state is x = (q, q'), with internal states behind, the control u the inputs, p all run-time parameters,
stacked in argument order; there is no algebraic variable z and no time t. Arguments and results are those of
the generators of acados of explicit ordinary and implicit differential-algebraic equations.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from tensegrity_codegen.codegen.casadi_interface.derivatives import Derivative
from tensegrity_codegen.codegen.unrolled import MOST_OPERATIONS, check_unrollable
from tensegrity_codegen.symbolic.model import SymbolicModel
from tensegrity_codegen.symbolic.operations import count_operations
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.quantities import PARAMETERS, STATE


@dataclass(frozen=True)
class _Equations:
    """The equations of motion x' = f(x, u, p) and their symbols."""

    x: ca.SX
    u: ca.SX
    p: ca.SX
    f: ca.SX


def build_acados(model: SymbolicModel) -> tuple[Derivative, ...]:
    """Return the functions of explicit and implicit integrators.

    Raises FormulationError where there is no acceleration, or the functions would be too long.
    """
    check_unrollable(model.subject)
    equations = _find_equations(model)
    made = []
    for name, symbols, results in (*_explicit(equations), *_implicit(equations)):
        shared = ca.cse(list(results.values()))
        function = ca.Function("acados", list(symbols.values()), shared, list(symbols), list(results))
        made.append(Derivative(name, 1, function, f"acados: {name}", count_operations(function)))
    total = sum(item.operations for item in made)
    if total > MOST_OPERATIONS:
        raise FormulationError(
            "the functions for acados are too long for unrolled code",
            where=f"{model.name}: model.interfaces",
            given=f"{total} operations",
            allowed=f"at most {MOST_OPERATIONS} operations",
            hint="use a smaller structure",
        )
    return tuple(made)


def _find_equations(model: SymbolicModel) -> _Equations:
    x, u, p = model.stack(STATE), model.stack(("input",)), model.stack(PARAMETERS)
    return _Equations(x, u, p, ca.densify(model.expression("state_derivative")))


def _explicit(e: _Equations) -> Sequence[tuple[str, dict[str, Any], dict[str, Any]]]:
    n_x, n_u = e.x.numel(), e.u.numel()
    s_x, s_u = ca.SX.sym("Sx", n_x, n_x), ca.SX.sym("Su", n_x, n_u)
    seed = ca.SX.sym("lambdaX", n_x)
    by_x, by_u = ca.jacobian(e.f, e.x), ca.jacobian(e.f, e.u)
    forward = {
        "f_expl": e.f,
        "vde_x": ca.densify(by_x @ s_x),
        "vde_u": ca.densify(by_u + by_x @ s_u),
    }
    adjoint = ca.densify(ca.jtimes(e.f, ca.vertcat(e.x, e.u), seed, True))
    return (
        ("expl_ode_fun", {"x": e.x, "u": e.u, "p": e.p}, {"f_expl": e.f}),
        ("expl_vde_forw", {"x": e.x, "Sx": s_x, "Su": s_u, "u": e.u, "p": e.p}, forward),
        ("expl_vde_adj", {"x": e.x, "lambdaX": seed, "u": e.u, "p": e.p}, {"adj": adjoint}),
    )


def _implicit(e: _Equations) -> Sequence[tuple[str, dict[str, Any], dict[str, Any]]]:
    rate = ca.SX.sym("xdot", e.x.numel())
    residual = rate - e.f
    none = ca.SX.sym("none", 0, 1)
    symbols: Mapping[str, Any] = {
        "x": e.x,
        "xdot": rate,
        "u": e.u,
        "z": none,
        "t": ca.SX.sym("t", 0, 1),
        "p": e.p,
    }
    fun = {"f_impl": residual}
    by_x = {"jac_x": ca.jacobian(residual, e.x)}
    by_rate = {"jac_xdot": ca.jacobian(residual, rate)}
    by_u = {"jac_u": ca.jacobian(residual, e.u)}
    by_z = {"jac_z": ca.SX(e.x.numel(), 0)}
    return tuple(
        (f"impl_dae_{name}", dict(symbols), results)
        for name, results in (
            ("fun", fun),
            ("fun_jac_x_xdot_z", fun | by_x | by_rate | by_z),
            ("fun_jac_x_xdot_u_z", fun | by_x | by_rate | by_u | by_z),
            ("fun_jac_x_xdot_u", fun | by_x | by_rate | by_u),
            ("jac_x_xdot_u_z", by_x | by_rate | by_u | by_z),
        )
    )
