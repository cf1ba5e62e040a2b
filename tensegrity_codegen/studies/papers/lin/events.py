"""The largest load: first slack spring, first contact of bars, limit point, located by root finding.

LIN 1 promises "to determine the maximum of the applied force" and never gives it. Up to the first contact of
two bars the path is that of the real prism; beyond it the bars of the model pass through each other, and the
limit point is what the prism would carry if they could.

The force against the spring constants. The abstract of LIN says that "the evolution of the external force
has been researched along with the evolution of the stiffnesses of the springs"; no formula, table or figure
of the text shows it. Computed here: the force that brings B_3 down by a given amount, and the largest force
before bars touch, over the spring constants of all springs, of the side springs and of the top springs.
Rest lengths stay as printed, so that stiffer springs are tighter, too: without weight the force is
proportional to the constant of all.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from tensegrity_codegen.report.pages.diagram import Diagram, Series
from tensegrity_codegen.report.pages.page import Figure, Paragraph, Remark, Section, diagram_figure
from tensegrity_codegen.report.pages.page_table import Table, make_table, number_cell
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.paths.c_equilibrium import EquilibriumSolver
from tensegrity_codegen.runtime.paths.continuation import StepControl, follow_path
from tensegrity_codegen.runtime.paths.load_path import LoadPath, PathEvent
from tensegrity_codegen.runtime.paths.model_path import ModelPath
from tensegrity_codegen.runtime.paths.watches import watch_contact, watch_slack
from tensegrity_codegen.studies.papers.lin.tables import TOPS, compile_prism, place_load, settle
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import ConvergenceError

LAWS = {"linear": False, "tension_only": True}  # springs, and whether they go slack
DIRECTIONS = {
    "+x": (1.0, 0.0, 0.0),
    "-x": (-1.0, 0.0, 0.0),
    "+y": (0.0, 1.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "+z": (0.0, 0.0, 1.0),
    "-z": (0.0, 0.0, -1.0),
}
MAX_LOAD = 60.0  # [N], to which loads grow
CONTROL = StepControl(largest=0.05, most_steps=2000)


def follow_load(
    model: CompiledModel,
    top: int = 3,
    direction: str = "-z",
    *,
    max_load: float = MAX_LOAD,
    past_contact: bool = False,
    control: StepControl = CONTROL,
    **arguments: Any,
) -> tuple[ModelPath, LoadPath]:
    """Return the problem and the path of equilibria while a force on one top grows from 0 to `most` [N].

    past_contact: go on where bars touch, though they then pass through each other.
    """
    problem = ModelPath(model, place_load(top, DIRECTIONS[direction]), arguments)
    watches = [
        watch_slack(problem, model.manifest.member_name),
        watch_contact(problem, stops=not past_contact),
    ]
    start = settle(model, np.zeros((1, 3, 3)), **arguments).coordinate[0]
    return problem, follow_path(problem, start, most=max_load, watches=watches, control=control)


def find_load_events(
    *, tension_only: bool = False, top: int = 3, direction: str = "-z", control: StepControl = CONTROL
) -> dict[str, Any]:
    """Return the loads [N] of the first slack spring, the first contact and the first limit point.

    slack, contact, limit: {load, of} or None where there is none up to MAX_LOAD, in the order of the path.
    maximum: the largest load that the prism carries before bars touch or the load turns back, and `because`.
    is_stable: whether all configurations up to there are minima of the energy. events: all, in order.
    status: how the path ended.
    """
    model = compile_prism(tension_only=tension_only)
    _, path = follow_load(model, top, direction, past_contact=True, control=control)
    ends = path.find_events("contact", "limit")
    final = ends[0] if ends else None
    reached = len(path.load_factor) if final is None else final.point
    return {
        "law": "tension_only" if tension_only else "linear",
        "top": top,
        "direction": direction,
        "slack": _describe(path.find_events("slack")),
        "contact": _describe(path.find_events("contact")),
        "limit": _describe(path.find_events("limit")),
        "maximum": MAX_LOAD if final is None else final.load_factor,
        "because": "not reached" if final is None else final.kind,
        "is_stable": bool((path.smallest_eigenvalue[:reached] > 0).all()),
        "events": [event.as_dict() for event in path.events],
        "status": path.status,
    }


def survey_directions(
    tops: Iterable[int] = (1, 2, 3), directions: Iterable[str] = tuple(DIRECTIONS)
) -> list[dict[str, Any]]:
    """Return find_load_events for every top, direction and law of the springs, row by row."""
    ways = tuple(directions)
    return [
        find_load_events(tension_only=slack, top=top, direction=way)
        for slack in LAWS.values()
        for top in tops
        for way in ways
    ]


def _describe(events: tuple[PathEvent, ...]) -> dict[str, Any] | None:
    if not events:
        return None
    return {"load": events[0].load_factor, "of": events[0].names}


LAW = {"linear": "linear springs", "tension_only": "springs that go slack"}
SHORT_LAW = {"linear": "linear", "tension_only": "go slack"}
KIND = {"contact": "bars touch", "limit": "limit point", "not reached": "not reached"}
QUICK_DIRECTIONS = ("-z", "+x")
ENDS = ("contact", "limit")


def maximum_section(quick: bool) -> Section:
    """Return the section on slack, contact and limit loads; quick: two directions on B_3 alone."""
    rows = [find_load_events(tension_only=law == "tension_only") for law in LAW]
    survey = survey_directions((3,), QUICK_DIRECTIONS) if quick else survey_directions()
    contact, slack = rows[0]["contact"]["load"], rows[0]["slack"]["load"]
    return Section(
        "lin-maximum-load",
        "Sections 1, 3.2",
        "The maximum of the applied force",
        "new",
        f"{rows[0]['maximum']:.6g} N on B₃ along −z, where bars 2 and 3 touch; the paper stops at 10 N",
        (
            Paragraph(
                "The path of equilibria is followed by arc length while the load grows; the first slack "
                "spring, the first contact of two bars (cylinders of 8 mm) and the limit point, where "
                "the load cannot grow further, are located by root finding. After a contact the bars of "
                "the model pass through each other, so that the limit point is what the prism would "
                "carry if they could."
            ),
            *_path_figures(contact, slack),
            _event_table(rows),
            Remark(
                "new",
                f"With linear springs, as in the paper, a spring that goes slack at {slack:.6g} N pushes "
                "from there on. With springs that go slack the contact comes a little earlier. Both lie "
                "above the 10 N of the measurements.",
                ("lin-maximum", "lin-cases"),
            ),
            _survey_table(survey),
        ),
    )


def _path_figures(contact: float, slack: float) -> tuple[Figure, ...]:
    """Return height of B_3 and stability along the path with linear springs, past the contact."""
    model = compile_prism()
    problem, path = follow_load(model, past_contact=True)
    node = model.manifest.node_name.index("bar3_B")
    height = [float(problem.compute("node_position", q, 0.0)[node, 2]) for q in path.coordinate]
    turns = int(np.argmax(path.load_factor)) + 1
    load = path.load_factor[:turns]
    marks = ((slack, "first slack spring"), (contact, "bars touch"))
    return (
        diagram_figure(
            "lin-path-height",
            Diagram("load on B₃, downwards [N]", "height of B₃ [m]", [Series("", load, height[:turns])],
                    vertical=marks[1:]),
            f"Height of B₃ up to the limit point; right of {contact:.2f} N the bars pass through each other.",
            "The height of B3 falls with the load, faster towards the limit point.",
        ),
        diagram_figure(
            "lin-path-eigenvalue",
            Diagram("load on B₃, downwards [N]", "smallest eigenvalue [N m]",
                    [Series("", load, path.smallest_eigenvalue[:turns], color=2)], vertical=marks[1:]),
            "Smallest eigenvalue of the Hessian: positive, thus stable, up to the limit point, where it "
            "vanishes.",
            "The smallest eigenvalue falls to zero at the limit point.",
        ),
    )  # fmt: skip


def _event_table(rows: list[dict[str, Any]]) -> Table:
    """Return the loads of the three events along -z on B_3, with both laws of the springs."""
    heads = ("first slack spring [N]", "first contact of bars [N]", "limit point [N]")
    table = (
        (
            *(LAW[row["law"]], *map(_load, (row["slack"], row["contact"], row["limit"]))),
            *(number_cell(None, "g", "paper"), number_cell(row["maximum"], ".6f", "ours")),
        )
        for row in rows
    )
    return make_table(
        "Loads on B₃ along −z.",
        {"springs": ""} | dict.fromkeys((*heads, "paper: maximum [N]", "ours: maximum [N]"), ".6f"),
        table,
    )


def _survey_table(rows: list[dict[str, Any]]) -> Table:
    table = (
        (
            *(f"B{'₁₂₃'[row['top'] - 1]}", row["direction"].replace("-", "−"), SHORT_LAW[row["law"]]),
            *map(_load, (row["slack"], row["contact"], row["limit"])),
            number_cell(row["maximum"] if row["because"] in ENDS else None, ".3f", "ours"),
            KIND[row["because"]],
        )
        for row in rows
    )
    numbers = ("slack [N]", "contact [N]", "limit point [N]", "maximum [N]")
    return make_table(
        "Loads on each top along each axis, up to 60 N.",
        {"on": "", "along": "", "springs": ""} | dict.fromkeys(numbers, ".3f") | {"because": ""},
        table,
        note="A dash: does not happen up to 60 N. A contact after a limit point may have a smaller load.",
    )


def _load(event: dict[str, Any] | None) -> float | None:
    return None if event is None else float(event["load"])


SUBSETS = {"all": ("side", "top"), "side": ("side",), "top": ("top",)}
FACTORS = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0)
DESCENTS = (0.01, 0.03, 0.05)  # [m]
PRINTED_LOAD = 10.0  # [N]
MAX_ITERATIONS = 30
CLOSE = 1e-11  # [m]


def compare_stiffness(
    factors: Sequence[float] = FACTORS, descents: Sequence[float] = DESCENTS
) -> dict[str, Any]:
    """Return how the force on B_3 changes with the spring constants, subset by subset of the springs.

    factor (n,): of the printed spring constant; spring_constant (n,) [N/m]; descent (m,) [m]; descent_10: how
    far the printed springs let B_3 down at 10 N [m]. By subset "all", "side", "top": force (n, m) [N] that
    brings B_3 down by each descent; force_10 (n,), by descent_10; maximum (n,), the load at the first contact
    of bars or limit point; because (n,), which of them.
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
    """
    solver = EquilibriumSolver(model)
    at = solver.find(tolerance=1e-11, spring_constant=spring_constant).check().coordinate[0]
    height = _measure(model, at, 0.0, spring_constant)[0]
    force = 0.0
    for _ in range(MAX_ITERATIONS):
        present, flexibility = _measure(model, at, force, spring_constant)
        missing = descent - (height - present)
        if abs(missing) <= CLOSE:
            return force
        force += missing / flexibility
        loads = place_load(3, (0.0, 0.0, -force))
        equilibrium = solver.find(
            at, tolerance=1e-11, node_load=loads, spring_constant=spring_constant
        ).check()
        at = equilibrium.coordinate[0]
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
    arguments = {"coordinate": coordinate, "spring_constant": spring_constant}
    height = float(model.compute("node_position", **arguments)[node, 2])
    row = model.compute("node_jacobian", **arguments).toarray()[3 * node + 2]
    stiffness = model.compute(
        "tangent_stiffness", node_load=place_load(3, (0.0, 0.0, -force)), **arguments
    ).toarray()
    return height, float(row @ np.linalg.solve(stiffness, row))


def _height(model: CompiledModel, force: float, spring_constant: FloatArray) -> float:
    equilibrium = EquilibriumSolver(model).find(
        tolerance=1e-11, node_load=place_load(3, (0.0, 0.0, -force)), spring_constant=spring_constant
    )
    return _measure(model, equilibrium.check().coordinate[0], force, spring_constant)[0]


def _scale(model: CompiledModel, kinds: Sequence[str], factor: float) -> FloatArray:
    """Return the spring constants (6,) with those of some kinds scaled."""
    constant = model.nominal("spring_constant")
    for k, name in enumerate(model.manifest.member_name):
        if name.rstrip("123") in kinds:
            constant[k] *= factor
    return constant


def _find_end(model: CompiledModel, spring_constant: FloatArray) -> tuple[float, str]:
    upper = 40.0 * float(spring_constant.max() / model.nominal("spring_constant").min())
    _, path = follow_load(model, max_load=upper, past_contact=True, spring_constant=spring_constant)
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
    columns |= {
        f"{quantity}, {name} [N]": ".3f" for quantity in ("force", "largest") for name in NAMES.values()
    }
    curves = [data[kind][key] for key in ("force_10", "maximum") for kind in NAMES]
    rows = (
        (factor, data["spring_constant"][k], *(curve[k] for curve in curves))
        for k, factor in enumerate(data["factor"])
    )
    caption = f"Force for a descent of {1e3 * data['descent_10']:.1f} mm, and the largest load."
    return make_table(caption, columns, rows)
