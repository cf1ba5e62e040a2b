"""Tables 1 to 3 and Fig. 4 of LIN: measured, computed in print, and computed here."""

import csv
from importlib.resources import files
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.studies.papers.lin.model import COLUMNS, SPRINGS, compile_prism, place_load, settle
from tensegrity_codegen.system.arrays import FloatArray

MM = 1e3


def read_tables() -> dict[str, FloatArray]:
    """Return the printed tables: load (11,) [N], measured and computed (11, 6) [mm], error (11, 6) [%]."""
    text = (
        files("tensegrity_codegen.studies.papers")
        .joinpath("data", "lin_tables.csv")
        .read_text(encoding="utf-8")
    )
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    rows = [[float(cell) for cell in row] for row in list(csv.reader(lines))[1:]]
    table = {number: np.array([row[1:] for row in rows if row[0] == number]) for number in (1, 2, 3)}
    return {
        "load": table[1][:, 0],
        "measured": table[1][:, 1:],
        "computed": table[2][:, 1:],
        "error": table[3][:, 1:],
    }


def compute_extensions(
    load: FloatArray, model: CompiledModel | None = None, *, top: int = 3, axis: int = 2
) -> FloatArray:
    """Return the springs' extensions in the tables' order, (n, 6) [mm], under loads (n,) [N] on one top."""
    model = model or compile_prism()
    forces = np.eye(3)[axis] * np.asarray(load)[:, None]
    found = settle(model, np.array([place_load(top, force) for force in forces]))
    column = [model.manifest.member_name.index(name) for name in SPRINGS]
    rows = [model.compute("member_extension", coordinate=q)[column] for q in found.coordinate]
    return MM * np.array(rows)


def compare_tables(model: CompiledModel | None = None) -> dict[str, Any]:
    """Return Tables 1, 2 and 3 beside ours, and the curves of Fig. 4.

    load (11,) [N]; measured, paper, ours (11, 6) [mm], columns named by the ends of the springs; differences
    ours - paper and ours - measured; error_paper, error_ours (11, 6): (computed - measured) / computed in
    magnitude, the definition below (30) of the paper; error_printed: Table 3 as printed; mean errors of all
    66 entries. Raises ConvergenceError where an equilibrium is not found.
    """
    printed = read_tables()
    ours = compute_extensions(printed["load"], model)
    measured, paper = printed["measured"], printed["computed"]
    error_paper, error_ours = relative_error(paper, measured), relative_error(ours, measured)
    return {
        "load": printed["load"],
        "columns": COLUMNS,
        "springs": SPRINGS,
        "measured": measured,
        "paper": paper,
        "ours": ours,
        "ours_minus_paper": ours - paper,
        "ours_minus_measured": ours - measured,
        "largest_difference_to_paper": float(np.abs(ours - paper).max()),
        "error_printed": printed["error"] / 100.0,
        "error_paper": error_paper,
        "error_ours": error_ours,
        "largest_difference_of_table_3": float(np.abs(error_paper - printed["error"] / 100.0).max()),
        "mean_error_paper": float(error_paper.mean()),
        "mean_error_ours": float(error_ours.mean()),
        "figure_4": {
            name: {"measured": measured[:, k], "paper": paper[:, k], "ours": ours[:, k]}
            for k, name in enumerate(COLUMNS)
        },
    }


def relative_error(computed: FloatArray, measured: FloatArray) -> FloatArray:
    """Return |computed - measured| / computed, entry by entry."""
    return np.asarray(np.abs(computed - measured) / computed)


def compare_unloaded(model: CompiledModel | None = None) -> list[dict[str, Any]]:
    """Return what holds without a load, row by row: name, unit, paper (None: not printed), ours, difference.

    The paper's extensions are the means of the first row of Table 2, whose springs of a kind differ by up to
    7 micrometres though the configuration is symmetrical.
    """
    model = model or compile_prism()
    q = settle(model, np.zeros((1, 3, 3))).coordinate[0]
    first = read_tables()["computed"][0]
    extension = MM * model.compute("member_extension", coordinate=q)
    member, coordinate = model.manifest.member_name, model.manifest.coordinate_name
    stiffness = model.compute("tangent_stiffness", coordinate=q).toarray()
    gap = MM * model.compute("bar_distance", coordinate=q).min()
    rows = [
        ("extension of side springs", "mm", first[3:].mean(), extension[member.index("side1")]),
        ("extension of top springs", "mm", first[:3].mean(), extension[member.index("top1")]),
        ("azimuth alpha", "deg", None, np.degrees(q[coordinate.index("bar1_azimuth")])),
        ("elevation beta", "deg", None, np.degrees(q[coordinate.index("bar1_elevation")])),
        ("smallest eigenvalue of the Hessian", "N m", None, np.linalg.eigvalsh(stiffness)[0]),
        ("distance of the bars' surfaces", "mm", None, gap),
    ]
    return [
        {
            "name": name,
            "unit": unit,
            "paper": None if paper is None else float(paper),
            "ours": float(ours),
            "difference": None if paper is None else float(ours - paper),
        }
        for name, unit, paper, ours in rows
    ]
