"""SCS Figs 4 to 11 and equations (44), (45), (52), (53), computed: plain dicts and arrays.

A row of a comparison has equation, quantity, unit, paper, ours, difference = ours - paper.
"""

from dataclasses import replace
from importlib.resources import as_file, files
from typing import Any

import numpy as np

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.studies.papers.scs.paper_values import (
    PAPER_DURATION,
    PAPER_POSES,
    PRINTED_SIDE,
    PaperPose,
)
from tensegrity_codegen.studies.papers.scs.printed import PrintedTower
from tensegrity_codegen.studies.papers.scs.reconfiguration import Reconfiguration, plan_reconfiguration
from tensegrity_codegen.studies.papers.scs.regions import RegionMap, map_regions
from tensegrity_codegen.studies.papers.scs.scene_kind import GROUPS
from tensegrity_codegen.studies.papers.scs.symmetry import SymmetricTower
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
