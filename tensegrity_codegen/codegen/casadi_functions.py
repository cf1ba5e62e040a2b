"""Functions that CasADi and acados call: derivatives of the library's functions, and equations of motion.

For a function `f` of the arguments x casadi.external looks up, with second derivatives requested,

- `jac_f(x, out_f)`: the sparse Jacobians to each argument,
- `adj1_f(x, out_f, adj_f)`: the products of the transposed Jacobians with `adj_f`,
- `jac_adj1_f(x, out_f, adj_f, out_adj_x)`: the Jacobians of these products, the Hessian of `adj_f' f`.

There is no `fwd1_f`: CasADi multiplies the sparse Jacobian instead, and its solvers never call it. If a
structure is too large for such code, the Jacobian of the static force is its stiffness, with the other sign.

acados: the state is x = (q, q'), with internal states behind, the control u the inputs, p all run-time
parameters, stacked in argument order; there is no algebraic variable z and no time t. Arguments and results
are those of its generators of explicit ordinary and implicit differential-algebraic equations.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from tensegrity_codegen.codegen.emitter import EmittedModel, PrunedFunction, WantedFunction
from tensegrity_codegen.codegen.print.printer import print_body
from tensegrity_codegen.codegen.unrolled import MAX_MEMBERS, MAX_OPERATIONS, check_unrollable
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.symbolic.model import SymbolicModel, count_operations
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.manifest import Pattern, SourcePart
from tensegrity_codegen.tables.quantities import PARAMETERS, STATE
from tensegrity_codegen.tables.request import ModelRequest


@dataclass(frozen=True)
class Derivative:
    """One derivative: its name without the scene's, its order, its expressions, its meaning.

    The arguments and results of `function` have the names and sparsities that CasADi expects.
    """

    name: str
    order: int
    function: ca.Function
    meaning: str
    operations: int


@dataclass(frozen=True)
class Derivatives:
    """The derivatives of a library, and the names of those that are too long for it.

    stiffness: the function whose result is the Jacobian of the static force with the other sign, where that
    has no code of its own.
    """

    made: tuple[Derivative, ...] = ()
    too_long: tuple[str, ...] = ()
    stiffness: WantedFunction | None = None


NO_DERIVATIVES = Derivatives()
TOO_LONG = "too long for unrolled code: "
# Entries of a pattern that casadi.external is told: it wants them a second time, which takes compilers long.
MAX_ENTRIES = 200_000
CASADI_INTERFACES = ("casadi", "casadi_hessian")  # interfaces of casadi.external


@dataclass(frozen=True)
class _Wanted:
    """A derivative to be built: of which function, under which prefix, of which order."""

    function: WantedFunction
    prefix: str
    order: int

    @property
    def name(self) -> str:
        return self.prefix + self.function.quantity.name


def needed_stiffness(structure: Subject, request: ModelRequest) -> tuple[str, ...]:
    """Return the name of the stiffness, where that is to be the Jacobian of the static force, or nothing."""
    is_wanted = (
        set(request.interfaces).intersection(CASADI_INTERFACES) and "node_residual" in request.quantities
    )
    is_large = structure.n_members > MAX_MEMBERS
    if not is_wanted or not is_large or request.parameters or structure.inputs:
        return ()
    return ("tangent_stiffness",)


def build_derivatives(
    model: EmittedModel, request: ModelRequest, functions: Sequence[WantedFunction]
) -> Derivatives:
    """Return the derivatives that the interfaces of a request ask for."""
    if not set(request.interfaces).intersection(CASADI_INTERFACES):
        return NO_DERIVATIVES
    requested = _list_wanted(functions, "casadi_hessian" in request.interfaces)
    if model.subject.n_members > MAX_MEMBERS:
        stiffness = _find_stiffness(functions)
        missing = [
            derivative.name
            for derivative in requested
            if stiffness is None or derivative.name != "jac_node_residual"
        ]
        return Derivatives(too_long=tuple(missing), stiffness=stiffness)
    symbolic = model if isinstance(model, SymbolicModel) else build_model(model.subject, request)
    remaining_operations = MAX_OPERATIONS - sum(f.written_operations for f in functions)
    made: list[Derivative] = []
    too_long: list[str] = []
    for derivative in requested:
        built = _derive(_as_casadi(symbolic, derivative.function), derivative)
        if built.operations <= remaining_operations:
            remaining_operations -= built.operations
            made.append(built)
        else:
            too_long.append(derivative.name)
    return Derivatives(tuple(made), tuple(too_long))


def list_derivative_parts(request: ModelRequest, derivatives: Derivatives) -> tuple[SourcePart, ...]:
    """Return the entries of the manifest's list of parts for derivatives, if there is CasADi."""
    if not set(request.interfaces).intersection(CASADI_INTERFACES):
        return ()
    return (
        _describe_part("casadi_derivatives", 1, ("casadi", "casadi_hessian"), request, derivatives),
        _describe_part("casadi_second_derivatives", 2, ("casadi_hessian",), request, derivatives),
    )


def _describe_part(
    name: str, order: int, interfaces: Sequence[str], request: ModelRequest, derivatives: Derivatives
) -> SourcePart:
    requested = [interface for interface in interfaces if interface in request.interfaces]
    if not requested:
        return SourcePart(name, False, f"interfaces does not name {' or '.join(interfaces)}")
    count = sum(derivative.order == order for derivative in derivatives.made)
    count += order == 1 and derivatives.stiffness is not None
    why = f"interfaces names {', '.join(requested)}: {count} {'function' if count == 1 else 'functions'}"
    if order == 1 or not count:  # lists what is missing once
        names = ", ".join(derivatives.too_long)
        why += f"; {TOO_LONG}{names}" if names else ""
    return SourcePart(name, bool(count), why)


def _list_wanted(functions: Sequence[WantedFunction], with_second: bool) -> list[_Wanted]:
    """Return the derivatives to build: a matrix is a derivative already, its Jacobian a second one."""
    some = [f for f in functions if f.arguments]
    derivatives = [_Wanted(f, "jac_", 1) for f in some if not f.quantity.sparse]
    if with_second:
        for f in some:
            prefixes = ("jac_",) if f.quantity.sparse else ("adj1_", "jac_adj1_")
            derivatives += [_Wanted(f, prefix, 2) for prefix in prefixes]
    return derivatives


def _find_stiffness(functions: Sequence[WantedFunction]) -> WantedFunction | None:
    """Return the stiffness if it has the arguments of the static force, and CasADi can have it."""
    by_quantity = {f.quantity.name: f for f in functions}
    residual, stiffness = by_quantity.get("node_residual"), by_quantity.get("tangent_stiffness")
    if residual is None or stiffness is None or stiffness.pattern is None:
        return None
    is_same = residual.arguments == stiffness.arguments == ("coordinate",)
    return stiffness if is_same and len(stiffness.pattern.row) <= MAX_ENTRIES else None


def _as_casadi(model: SymbolicModel, function: WantedFunction) -> ca.Function:
    """Return a function as a CasADi function, with the same arguments."""
    if isinstance(function, PrunedFunction):
        return function.function
    name = function.quantity.name
    expression = model.expression(name)
    if not function.quantity.sparse:
        expression = ca.densify(expression)
    symbols = [model.arguments[argument].symbol for argument in function.arguments]
    return ca.Function(name, symbols, [ca.cse(expression)], list(function.arguments), [name])


def _derive(function: ca.Function, derivative: _Wanted) -> Derivative:
    derived = function if derivative.prefix == "jac_" else function.reverse(1)
    if derivative.prefix != "adj1_":
        derived = derived.jacobian()
    symbols = derived.sx_in()
    results = ca.cse(derived.call(symbols))
    shared = ca.Function("derivative", symbols, results, derived.name_in(), derived.name_out())
    return Derivative(
        derivative.name, derivative.order, shared, MEANING[derivative.prefix], count_operations(shared)
    )


# The meaning of a derivative, before the name of its quantity.
MEANING = {
    "jac_": "Jacobians of",
    "adj1_": "Transposed Jacobians, times a vector, of",
    "jac_adj1_": "Second derivatives, times a vector, of",
}


DERIVATIVE_PREFIXES = ("jac_adj1_", "adj1_", "jac_")  # of the names of derivatives, the longest first


@dataclass(frozen=True)
class _Port:
    """One argument or result: its place, name, number of values and pattern.

    in_body: whether the C body reads or writes it; offset: where it has spare memory in the work array.
    """

    place: int
    name: str
    size: int
    pattern: list[int]
    in_body: bool = True
    offset: int = 0


def casadi_pattern(shape: tuple[int, int], pattern: Pattern | None) -> list[int]:
    """Return a sparsity as CasADi reads it: rows, columns, then 1 if dense, else column starts and rows."""
    rows, columns = shape
    if pattern is None or len(pattern.row) == rows * columns:
        return [rows, columns, 1]
    return [rows, columns, *pattern.column_start.tolist(), *pattern.row.tolist()]


def name_symbol(scene: str, name: str) -> str:
    """Return the C name of a function or derivative, `jac_SCENE_QUANTITY` for `jac_QUANTITY`."""
    for prefix in DERIVATIVE_PREFIXES:
        if name.startswith(prefix):
            return f"{prefix}{scene}_{name.removeprefix(prefix)}"
    return f"{scene}_{name}"


def casadi_context(
    scene: str, functions: Sequence[Mapping[str, Any]], derivatives: Derivatives
) -> list[dict[str, Any]]:
    """Return the functions of the interface: those of the library that CasADi can have, and derivatives."""
    plain = [_build_plain(scene, function) for function in functions if function["has_casadi_abi"]]
    derived = [
        _build_derived(scene, derivative)
        for derivative in derivatives.made
        if all(derivative.function.nnz_out(k) <= MAX_ENTRIES for k in range(derivative.function.n_out()))
    ]
    if derivatives.stiffness is not None:
        (stiffness,) = (f for f in functions if f["quantity"] == derivatives.stiffness.quantity.name)
        derived.append(_build_from_stiffness(scene, stiffness, derivatives.stiffness.shape[0]))
    return [*plain, *derived]


def _build_plain(scene: str, function: Mapping[str, Any]) -> dict[str, Any]:
    arguments = [
        _Port(k, a["name"], a["size"], a["casadi_pattern"]) for k, a in enumerate(function["arguments"])
    ]
    results = [_Port(0, function["quantity"], function["size"], function["casadi_pattern"])]
    return _build_entry(f"{scene}_{function['quantity']}", arguments, results) | {
        "symbol": function["symbol"]
    }


def _build_from_stiffness(scene: str, stiffness: Mapping[str, Any], size: int) -> dict[str, Any]:
    """Return the Jacobian of the static force as the stiffness with the other sign."""
    arguments = [
        _Port(0, "coordinate", size, [size, 1, 1]),
        _Port(1, "out_node_residual", size, [size, 1, 1], in_body=False),
    ]
    results = [_Port(0, "jac_node_residual_coordinate", stiffness["size"], stiffness["casadi_pattern"])]
    entry = _build_entry(f"jac_{scene}_node_residual", arguments, results)
    return entry | {"symbol": stiffness["symbol"], "is_negative": True}


def _build_derived(scene: str, derivative: Derivative) -> dict[str, Any]:
    made = derivative.function
    body = print_body(made, made.name_in(), made.name_out())
    arguments = [
        _Port(k, made.name_in(k), made.nnz_in(k), _find_pattern(made.sparsity_in(k)), k in body.reads)
        for k in range(made.n_in())
    ]
    zeros = max((port.size for port in arguments if port.in_body), default=0)
    sizes = [made.nnz_out(k) for k in range(made.n_out())]
    results = [
        _Port(
            k, made.name_out(k), size, _find_pattern(made.sparsity_out(k)), size > 0, zeros + sum(sizes[:k])
        )
        for k, size in enumerate(sizes)
    ]
    quantity = derivative.name.removeprefix(
        next((prefix for prefix in DERIVATIVE_PREFIXES if derivative.name.startswith(prefix)), "")
    )
    return _build_entry(name_symbol(scene, derivative.name), arguments, results, sum(sizes)) | {
        "symbol": "",
        "kernel": f"{derivative.name}_checked",
        "comment": f"{derivative.meaning} {quantity}: {derivative.operations} operations.",
        "lines": body.lines,
    }


def _find_pattern(sparsity: ca.Sparsity) -> list[int]:
    pattern = Pattern(sparsity.shape, sparsity.row(), sparsity.colind())
    return casadi_pattern(sparsity.shape, pattern)


def _build_entry(
    name: str, arguments: Sequence[_Port], results: Sequence[_Port], spare: int = 0
) -> dict[str, Any]:
    """Return the template context of one function; spare: values of results that CasADi may not want."""
    return {
        "name": name,
        "arguments": arguments,
        "results": results,
        "zeros": max((port.size for port in arguments if port.in_body), default=0),
        "spare": spare,
        "is_negative": False,
    }


def build_acados(model: SymbolicModel) -> tuple[Derivative, ...]:
    """Return the functions of explicit and implicit integrators."""
    check_unrollable(model.subject)
    # x' = f(x, u, p)
    x, u, p = model.stack(STATE), model.stack(("input",)), model.stack(PARAMETERS)
    f = ca.densify(model.expression("state_derivative"))
    made = []
    for name, symbols, results in (*_explicit(x, u, p, f), *_implicit(x, u, p, f)):
        shared = ca.cse(list(results.values()))
        function = ca.Function("acados", list(symbols.values()), shared, list(symbols), list(results))
        made.append(Derivative(name, 1, function, f"acados: {name}", count_operations(function)))
    total = sum(derivative.operations for derivative in made)
    if total > MAX_OPERATIONS:
        raise FormulationError(
            "the functions for acados are too long for unrolled code",
            where=f"{model.name}: model.interfaces",
            given=f"{total} operations",
            allowed=f"at most {MAX_OPERATIONS} operations",
            hint="use a smaller structure",
        )
    return tuple(made)


AcadosFunction = tuple[str, dict[str, Any], dict[str, Any]]  # name, arguments, results


def _explicit(x: ca.SX, u: ca.SX, p: ca.SX, f: ca.SX) -> Sequence[AcadosFunction]:
    n_x, n_u = x.numel(), u.numel()
    s_x, s_u = ca.SX.sym("Sx", n_x, n_x), ca.SX.sym("Su", n_x, n_u)
    seed = ca.SX.sym("lambdaX", n_x)
    by_x, by_u = ca.jacobian(f, x), ca.jacobian(f, u)
    forward = {"f_expl": f, "vde_x": ca.densify(by_x @ s_x), "vde_u": ca.densify(by_u + by_x @ s_u)}
    adjoint = ca.densify(ca.jtimes(f, ca.vertcat(x, u), seed, True))
    return (
        ("expl_ode_fun", {"x": x, "u": u, "p": p}, {"f_expl": f}),
        ("expl_vde_forw", {"x": x, "Sx": s_x, "Su": s_u, "u": u, "p": p}, forward),
        ("expl_vde_adj", {"x": x, "lambdaX": seed, "u": u, "p": p}, {"adj": adjoint}),
    )


def _implicit(x: ca.SX, u: ca.SX, p: ca.SX, f: ca.SX) -> Sequence[AcadosFunction]:
    rate = ca.SX.sym("xdot", x.numel())
    residual = rate - f
    z, t = ca.SX.sym("none", 0, 1), ca.SX.sym("t", 0, 1)
    symbols: Mapping[str, Any] = {"x": x, "xdot": rate, "u": u, "z": z, "t": t, "p": p}
    fun = {"f_impl": residual}
    by_x = {"jac_x": ca.jacobian(residual, x)}
    by_rate = {"jac_xdot": ca.jacobian(residual, rate)}
    by_u = {"jac_u": ca.jacobian(residual, u)}
    by_z = {"jac_z": ca.SX(x.numel(), 0)}
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
