"""Input of the template of CasADi's interface: each function with its arguments, results and patterns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from tensegrity_codegen.codegen.casadi_interface.derivatives import MOST_ENTRIES, Derivative, Derivatives
from tensegrity_codegen.codegen.print.printer import print_body
from tensegrity_codegen.tables.manifest import Pattern

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
    """Return the functions of the interface: those of the library that CasADi can have, and derivatives.

    functions: what the template of the source reads of them.
    """
    plain = [_build_plain(scene, function) for function in functions if function["has_casadi_abi"]]
    derived = [
        _build_derived(scene, item)
        for item in derivatives.made
        if all(item.function.nnz_out(k) <= MOST_ENTRIES for k in range(item.function.n_out()))
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
    found = _build_entry(f"jac_{scene}_node_residual", arguments, results)
    return found | {"symbol": stiffness["symbol"], "is_negative": True}


def _build_derived(scene: str, item: Derivative) -> dict[str, Any]:
    made = item.function
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
    quantity = item.name.removeprefix(
        next((word for word in DERIVATIVE_PREFIXES if item.name.startswith(word)), "")
    )
    return _build_entry(name_symbol(scene, item.name), arguments, results, sum(sizes)) | {
        "symbol": "",
        "kernel": f"{item.name}_checked",
        "comment": f"{item.meaning} {quantity}: {item.operations} operations.",
        "lines": body.lines,
    }


def _find_pattern(sparsity: ca.Sparsity) -> list[int]:
    pattern = Pattern(sparsity.shape, sparsity.row(), sparsity.colind())
    return casadi_pattern(sparsity.shape, pattern)


def _build_entry(
    name: str, arguments: Sequence[_Port], results: Sequence[_Port], spare: int = 0
) -> dict[str, Any]:
    """Return what stands for one function; spare: values of results that CasADi may not want."""
    return {
        "name": name,
        "arguments": arguments,
        "results": results,
        "zeros": max((port.size for port in arguments if port.in_body), default=0),
        "spare": spare,
        "is_negative": False,
    }
