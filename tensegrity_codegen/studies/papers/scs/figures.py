"""SCS Figs 4 to 11 and equations (44), (45), (52), (53), computed: plain dicts and arrays.

A row of a comparison has equation, quantity, unit, paper, ours, difference = ours - paper.
"""

import math
from dataclasses import replace
from importlib.resources import as_file, files
from typing import Any

import numpy as np

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.studies.papers.scs.printed import (
    PAPER_DURATION,
    PAPER_POSES,
    PRINTED_SIDE,
    PaperPose,
    PrintedTower,
)
from tensegrity_codegen.studies.papers.scs.reconfiguration import Reconfiguration, plan_reconfiguration
from tensegrity_codegen.studies.papers.scs.regions import RegionMap, map_regions
from tensegrity_codegen.studies.papers.scs.symmetry import GROUPS, SymmetricTower
from tensegrity_codegen.studies.papers.scs.tracking import compile_tower, drive_as_printed, track
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import StructureError

SYMBOLS = ("T_S", "T_V", "T_D")


def load_paper_tower() -> SymmetricTower:
    """Return the shipped tower of the paper's data."""
    with as_file(files("tensegrity_codegen.scene").joinpath("examples", "svd_tower.toml")) as path:
        system, _ = load_scene(path)
    if not isinstance(system, BodySystem):
        raise StructureError("not a scene of bodies", where=system.name)
    return SymmetricTower(system)


def plan_paper_motions(tower: SymmetricTower) -> dict[str, Reconfiguration]:
    """Return the paper's motions.

    "with_torque": (44) to (45), Figs 4 to 7; "zero_torque": from (52) to 65 deg, Figs 8 to 10; "prescribed":
    the same ends with both angles by the quintic, Fig. 11.
    """
    first, second, third, fourth = (PAPER_POSES[key] for key in ("44", "45", "52", "53"))
    with_torque = plan_reconfiguration(
        tower, first.pose, second.pose, duration=PAPER_DURATION, force=first.force
    )
    zero_torque = plan_reconfiguration(
        tower, third.pose, fourth.pose, duration=PAPER_DURATION, force=third.force, zero_torque=True
    )
    prescribed = plan_reconfiguration(
        tower, third.pose, zero_torque.end, duration=PAPER_DURATION, force=third.force
    )
    return {"with_torque": with_torque, "zero_torque": zero_torque, "prescribed": prescribed}


def compare_equilibria(tower: SymmetricTower) -> list[dict[str, Any]]:
    """Return the printed tensions and the printed end of (53) beside ours.

    with_printed_data: the same quantity from the printed b and Z, which are rounded.
    """
    motions = plan_paper_motions(tower)
    poses = {key: item.pose for key, item in PAPER_POSES.items()} | {"53": motions["zero_torque"].end}
    rows: list[dict[str, Any]] = []
    for key, item in PAPER_POSES.items():
        ours, rounded = tower.equilibrium(poses[key], item.force), _with_printed_data(tower, item)
        for k, symbol in enumerate(SYMBOLS):
            row = _compare(item.equation, symbol, "N", item.tension[k], float(ours[k]))
            rows.append(row | {"with_printed_data": float(rounded[k])})
    end = motions["zero_torque"].end.in_degrees[1]
    return [*rows, _compare("(48), (53)", "delta_f", "deg", PAPER_POSES["53"].delta_deg, end)]


def compute_figures(tower: SymmetricTower, n_t: int = 201) -> dict[str, dict[str, Any]]:
    """Return the curves of Figs 4 to 11: figure -> title, time (n_t,) [s], unit, curves name -> (n_t,).

    The paper prints these as pictures without numbers; their ends are in compare_equilibria.
    """
    records = {name: plan.sample(n_t) for name, plan in plan_paper_motions(tower).items()}
    figures: dict[str, dict[str, Any]] = {}
    for number, name in ((4, "with_torque"), (8, "zero_torque")):
        record = records[name]
        time = record.time
        angles = {"alpha": record.alpha_deg, "delta": record.delta_deg}
        figures[f"Fig. {number}"] = _figure("angles", "deg", time, angles)
        rest = dict(zip(("S_0", "V_0", "D_0"), record.rest_length.T, strict=True))
        figures[f"Fig. {number + 1}"] = _figure("rest lengths", "m", time, rest)
        tension = dict(zip(SYMBOLS, record.tension.T, strict=True))
        figures[f"Fig. {number + 2}"] = _figure("tensions", "N", time, tension)
    for number, name in ((7, "with_torque"), (11, "prescribed")):
        record = records[name]
        figures[f"Fig. {number}"] = _figure("torque", "N m", record.time, {"M_3": record.torque})
    return dict(sorted(figures.items(), key=lambda item: int(item[0].split()[1])))


def compute_paper_maps(
    tower: SymmetricTower, step_deg: float = 1.0, span_deg: float = 120.0
) -> dict[str, RegionMap]:
    """Return the maps of feasible configurations at the paper's two heights and forces, from azimuth 0."""
    alpha, delta = np.arange(0.0, span_deg, step_deg), np.arange(step_deg, 90.0, step_deg)
    return {
        item.equation: map_regions(tower, item.height, item.force, alpha_deg=alpha, delta_deg=delta)
        for item in (PAPER_POSES["44"], PAPER_POSES["52"])
    }


def compare_tracking(
    tower: SymmetricTower, *, rtol: float = 1e-10, samples: int = 101
) -> list[dict[str, Any]]:
    """Return how the full model in C follows each motion, by our controls and by (34) as printed.

    A row has motion, controls ("ours" or "as printed") and what Tracking.summary gives.
    """
    model, rows = compile_tower(tower), []
    for name, plan in plan_paper_motions(tower).items():
        for controls, schedule in (("ours", None), ("as printed", drive_as_printed(plan))):
            followed = track(
                plan, schedule=schedule, model=model, rtol=rtol, atol=0.1 * rtol, samples=samples
            )
            rows.append({"motion": name, "controls": controls, **followed.summary()})
    return rows


def _figure(title: str, unit: str, time: FloatArray, curves: dict[str, FloatArray]) -> dict[str, Any]:
    return {"title": title, "unit": unit, "time": time, "curves": curves}


def _compare(equation: str, quantity: str, unit: str, paper: float, ours: float) -> dict[str, Any]:
    return {
        "equation": equation,
        "quantity": quantity,
        "unit": unit,
        "paper": paper,
        "ours": ours,
        "difference": ours - paper,
    }


def _with_printed_data(tower: SymmetricTower, item: PaperPose) -> FloatArray:
    """Return the tensions at the printed, rounded b and Z, by the closed forms."""
    rounded = replace(PrintedTower.of(tower), side=PRINTED_SIDE)
    rest = np.zeros(len(GROUPS))
    return rounded.tension(item.printed_pose.parameter, rest, rest, item.force)


# Each formula of SCS that is wrong in print, measured against the full model of 18 coordinates.
#
# The difference of the printed and of the corrected formula from the equations obtained from the full model,
# largest over random symmetrical motions: the first is of the size of the terms, the second is rounding.


def check_errata(tower: SymmetricTower, *, samples: int = 50, seed: int = 1) -> list[dict[str, Any]]:
    """Return one row an erratum: name, equation, unit, error_as_printed, error_as_corrected."""
    generator = np.random.default_rng(seed)
    motions = [_draw(generator) for _ in range(samples)]
    checks = (
        ("centrifugal term", "(23), (34)", "N m", _centrifugal),
        ("sin(delta) in the second row of A_r", "(A.4) to (A.6)", "m", _matrix),
        ("height", "(21), (28)", "N m", _height),
    )
    rows = []
    for name, equation, unit, check in checks:
        errors = np.abs([check(tower, *motion) for motion in motions]).max(axis=0)
        rows.append(_row(name, equation, unit, errors[0], errors[1]))
    return [*rows, _rounded_data(tower)]


def _draw(generator: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return s, s', s'' with s inside the bounds of SCS 4, and Z' and Z'' too."""
    s = np.array([generator.uniform(0, 6.28), generator.uniform(0.1, 1.4), generator.uniform(1.1, 2.0)])
    return s, generator.normal(size=3), generator.normal(size=3)


def _centrifugal(tower: SymmetricTower, s: FloatArray, rate: FloatArray, change: FloatArray) -> FloatArray:
    """Return the first entry of e, printed and corrected, less that of the full model, at constant Z."""
    rate, change = rate * (1, 1, 0), change * (1, 1, 0)
    reduced = tower.restricted.balance(s, rate, change).reduced()
    printed = PrintedTower.of(tower)
    entries = [printed.own_force(s, rate, change, 0.0, as_printed=flag)[0] for flag in (True, False)]
    return np.asarray(np.array(entries) - reduced.own_force[1] / 6.0)


def _matrix(tower: SymmetricTower, s: FloatArray, rate: FloatArray, change: FloatArray) -> FloatArray:
    """Return the largest difference of A_r from that of the full model, printed and corrected."""
    matrix, printed, place = tower.matrix(s[None])[0], PrintedTower.of(tower), [float(x) for x in s]
    both = [printed.matrix(*place, as_printed=flag) - matrix for flag in (True, False)]
    return np.array([np.abs(difference).max() for difference in both])


def _height(tower: SymmetricTower, s: FloatArray, rate: FloatArray, change: FloatArray) -> FloatArray:
    """Return d/dt(Z' sin(delta)) and Z'' sin(delta), times m l / 2, less what the full model leaves over.

    What is left over is the difference of the equations of delta between the upper and the lower stage.
    """
    own = tower.restricted.balance(s, rate, change).own_force
    names = tower.system.coordinate_name
    lower, upper = (own[names.index(f"bar{stage}_declination")] for stage in ("11", "12"))
    arm, sine = 0.5 * tower.bar.mass * tower.bar.length, math.sin(s[1])
    corrected = arm * sine * change[2]
    printed = corrected + arm * math.cos(s[1]) * rate[1] * rate[2]
    return np.asarray(np.array([printed, corrected]) - (upper - lower))


def _rounded_data(tower: SymmetricTower) -> dict[str, Any]:
    """Return the largest error of the tensions in (44), (45), (52) with printed and with exact data."""
    rows = [row for row in compare_equilibria(tower) if row["unit"] == "N"]
    rows = [row for row in rows if row["equation"] != PAPER_POSES["53"].equation]
    rounded = max(abs(row["with_printed_data"] - row["paper"]) for row in rows)
    return _row(
        "rounded b and Z", "(43) to (45), (52)", "N", rounded, max(abs(r["difference"]) for r in rows)
    )


def _row(name: str, equation: str, unit: str, printed: float, corrected: float) -> dict[str, Any]:
    return {
        "name": name,
        "equation": equation,
        "unit": unit,
        "error_as_printed": float(printed),
        "error_as_corrected": float(corrected),
    }
