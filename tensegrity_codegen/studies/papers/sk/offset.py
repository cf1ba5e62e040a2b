"""Generated expressions evaluated in another floating-point type, operation by operation.

The same operations in the same order as the generated C, each rounded to the type: what C code with another
`double` would compute.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.codegen.emitter import PrunedFunction, prune
from tensegrity_codegen.report.number_text import format_number
from tensegrity_codegen.report.pages.diagram import Diagram, Series, find_style
from tensegrity_codegen.report.pages.page import Paragraph, Remark, Section, diagram_figure
from tensegrity_codegen.report.pages.page_table import Table, make_table
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.papers.sk.motion import compile_in, sample_prism
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.symbolic.model import SymbolicModel
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest

ANALYSES: dict[int, Callable[..., Any]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_NEG: np.negative,
    ca.OP_TWICE: lambda a: a + a,
    ca.OP_SQ: np.square,
    ca.OP_INV: np.reciprocal,
    ca.OP_SQRT: np.sqrt,
    ca.OP_FABS: np.abs,
    ca.OP_FMIN: np.fmin,
    ca.OP_FMAX: np.fmax,
    ca.OP_LT: lambda a, b: type(a)(a < b),
    ca.OP_LE: lambda a, b: type(a)(a <= b),
    ca.OP_AND: lambda a, b: type(a)(bool(a) and bool(b)),
    ca.OP_OR: lambda a, b: type(a)(bool(a) or bool(b)),
    ca.OP_NOT: lambda a: type(a)(not a),
    ca.OP_IF_ELSE_ZERO: lambda a, b: b if a else type(b)(0),
}


def evaluate_in(
    number: type[np.floating[Any]], function: PrunedFunction, arguments: Mapping[str, ArrayLike]
) -> NDArray[Any]:
    """Return the entries of a quantity, column by column, computed in the type `number`.

    number: np.float32, np.float64 or np.longdouble; arguments: name -> values, in the shape of the argument.
    Divisions by zero give infinities and NaN.
    """
    code = function.function
    inputs = [np.ravel(np.asarray(arguments[name], dtype=number)) for name in function.arguments]
    memory: dict[int, Any] = {}
    result = np.zeros(code.nnz_out(0), dtype=number)
    with np.errstate(all="ignore"):
        for k in range(code.n_instructions()):
            operation, read, written = (
                code.instruction_id(k),
                code.instruction_input(k),
                code.instruction_output(k),
            )
            if operation == ca.OP_INPUT:
                memory[written[0]] = inputs[read[0]][read[1]]
            elif operation == ca.OP_OUTPUT:
                result[written[1]] = memory[read[0]]
            elif operation == ca.OP_CONST:
                memory[written[0]] = number(code.instruction_constant(k))
            else:
                if operation not in ANALYSES:
                    raise FormulationError(
                        "an operation of the expression has no meaning in other precisions yet",
                        where="precision",
                        given=operation,
                        allowed="sums, products, quotients, roots and comparisons",
                    )
                memory[written[0]] = ANALYSES[operation](*[memory[slot] for slot in read])
    return result


# Far from the origin and in single precision: what node positions lose, and node distances keep.
#
# A structure is moved by an offset along (1, 1, 1). In node positions r_i - r_j then has the rounding of the
# offset; differences as coordinates know nothing of it. Errors are relative to the largest exact value, which
# is computed at the origin with more digits.


STEP = 1e-3  # [s]
OFFSETS = (0.0, 1e3, 1e6, 1e9)
PRECISIONS: dict[str, type[np.floating[Any]]] = {"double": np.float64, "single": np.float32}


def compare_offsets(
    structure: Structure | None = None, offsets: Iterable[float] = OFFSETS
) -> list[dict[str, Any]]:
    """Return one row an offset and precision: errors of both formulations relative to the exact values.

    structure: a free prism, 1 mm off equilibrium, if not given. Rows hold offset [m], precision ("double" or
    "single") and `<formulation>_<quantity>`: the largest error over the largest exact value; None where
    nodes coincide in that precision, so that there is no result.
    """
    structure = structure or sample_prism(spread=1e-3)
    sides = {name: _Side(structure, name) for name in FORMULATIONS}
    rows = []
    for precision, number in PRECISIONS.items():
        for offset in offsets:
            row: dict[str, Any] = {"offset": float(offset), "precision": precision}
            for name, side in sides.items():
                for quantity in QUANTITIES:
                    row[f"{name}_{quantity}"] = side.error(quantity, float(offset), number)
            rows.append(row)
    return rows


class _Side:
    """One formulation of a structure, evaluated in any precision at any offset."""

    def __init__(self, structure: Structure, formulation: str) -> None:
        self.model: SymbolicModel = build_model(structure, ModelRequest((), formulation=formulation))
        self.functions: dict[str, PrunedFunction] = {
            function.quantity.name: function for function in prune(self.model, tuple(QUANTITIES))
        }
        self.exact = {name: self._values(name, 0.0, np.longdouble) for name in QUANTITIES}

    def error(self, quantity: str, offset: float, number: type[np.floating[Any]]) -> float | None:
        """Return the largest error relative to the largest exact value, None if it is not finite."""
        computed, exact = self._values(quantity, offset, number), self.exact[quantity]
        error = float(np.abs(computed - exact).max() / np.abs(exact).max())
        return error if np.isfinite(error) else None

    def _values(self, quantity: str, offset: float, number: type[np.floating[Any]]) -> np.ndarray:
        arguments = {name: argument.nominal for name, argument in self.model.arguments.items()}
        arguments["coordinate"] = _move(self.model, offset)
        return evaluate_in(number, self.functions[quantity], arguments)


def _move(model: SymbolicModel, offset: float) -> np.ndarray:
    """Return the nominal coordinates, the absolute ones among them moved by the offset in more digits."""
    frame, coordinate = model.frame, model.arguments["coordinate"].nominal.astype(np.longdouble)
    absolute = [
        bool(frame.coordinate_node_axis) or name.startswith("centre") for name in frame.coordinate_name
    ]
    return np.asarray(np.where(absolute, coordinate + np.longdouble(offset), coordinate))


def compare_offset_trajectories(
    offsets: Iterable[float] = OFFSETS, *, t_end: float = 1.0, samples: int = 101
) -> dict[str, Any]:
    """Return how far tensions of a simulation in double precision stray from those at the origin.

    Of a free prism. time (n_t,) [s]; then formulation -> offset -> (n_t,) largest
    difference of a member tension [N] from the run in node distances at the origin, with equal steps of
    Runge-Kutta 4 in C; a run in which nodes coincide at the start has no entry.
    """
    structure = sample_prism()
    models = {name: compile_in(structure, name) for name in FORMULATIONS}
    result: dict[str, Any] = {name: {} for name in FORMULATIONS}
    truth = simulate(
        models["node_distance"], t_end, samples=samples, method="rk4", stepping=Stepping(step=STEP)
    )
    for name, model in models.items():
        symbolic = build_model(structure, ModelRequest((), formulation=name))
        for offset in offsets:
            start = _move(symbolic, float(offset)).astype(np.float64)
            run = simulate(
                model, t_end, samples=samples, method="rk4", stepping=Stepping(step=STEP), coordinate=start
            )
            count = len(run.time)
            difference = np.abs(run.member_tension - truth.member_tension[:count])
            result[name][float(offset)] = difference.max(axis=1)
    return {"time": truth.time, "largest_tension": float(np.abs(truth.member_tension).max()), **result}


# Nodes leave the equilibrium by about this much [m], so that the accelerations are not zero.
DISPLACEMENT = 0.01
QUANTITIES = {"member_tension": "tension", "acceleration": "acceleration"}
FORMULATIONS = {"node_position": "positions", "node_distance": "distances"}


def offset_section() -> Section:
    """Return the section with errors at several offsets, in double and in single precision."""
    prism = sample_prism()
    change = np.random.default_rng(1).normal(scale=DISPLACEMENT, size=prism.node_position.shape)
    rows = compare_offsets(prism.with_changes(node_position=prism.node_position + change))
    motion = compare_offset_trajectories()
    double_row = [row for row in rows if row["precision"] == "double"][-1]
    worst, best = (double_row[f"{name}_acceleration"] for name in FORMULATIONS)
    return Section(
        "sk-offset",
        "beyond",
        "Far from the origin and in single precision",
        "new",
        f"at {_metres(double_row['offset'])}: error {format_number(worst, '.0e')} in positions, "
        f"{format_number(best, '.0e')} in distances",
        (
            Paragraph(
                "A prism out of equilibrium is moved along (1, 1, 1). In node positions the difference "
                "of two large coordinates loses digits; node distances know nothing of the offset. The "
                "same expressions as in the generated C are evaluated operation by operation in each "
                "precision, and compared with extended precision at the origin."
            ),
            diagram_figure(
                "sk-offset-error",
                _error_diagram(rows),
                "Largest error of a member tension over the largest tension. In single precision nodes "
                "coincide at 10⁹ m.",
                "Error against offset, both logarithmic: proportional to the offset in node positions, "
                "constant in node distances.",
            ),
            diagram_figure(
                "sk-offset-motion",
                _motion_diagram(motion),
                "A simulated motion in double precision: largest difference of a tension from the run at "
                f"the origin, largest tension {motion['largest_tension']:.1f} N.",
                "Difference of tensions over time: the larger the offset, the larger in node positions.",
            ),
            _error_table(rows),
            Remark(
                "new",
                "The paper does not claim this. In node distances the results are the same bit for bit "
                "at every offset, and single precision is usable; in node positions each factor of ten "
                "in the offset costs a digit.",
            ),
        ),
    )


def _error_diagram(rows: list[dict[str, Any]]) -> Diagram:
    """Return errors of the tension against the offset; the origin stands at 1 m on the logarithmic axis."""
    series = []
    for precision, style in (("double", "line"), ("single", "dashed")):
        chosen = [row for row in rows if row["precision"] == precision]
        offset = [max(row["offset"], 1.0) for row in chosen]
        for key, name in FORMULATIONS.items():
            error = np.array([row[f"{key}_member_tension"] for row in chosen], dtype=float)  # None: nan
            look = find_style(key)
            series.append(
                Series(f"{name}, {precision}", offset, error, style, look.color, look.marker)  # type: ignore[arg-type]
            )
    return Diagram(
        "offset [m] (0 shown at 1)", "relative error", series, log_x=True, log_y=True, legend_columns=2
    )


def _motion_diagram(motion: dict[str, Any]) -> Diagram:
    time = np.asarray(motion["time"])
    series = [
        Series(f"positions, {_metres(offset)}", time[1 : len(values)], values[1:], color=color)
        for color, (offset, values) in enumerate(motion["node_position"].items())
        if offset > 0
    ]
    return Diagram("time [s]", "difference of a tension [N]", series, log_y=True, legend_columns=2)


def _error_table(rows: list[dict[str, Any]]) -> Table:
    columns = {"offset [m]": ",.0f", "precision": ""}
    for quantity in QUANTITIES.values():
        columns |= {f"{quantity}, {name} [relative error]": ".1e" for name in FORMULATIONS.values()}
    keys = [f"{key}_{quantity}" for quantity in QUANTITIES for key in FORMULATIONS]
    return make_table(
        "Errors far from the origin.",
        columns,
        ((row["offset"], row["precision"], *(row[key] for key in keys)) for row in rows),
        note="A dash: nodes coincide in this precision, so that there is no result.",
    )


def _metres(offset: float) -> str:
    return f"{format_number(offset, '.0e').removeprefix('1 × ')} m"
