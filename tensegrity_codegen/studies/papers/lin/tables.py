"""The prism of LIN, and its Tables 1 to 3 and Fig. 4: measured, computed in print, and computed here."""

import csv
import functools
import tomllib
from importlib.resources import files
from typing import Any

import numpy as np
from scipy import optimize

from tensegrity_codegen.pipeline.analyses import equilibrium_quantities
from tensegrity_codegen.pipeline.build_library import MANY_CALLS, build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.paths.c_equilibrium import EquilibriumSolver, SolvedPath
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.scene.subject import assemble_scene
from tensegrity_codegen.system.arrays import FloatArray

SCENE = "lin_prism"
PRINTED_SIDE = 0.41  # a [m]
PRINTED_LENGTH = 0.578  # L [m]
LOADS = -np.arange(11.0)  # F_3z of the tables [N]
TOPS = ("bar1_B", "bar2_B", "bar3_B")  # B_1, B_2, B_3
# Springs in the order of the tables' columns dL1..dL6, by their ends and by their names in the scene.
COLUMNS = ("B1B2", "B3B1", "B2B3", "A1B2", "A3B1", "A2B3")
SPRINGS = ("top1", "top3", "top2", "side1", "side3", "side2")


@functools.cache
def compile_prism(
    side: float = PRINTED_SIDE, bar_length: float = PRINTED_LENGTH, tension_only: bool = False
) -> CompiledModel:
    """Return the compiled prism; loads on its tops and spring constants may change at run time.

    side: distance of two anchors [m]; bar_length [m], whose mass goes with it; tension_only: springs that go
    slack, in place of the paper's linear ones.
    """
    text = files("tensegrity_codegen.scene").joinpath("examples", f"{SCENE}.toml").read_text(encoding="utf-8")
    document: dict[str, Any] = tomllib.loads(text)
    points = document["bodies"]["base"]["points"]
    for name, position in points.items():
        points[name] = [x * (side / PRINTED_SIDE) for x in position]
    for name, body in document["bodies"].items():
        if name != "base":
            body["length"] = bar_length
    document["classes"]["spring"]["tension_only"] = tension_only
    system, request = assemble_scene(parse_scene(document, SCENE), SCENE)
    full_request = request.wanting(
        *equilibrium_quantities(system, request),
        "member_extension",
        "bar_distance",
        solvers=("equilibrium",),
        parameters={
            "node_load": tuple(system.node_name.index(name) for name in TOPS),
            "spring_constant": tuple(range(system.n_members)),
        },
    )
    return build_library(system, full_request, calls=MANY_CALLS).load()


def place_load(top: int, force: Any) -> FloatArray:
    """Return the loads on all tops, (3, 3) [N], with one force (3,) on top 1, 2 or 3."""
    loads = np.zeros((len(TOPS), 3))
    loads[top - 1] = force
    return loads


def settle(model: CompiledModel, loads: FloatArray, **arguments: Any) -> SolvedPath:
    """Return the equilibria under loads (n, 3, 3) [N], found in C one from the other."""
    solver = EquilibriumSolver(model)
    start = solver.find(tolerance=1e-11, **arguments).check()
    return solver.follow(loads, start.coordinate[0], tolerance=1e-11, **arguments).check()


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
    equilibria = settle(model, np.array([place_load(top, force) for force in forces]))
    column = [model.manifest.member_name.index(name) for name in SPRINGS]
    rows = [model.compute("member_extension", coordinate=q)[column] for q in equilibria.coordinate]
    return MM * np.array(rows)


def compare_tables() -> dict[str, Any]:
    """Return Tables 1, 2 and 3 beside ours, and the curves of Fig. 4.

    load (11,) [N]; measured, paper, ours (11, 6) [mm], columns named by the ends of the springs; differences
    ours - paper and ours - measured; error_paper, error_ours (11, 6): (computed - measured) / computed in
    magnitude, the definition below (30) of the paper; error_printed: Table 3 as printed; mean errors of all
    66 entries.
    """
    printed = read_tables()
    ours = compute_extensions(printed["load"])
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


def compare_unloaded() -> list[dict[str, Any]]:
    """Return what holds without a load, row by row: name, unit, paper (None: not printed), ours, difference.

    The paper's extensions are the means of the first row of Table 2, whose springs of a kind differ by up to
    7 micrometres though the configuration is symmetrical.
    """
    model = compile_prism()
    q = settle(model, np.zeros((1, 3, 3))).coordinate[0]
    lowest = read_tables()["computed"][0]
    extension = MM * model.compute("member_extension", coordinate=q)
    member, coordinate = model.manifest.member_name, model.manifest.coordinate_name
    stiffness = model.compute("tangent_stiffness", coordinate=q).toarray()
    gap = MM * model.compute("bar_distance", coordinate=q).min()
    rows = [
        ("extension of side springs", "mm", lowest[3:].mean(), extension[member.index("side1")]),
        ("extension of top springs", "mm", lowest[:3].mean(), extension[member.index("top1")]),
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


# How near other parameters come to Table 2, and why the printed ones cannot reach its first row.
#
# Without load the configuration is symmetrical: all azimuths alpha and all elevations beta are equal, and the
# lengths of the two kinds of springs are functions of these two angles. The first row of Table 2 asks for a
# pair of lengths that no alpha, beta have with the printed a and L.


CHANGES: dict[str, dict[str, float]] = {
    "printed": {},
    "a = 0.4129 m": {"side": 0.4129},
    "L = 0.5768 m": {"bar_length": 0.5768},
}


def compare_sensitivity() -> list[dict[str, Any]]:
    """Return, for the printed parameters and two changed ones, how far we are from Tables 1 and 2.

    Rows: name, side a [m], bar_length L [m], largest_difference to Table 2 [mm], mean_error against the
    measurements, and nearest: the least difference [mm] of any symmetrical configuration to the first row.
    """
    printed = read_tables()
    rows = []
    for name, change in CHANGES.items():
        side = change.get("side", PRINTED_SIDE)
        bar_length = change.get("bar_length", PRINTED_LENGTH)
        model = compile_prism(side, bar_length)
        ours = compute_extensions(LOADS, model)
        rows.append(
            {
                "name": name,
                "side": side,
                "bar_length": bar_length,
                "largest_difference": float(np.abs(ours - printed["computed"]).max()),
                "mean_error": float(relative_error(ours, printed["measured"]).mean()),
                "nearest": find_nearest_symmetrical(model)["distance"],
            }
        )
    return rows


def find_nearest_symmetrical(model: CompiledModel | None = None) -> dict[str, float]:
    """Return the symmetrical configuration whose springs are nearest to the first row of Table 2.

    azimuth, elevation [deg]; side, top: extensions there [mm]; distance: the root of the sum of the squares
    of both differences [mm].
    """
    model = model or compile_prism()
    lowest = read_tables()["computed"][0]
    target = np.array([lowest[3:].mean(), lowest[:3].mean()])
    kinds = [model.manifest.member_name.index(name) for name in (SPRINGS[3], SPRINGS[0])]

    def difference(angles: FloatArray) -> FloatArray:
        extension = model.compute("member_extension", coordinate=_spread(model, angles))
        return np.asarray(MM * extension[kinds] - target)

    starts = [np.array([a, e]) for a in np.linspace(-3, 3, 9) for e in (0.3, 0.8, 1.3)]
    fit = min(
        (optimize.least_squares(difference, start, xtol=1e-15) for start in starts),
        key=lambda candidate: float(candidate.cost),
    )
    side, top = difference(fit.x) + target
    return {
        "azimuth": float(np.degrees(fit.x[0])),
        "elevation": float(np.degrees(fit.x[1])),
        "side": float(side),
        "top": float(top),
        "distance": float(np.linalg.norm(difference(fit.x))),
    }


def _spread(model: CompiledModel, angles: FloatArray) -> FloatArray:
    """Return coordinates (6,) in which all bars have these azimuth and elevation [rad]."""
    azimuth, elevation = (float(angle) for angle in angles)
    names = model.manifest.coordinate_name
    return np.array([azimuth if name.endswith("azimuth") else elevation for name in names])
