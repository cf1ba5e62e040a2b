"""Plans to far targets, drawn at random, on four structures with a motor on each cable.

python benchmarks/far_plans.py --out FILE.jsonl [--scene NAME] [--first K] [--count N] [--attempts N]
                                [--write]
python benchmarks/far_plans.py --out FILE.jsonl --few-motors [--first K] [--count N]

Scenes: the prism of 12 cables, a tower of five stages, a mast of three stages with 39 motors, the SuperBall.
Each target has four components at once (twist, tilt in any direction, height), uniform in the ranges of
`SCENES`, from the seed 26. Limits: cables 1 N or more (of the mast 100 N at most), bars 2 mm apart.

A plan that is found is checked by a simulation of the full model: masses at the nodes, damped members, motors
that follow the plan at 10 mm/s, 20 s of rest at its end. Its last shape is compared with that of the plan, up
to a rigid motion of the whole. Each target adds a row to the file.

With `--few-motors` the rows are those of `FEW_MOTORS`: a few motors, or one that moves many cables alike.
"""

import argparse
import json
import os
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from harness.turns import draw_bars, find_about, publish, table_text

from tensegrity_codegen.control.planning.plan import plan
from tensegrity_codegen.pipeline.analyses import want_analyses
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.records.plan_result import Cover, PlanResult
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.request import ModelRequest
from tests.control.planning.structures import (
    actuate,
    assemble,
    build_mast,
    build_prism,
    build_tower,
    gang,
    limit,
)

SEED, COUNT = 26, 25
PAGE = "control_measured.md"
HEADS = (
    "structure",
    "targets",
    "found",
    "a plan [s]",
    "longest [s]",
    "largest distance of a simulation's end [m]",
)
GALLERY = Path(__file__).parents[1] / "docs" / "gallery"
SUPERBALL, MAST = GALLERY / "superball.toml", GALLERY / "deployable_mast.toml"
FACETS = "[n4, n8, n12], [n1, n5, n9]"  # two facets of cables that face each other
# Masses of nodes [kg], damping of members [N s/m], speed of the motors and rest at the end of the simulation.
MASS, DAMPING, SPEED, REST = 0.05, 5.0, 0.01, 20.0


def build_superball() -> Structure:
    """Return the SuperBall of the gallery, settled, with a motor for each cable."""
    stated = assemble(tomllib.loads(SUPERBALL.read_text()))
    model = build_library(stated, want_analyses(stated, ModelRequest(quantities=()), ("equilibrium",))).load()
    settled = stated.with_changes(node_position=find_equilibrium(model).node_position)
    return limit(actuate(settled))


@dataclass(frozen=True)
class Scene:
    """A structure, the nodes of top and base, and ranges of the targets.

    twist, tilt [deg], height: change of the twist; tilt; height over that of the start.
    """

    build: Callable[[], Structure]
    twist: tuple[float, float]
    tilt: tuple[float, float]
    height: tuple[float, float]
    nodes: str = ""


SCENES = {
    "prism": Scene(lambda: limit(actuate(build_prism(155.0))), (-3.0, 20.0), (0.0, 45.0), (0.65, 1.3)),
    "tower": Scene(lambda: limit(actuate(build_tower())), (-150.0, 150.0), (60.0, 150.0), (0.5, 1.0)),
    "mast": Scene(build_mast, (-180.0, 180.0), (90.0, 170.0), (0.5, 1.0)),
    "superball": Scene(build_superball, (-90.0, 90.0), (30.0, 80.0), (0.5, 1.1), FACETS),
}


@dataclass(frozen=True)
class FewMotors:
    """A motor on each cable whose name begins so, or one on all of them; targets; attempts of the plans."""

    scene: str
    cables: str
    is_one: bool
    targets: tuple[str, ...]
    attempts: int

    def build(self) -> Structure:
        """Return the structure with its motors."""
        place = gang if self.is_one else actuate
        return place(FEW_SCENES[self.scene](), self.cables)


def build_gallery_mast() -> Structure:
    """Return the mast of four stages of the gallery, without its motors."""
    return limit(assemble(tomllib.loads(MAST.read_text())).with_changes(inputs=()))


FEW_SCENES: dict[str, Callable[[], Structure]] = {
    "prism": lambda: limit(build_prism(155.0)),
    "tower": lambda: limit(build_tower()),
    "mast": build_mast,
    "gallery mast": build_gallery_mast,
}
FEW_MOTORS = (
    FewMotors("prism", "vertical", True, ("twist=158", "twist=165", "height=0.306", "height=0.32"), 2),
    FewMotors("prism", "opposite", True, ("twist=165", "height=0.302", "height=0.32"), 2),
    FewMotors("prism", "top", True, ("twist=165", "height=0.35"), 2),
    FewMotors("prism", "vertical1", False, ("twist=155.3", "twist=156", "height=0.31"), 2),
    FewMotors("prism", "vertical", False, ("twist=158", "twist=165"), 15),
    FewMotors("tower", "vertical", True, ("height=2.115", "height=2.12", "height=1.9"), 4),
    FewMotors("tower", "saddle", True, ("height=2.2", "height=2"), 4),
    FewMotors("tower", "vertical5_1", False, ("height=2.05", "t5_1.x=0.3"), 2),
    FewMotors("tower", "top1", False, ("t5_1.x=0.21", "t5_1.x=0.3"), 2),
    FewMotors("tower", "vertical5", False, ("tilt=5", "tilt=10"), 2),
    FewMotors("tower", "top", False, ("tilt=1", "tilt=5"), 2),
    FewMotors("mast", "vertical", True, ("height=1.045", "height=1.05", "height=0.95"), 4),
    FewMotors("mast", "saddle", True, ("height=1.05", "height=1.1", "height=1"), 4),
    FewMotors("mast", "vertical3_1", False, ("height=1.0405", "height=1.045", "height=0.95"), 2),
    FewMotors("gallery mast", "saddle", False, ("tilt=10", "tilt=13", "tilt=20"), 12),
)


class OutOfTimeError(Exception):
    """A plan takes longer than it may."""


def load(structure: Structure) -> CompiledModel:
    """Return the model of a structure for plans and simulations."""
    moving = structure.with_changes(
        node_mass=np.full(structure.n_nodes, MASS), damping=np.full(structure.n_members, DAMPING)
    )
    return build_library(
        moving, want_analyses(moving, ModelRequest(quantities=()), ("plan", "simulate"))
    ).load()


def draw_targets(scene: str, model: CompiledModel) -> list[dict[str, Any]]:
    """Return the targets of a scene."""
    nodes, given = SCENES[scene].nodes, SCENES[scene]
    ranges = (given.twist, given.tilt, given.height)
    names = [f"{name}({nodes})" if nodes else name for name in ("twist", "tilt", "height")]
    start = plan(model, {names[0]: 0.0, names[2]: 1.0}, max_steps=1).target[0]
    draw = np.random.default_rng([SEED, list(SCENES).index(scene)])
    targets = []
    for _ in range(COUNT):
        twist, tilt, height = (draw.uniform(*pair) for pair in ranges)
        way = draw.uniform(0.0, 2 * np.pi)
        targets.append(
            {
                names[0]: round(float(start[0] + twist), 3),
                names[1]: [round(float(tilt * part), 3) for part in (np.cos(way), np.sin(way))],
                names[2]: round(float(start[1] * height), 4),
            }
        )
    return targets


def find(
    model: CompiledModel, target: dict[str, Any] | str, most_time: float, **options: Any
) -> tuple[PlanResult | None, float]:
    """Return a plan, None where it takes too long, and the time that it takes [s]."""
    begin = monotonic()

    def watch(_steps: int, _progress: float) -> None:
        if monotonic() - begin > most_time:
            raise OutOfTimeError

    try:
        return plan(model, target, progress=watch, **options), monotonic() - begin
    except OutOfTimeError:
        return None, monotonic() - begin


def simulate_plan(model: CompiledModel, found: PlanResult) -> tuple[float, float]:
    """Return the largest distance of nodes from the plan [m] after its motion, and the speed left [m/s]."""
    step = np.abs(np.diff(found.change, axis=0)).max(axis=1) / SPEED
    time = np.concatenate([[0.0], np.cumsum(step)])
    time, change = np.append(time, time[-1] + REST), np.vstack([found.change, found.change[-1:]])
    profile = Profile(time, dict(zip(found.actuator_name, change.T, strict=True)))
    run = simulate(
        model,
        float(time[-1]),
        schedule=profile,
        coordinate=found.coordinate[0],
        samples=[0.0, float(time[-1])],
    )
    here, there = (place - place.mean(axis=0) for place in (run.node_position[-1], found.node_position[-1]))
    left, _, right = np.linalg.svd(here.T @ there)
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return float(np.abs(here @ turn - there).max()), float(np.abs(run.velocity[-1]).max())


def describe(
    scene: str, index: int, target: dict[str, Any] | str, found: PlanResult | None, taken: float
) -> dict[str, Any]:
    """Return the row of a plan."""
    row = {"scene": scene, "index": index, "target": target, "seconds": round(taken, 2)}
    if found is None:
        return row | {"status": "out of time"}
    return row | {
        "status": found.status,
        "progress": float(found.progress[-1]),
        "steps": found.n_steps,
        "branches": len(found.branches),
        "cells": len(found.certificate.end) if isinstance(found.certificate, Cover) else 0,
        "message": found.message,
    }


def main() -> None:
    """Plan to the targets of one or all scenes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--scene", choices=SCENES)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=COUNT)
    parser.add_argument("--most-time", type=float, default=120.0)
    parser.add_argument("--attempts", type=int, default=2)
    parser.add_argument("--no-simulation", action="store_true")
    parser.add_argument("--few-motors", action="store_true")
    parser.add_argument("--write", action="store_true", help=f"write into docs/{PAGE}")
    given = parser.parse_args()
    given.out.parent.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []

    def run(
        scene: str, model: CompiledModel, index: int, target: dict[str, Any] | str, attempts: int
    ) -> None:
        found, taken = find(model, target, given.most_time, attempts=attempts)
        row = describe(scene, index, target, found, taken)
        if found is not None and found.is_found and not given.no_simulation:
            begin = monotonic()
            row["apart"], row["speed"] = simulate_plan(model, found)
            row["simulation_seconds"] = round(monotonic() - begin, 2)
        rows.append(row)
        print(row, flush=True)
        with given.out.open("a") as file:
            file.write(json.dumps(row) + "\n")

    chosen = slice(given.first, given.first + given.count)
    for index, item in list(enumerate(FEW_MOTORS))[chosen] if given.few_motors else []:
        model = load(item.build())
        for target in item.targets:
            name = f"{item.scene}, {'one motor' if item.is_one else 'a motor each'} on {item.cables}"
            run(name, model, index, target, item.attempts)
    for scene in () if given.few_motors else [given.scene] if given.scene else SCENES:
        model = load(SCENES[scene].build())
        for index, target in list(enumerate(draw_targets(scene, model)))[chosen]:
            run(scene, model, index, target, given.attempts)
    table = summarise(rows)
    slow = max(table, key=lambda cells: float(cells[3]))
    far = max(table, key=lambda cells: float(cells[5] or 0.0))
    finding = (
        f"{sum(int(cells[2]) for cells in table)} of {len(rows)} far targets are planned, at the median "
        "in at "
        f"most {slow[3]} s ({slow[0]}); simulations end at most {far[5]} m away ({far[0]})"
    )
    parts = (draw_bars(HEADS[0], HEADS[3]), table_text(HEADS, table), find_about(__doc__))
    publish(PAGE, finding, *parts, write=given.write)


def summarise(rows: list[dict[str, Any]]) -> list[tuple[str, ...]]:
    """Return the row of each scene: targets, those that were found, times, distances of simulations."""
    table = []
    for scene in dict.fromkeys(row["scene"] for row in rows):
        own = [row for row in rows if row["scene"] == scene]
        seconds, apart = ([row[key] for row in own if key in row] for key in ("seconds", "apart"))
        found = sum(row["status"] == "found" for row in own)
        times = (f"{np.median(seconds):.1f}", f"{max(seconds):.1f}")
        table.append((scene, f"{len(own)}", f"{found}", *times, f"{max(apart):.1e}" if apart else ""))
    return table


if __name__ == "__main__":
    main()
