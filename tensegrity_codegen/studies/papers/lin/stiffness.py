"""The external force against the spring constants.

The abstract of LIN says that "the evolution of the external force has been researched along with the
evolution of the stiffnesses of the springs"; no formula, table or figure of the text shows it. Computed
here: the force that brings B_3 down by a given amount, and the largest force before bars touch, over the
spring constants of all springs, of the side springs and of the top springs. Rest lengths stay as printed, so
that stiffer springs are tighter, too: without weight the force is proportional to the constant of all.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from tensegrity_codegen.report.pages.diagram import Diagram, Series
from tensegrity_codegen.report.pages.page import Paragraph, Remark, Section, diagram_figure
from tensegrity_codegen.report.pages.page_table import Table, make_table
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.paths.c_equilibrium import EquilibriumSolver
from tensegrity_codegen.studies.papers.lin.events import follow_load
from tensegrity_codegen.studies.papers.lin.tables import TOPS, compile_prism, place_load
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import ConvergenceError

SUBSETS = {"all": ("side", "top"), "side": ("side",), "top": ("top",)}
FACTORS = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0)
DESCENTS = (0.01, 0.03, 0.05)  # [m]
PRINTED_LOAD = 10.0  # [N]
MOST_ITERATIONS = 30
CLOSE = 1e-11  # [m]


def compare_stiffness(
    factors: Sequence[float] = FACTORS, descents: Sequence[float] = DESCENTS
) -> dict[str, Any]:
    """Return how the force on B_3 changes with the spring constants, subset by subset of the springs.

    factor (n,): of the printed spring constant; spring_constant (n,) [N/m]; descent (m,) [m]; descent_10: how
    far the printed springs let B_3 down at 10 N [m]. By subset "all", "side", "top": force (n, m) [N] that
    brings B_3 down by each descent; force_10 (n,), by descent_10; maximum (n,), the load at the first
    contact of bars or limit point; because (n,), which of them. Raises ConvergenceError.
    """
    model = compile_prism()
    printed = model.nominal("spring_constant")
    descent_10 = _height(model, 0.0, printed) - _height(model, PRINTED_LOAD, printed)
    result: dict[str, Any] = {
        "factor": np.array(factors),
        "spring_constant": np.array(factors) * printed[0],
        "descent": np.array(descents),
        "descent_10": descent_10,
    }
    for name, kinds in SUBSETS.items():
        scaled = [_scale(model, kinds, factor) for factor in factors]
        ends = [_find_end(model, constant) for constant in scaled]
        result[name] = {
            "force": np.array([[find_force(model, d, constant) for d in descents] for constant in scaled]),
            "force_10": np.array([find_force(model, descent_10, constant) for constant in scaled]),
            "maximum": np.array([load for load, _ in ends]),
            "because": tuple(kind for _, kind in ends),
        }
    return result


def find_force(model: CompiledModel, descent: float, spring_constant: FloatArray) -> float:
    """Return the downward force [N] on B_3 that brings it `descent` [m] below where it is without load.

    spring_constant (6,) [N/m]. Newton's method with dz/dF = -e J K^-1 J^T e, e the direction of the force.
    Raises ConvergenceError where there is no such force before the configuration turns unstable.
    """
    solver = EquilibriumSolver(model)
    at = solver.find(tolerance=1e-11, spring_constant=spring_constant).check().coordinate[0]
    height = _measure(model, at, 0.0, spring_constant)[0]
    force = 0.0
    for _ in range(MOST_ITERATIONS):
        present, flexibility = _measure(model, at, force, spring_constant)
        missing = descent - (height - present)
        if abs(missing) <= CLOSE:
            return force
        force += missing / flexibility
        loads = place_load(3, (0.0, 0.0, -force))
        found = solver.find(at, tolerance=1e-11, node_load=loads, spring_constant=spring_constant).check()
        at = found.coordinate[0]
    raise ConvergenceError(
        "no force brings the top down by this much",
        evidence={"descent": descent, "force": force, "missing": missing},
        where="find_force",
        hint="a smaller descent",
    )


def _measure(
    model: CompiledModel, coordinate: FloatArray, force: float, spring_constant: FloatArray
) -> tuple[float, float]:
    """Return the height of B_3 [m], and how far a further newton brings it down [m/N]."""
    node = model.manifest.node_name.index(TOPS[2])
    given = {"coordinate": coordinate, "spring_constant": spring_constant}
    height = float(model.compute("node_position", **given)[node, 2])
    row = model.compute("node_jacobian", **given).toarray()[3 * node + 2]
    stiffness = model.compute(
        "tangent_stiffness", node_load=place_load(3, (0.0, 0.0, -force)), **given
    ).toarray()
    return height, float(row @ np.linalg.solve(stiffness, row))


def _height(model: CompiledModel, force: float, spring_constant: FloatArray) -> float:
    found = EquilibriumSolver(model).find(
        tolerance=1e-11, node_load=place_load(3, (0.0, 0.0, -force)), spring_constant=spring_constant
    )
    return _measure(model, found.check().coordinate[0], force, spring_constant)[0]


def _scale(model: CompiledModel, kinds: Sequence[str], factor: float) -> FloatArray:
    """Return the spring constants (6,) with those of some kinds scaled."""
    constant = model.nominal("spring_constant")
    for k, name in enumerate(model.manifest.member_name):
        if name.rstrip("123") in kinds:
            constant[k] *= factor
    return constant


def _find_end(model: CompiledModel, spring_constant: FloatArray) -> tuple[float, str]:
    most = 40.0 * float(spring_constant.max() / model.nominal("spring_constant").min())
    _, path = follow_load(model, most=most, past_contact=True, spring_constant=spring_constant)
    ends = path.find_events("contact", "limit")
    return (ends[0].load_factor, ends[0].kind) if ends else (float("nan"), "not reached")


NAMES = {"all": "all springs", "side": "side springs", "top": "top springs"}


def stiffness_section(factors: Sequence[float]) -> Section:
    """Return the section for these factors of the printed spring constant."""
    data = compare_stiffness(factors)
    descent = 1e3 * data["descent_10"]
    return Section(
        "lin-spring-constants",
        "Abstract",
        "External force against spring constants",
        "new",
        "doubling all springs doubles the force within the bars' weight; at 10 N, B₃ has come down "
        f"{descent:.1f} mm",
        (
            Paragraph(
                "The force on B₃ that brings it down by a given amount, and the largest load before bars "
                "touch, over the spring constants of all springs, of the side springs and of the top "
                "springs. Rest lengths stay as printed, so that stiffer springs are tighter, too."
            ),
            diagram_figure(
                "lin-spring-constants-force",
                _diagram(data, "force_10", f"force for {descent:.1f} mm [N]"),
                f"Force on B₃ that brings it down by {descent:.1f} mm, as 10 N do with the printed springs.",
                "Force against spring constant: proportional for all springs, bent for one kind alone.",
            ),
            diagram_figure(
                "lin-spring-constants-maximum",
                _diagram(data, "maximum", "largest load [N]"),
                "Largest load before two bars touch.",
                "Largest load against spring constant, for all, side and top springs.",
            ),
            _table(data),
            Remark(
                "new",
                "The abstract says that the evolution of the external force was studied along with that "
                "of the spring constants; no formula, table or figure of the text shows it.",
                ("lin-stiffness",),
            ),
        ),
    )


def _diagram(data: dict[str, Any], key: str, label: str) -> Diagram:
    constant = data["spring_constant"]
    series = [
        Series(name, constant, data[kind][key], color=color, marker="osD"[color])
        for color, (kind, name) in enumerate(NAMES.items())
    ]
    return Diagram("spring constant [N/m]", label, series, vertical=((173.2, "printed: 173.2 N/m"),))


def _table(data: dict[str, Any]) -> Table:
    columns = {"K / printed": ".2f", "K [N/m]": ".1f"}
    columns |= {f"{what}, {name} [N]": ".3f" for what in ("force", "largest") for name in NAMES.values()}
    curves = [data[kind][key] for key in ("force_10", "maximum") for kind in NAMES]
    rows = (
        (factor, data["spring_constant"][k], *(curve[k] for curve in curves))
        for k, factor in enumerate(data["factor"])
    )
    caption = f"Force for a descent of {1e3 * data['descent_10']:.1f} mm, and the largest load."
    return make_table(caption, columns, rows)
