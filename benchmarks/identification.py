"""Identification of three structures from simulated data with noise: coverage, starts, beside differences.

python benchmarks/identification.py [--seeds 200] [--write]

- Prism: four numbers from the motion of two nodes. Tower of 48 members: six numbers of its classes from the
  motion of its top. Net of 180 cables: stiffness, prestress and a mass in its middle from shapes under four
  loads and two frequencies.
- Share: of the seeds whose 95 % interval holds the truth, the least and the largest of the numbers.
- Starts: the largest distance, in standard errors, of what is found from 1.5 times and from 1 / 1.5 of the
  truth.
- Twenty numbers: the tower's rest lengths from the same motion, by columns and by differences (SciPy's
  2-point).
"""

import argparse
import time
import tomllib
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from harness.turns import draw_bars, find_about, publish, table_text
from live_pages import write_net
from numpy.typing import NDArray

from tensegrity_codegen import (
    ModelRequest,
    Stepping,
    build_library,
    compile_scene,
    find_equilibrium,
    identify,
    linearize,
    load_scene,
    read_scene,
    simulate,
)
from tensegrity_codegen.runtime.trajectory.simulation_quantities import SIMULATION_QUANTITIES
from tensegrity_codegen.sweeps.fitting.identification import Identification
from tensegrity_codegen.sweeps.fitting.keyed_motion import KeyedMotion, RunSettings
from tensegrity_codegen.sweeps.keys import KeyPath

FloatArray = NDArray[np.float64]
PAGE = "identify_measured.md"
ROOT = Path(__file__).resolve().parents[1]
TOWER = ROOT / "tensegrity_codegen" / "scene" / "examples" / "tower.toml"
FACTOR = 1.5
NET = 8  # seeds for one of the net
HEAD = (
    "structure",
    "numbers",
    "share within 95 %",
    "from starts 1.5 times off",
    "CPU a fit [s]",
    "motions",
)
NET_NOISE = {"position": 1e-3, "frequency": 0.01}


@dataclass(frozen=True)
class Case:
    """A scene, the numbers that are sought, what is measured without noise, and the noise by kind."""

    name: str
    scene: dict[str, Any]
    keys: tuple[str, ...]
    exact: Mapping[str, Any]
    noise: Mapping[str, float]

    def truth(self) -> FloatArray:
        """Return the numbers of the scene."""
        return np.array([KeyPath.find(key, self.scene).read(self.scene) for key in self.keys], dtype=float)

    def start(self, factor: float) -> dict[str, Any]:
        """Return the scene with all numbers times a factor."""
        found = deepcopy(self.scene)
        for key, value in zip(self.keys, self.truth(), strict=True):
            found = KeyPath.find(key, found).write(found, factor * float(value))
        return found

    def measure(self, seed: int) -> dict[str, Any]:
        """Return what is measured, with noise."""
        draw, found = np.random.default_rng(seed), {}
        for name, values in self.exact.items():
            kind = "frequency" if name.startswith("frequency") else "position"
            is_given = name == "time" or "[" in name
            found[name] = values if is_given else values + self.noise[kind] * draw.normal(size=len(values))
        return found

    def identify(self, seed: int, factor: float = 1.0) -> Identification:
        """Return what is found from a start times a factor."""
        return identify(self.start(factor), self.measure(seed), self.keys, noise=dict(self.noise))


def main() -> None:
    """Print two tables, or write them into the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--write", action="store_true", help=f"write into docs/{PAGE}")
    parser.add_argument("--seeds", type=int, default=200, help="number of seeds, of the net an eighth of it")
    chosen = parser.parse_args()
    rows = [judge(build(), chosen.seeds) for build in (build_prism, build_tower)]
    rows.append(judge(build_net(), max(chosen.seeds // NET, 5)))
    publish(
        PAGE,
        describe_finding(rows),
        f"{chosen.seeds} seeds, of the net {1 / NET:g} of them, at least 5.",
        draw_bars(HEAD[0], HEAD[4]),
        table_text(HEAD, rows),
        table_text(("twenty rest lengths", "CPU [s]", "motions", "ratio"), compare()),
        find_about(__doc__),
        write=chosen.write,
    )


def describe_finding(rows: Sequence[Sequence[str]]) -> str:
    """Return the least and the largest share of the seeds whose interval holds the truth."""
    shares = [float(word) for row in rows for word in row[2].removesuffix(" %").split(" to ")]
    worst = min(rows, key=lambda row: float(row[2].split()[0]))
    return (
        f"Intervals of 95 % hold the truth in {min(shares):g} to {max(shares):g} % of the cases, the "
        "least with: "
        f"{worst[0]}"
    )


def judge(case: Case, seeds: int) -> tuple[str, ...]:
    """Return one row: coverage over seeds, distance of the starts, time and motions of a fit."""
    truth, hits, began, motions = case.truth(), np.zeros(len(case.keys)), time.process_time(), 0
    for seed in range(seeds):
        found = case.identify(seed)
        motions += found.n_motions
        hits += (found.interval[:, 0] <= truth) & (truth <= found.interval[:, 1])
    spent = (time.process_time() - began) / seeds
    here = case.identify(0)
    apart = [
        np.abs((other.value - here.value) / here.standard_error).max()
        for other in (case.identify(0, FACTOR), case.identify(0, 1.0 / FACTOR))
    ]
    share = 100.0 * hits / seeds
    return (
        case.name,
        str(len(case.keys)),
        f"{share.min():.1f} to {share.max():.1f} %",
        f"{max(apart):.1g} standard errors",
        f"{spent:.2f}",
        f"{motions / seeds:.0f}",
    )


def observe(scene: dict[str, Any], t_end: float, count: int, names: Sequence[str]) -> dict[str, Any]:
    """Return positions by names such as t1.x along the motion of a scene."""
    times = np.linspace(0.0, t_end, count + 1)
    motion = simulate(compile_scene(scene, for_="simulate"), t_end, samples=times, rtol=1e-9)
    found: dict[str, Any] = {"time": times[1:]}
    for name in names:
        node, _, axis = name.partition(".")
        found[name] = motion.node_position[1:, motion.node_name.index(node), "xyz".index(axis)]
    return found


def build_prism() -> Case:
    """Return a prism that swings on anchored feet."""
    from tests.sweeps.fitting.scenes import PRISM

    keys = ("classes.cable.spring_constant", "classes.cable.damping", "shape.node_mass", "loads[0].force[0]")
    exact = observe(PRISM, 0.5, 100, ["t1.x", "t1.y", "t2.x", "t2.z"])
    return Case("prism, motion", PRISM, keys, exact, {"position": 1e-4})


def build_tower_scene() -> dict[str, Any]:
    """Return the shipped tower of 48 members on anchored feet, with a class for each kind of cable."""
    scene = read_scene(TOWER).to_document()
    string = scene["classes"].pop("string")
    for kind in ("bottom", "top", "vertical", "saddle", "diagonal"):
        scene["classes"][f"{kind}_string"] = dict(string)
        scene["shape"][f"{kind}_class"] = f"{kind}_string"
    scene["classes"]["strut"]["axial_stiffness"] = 5e4
    scene["shape"]["anchor_bottom"] = True
    scene["loads"] = [{"node": "t3_1", "force": [3.0, 1.0, -2.0]}]
    scene["model"] = {"quantities": ["member_tension"]}
    scene["parameters"], scene["inputs"] = {}, []
    return dict(scene)


def build_tower() -> Case:
    """Return the tower that swings under a load at its top."""
    scene = build_tower_scene()
    kinds = ("vertical", "saddle", "diagonal")
    keys = (
        *(f"classes.{kind}_string.axial_stiffness" for kind in kinds),
        "classes.vertical_string.damping",
        "shape.node_mass",
        "loads[0].force[0]",
    )
    exact = observe(scene, 0.4, 80, ["t3_1.x", "t3_1.y", "t3_2.x", "t3_2.z", "t2_1.x", "t2_1.y"])
    return Case("tower of 48 members, motion", scene, keys, exact, {"position": 1e-4})


def build_net() -> Case:
    """Return a net of 180 cables: shapes under four loads, two frequencies of each."""
    scene = tomllib.loads(write_net(11))
    scene["classes"]["rope"] = {"kind": "cable", "axial_stiffness": 500.0, "prestress": 20.0}
    scene["loads"] = [{"node": "n60", "force": [0.0, 0.0, 0.0]}]
    scene["nodes"]["n60"]["mass"] = 1.0
    load, forces = "loads[0].force[2]", (0.0, -5.0, -10.0, -20.0)
    exact: dict[str, Any] = {load: np.array(forces)}
    for force in forces:
        scene["loads"][0]["force"][2] = force
        model = compile_scene(scene, for_=("equilibrium", "linearize"))
        found = find_equilibrium(model, tolerance=1e-11)
        for node in ("n24", "n36", "n49", "n60", "n72", "n84"):
            value = found.node_position[model.manifest.node_name.index(node), 2]
            exact.setdefault(f"{node}.z", []).append(value)
        for number in (1, 2):
            value = linearize(model, found).natural_frequency[number - 1]
            exact.setdefault(f"frequency.{number}", []).append(value)
    scene["loads"][0]["force"][2] = 0.0
    keys = ("classes.rope.axial_stiffness", "classes.rope.prestress", "nodes.n60.mass")
    exact = {name: np.asarray(values) for name, values in exact.items()}
    return Case("net of 180 cables, shapes and frequencies", scene, keys, exact, NET_NOISE)


def compare() -> list[tuple[str, ...]]:
    """Return the fit of twenty rest lengths of the tower by columns and by differences."""
    scene, nodes = build_tower_scene(), [f"t3_{k}" for k in (1, 2, 3)] + [f"t2_{k}" for k in (1, 2, 3)]
    names = [f"{node}.{axis}" for node in nodes for axis in "xyz"]
    exact = observe(scene, 0.4, 80, names)
    draw = np.random.default_rng(0)
    data = {name: v + 1e-4 * draw.normal(size=80) * (name != "time") for name, v in exact.items()}
    structure, _ = load_scene(scene)
    free = [name for name in structure.member_name if not name.startswith(("bar", "bottom"))]
    keys = tuple(f"rest_length.{name}" for name in free[:20])
    problem = KeyedMotion(scene, keys, RunSettings())
    start = problem.start * (1.0 + 0.003 * draw.normal(size=20))
    times = np.concatenate([[0.0], exact["time"]])
    places = [(problem.structure.node_name.index(name[:-2]), "xyz".index(name[-1])) for name in names]
    measured = np.stack([data[name] for name in names], axis=1)
    counts = {"columns": 0, "differences": 0}
    parameters = problem.group.request.parameters
    request = ModelRequest(
        SIMULATION_QUANTITIES, integrators=("rk853",), parameters=parameters, events=("auto",)
    )
    plain = build_library(problem.structure, request, flags="native").load()

    def by_columns(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        run = problem.run(x, times)
        counts["columns"] += 1
        values = np.stack([run.motion.node_position[1:, n, a] for n, a in places], axis=1)
        slopes = np.stack([run.node_position[1:, n, a] for n, a in places], axis=1)
        return ((values - measured) / 1e-4).ravel(), (slopes / problem.size / 1e-4).reshape(-1, 20)

    def by_differences(x: FloatArray) -> FloatArray:
        arguments = {name: rows[0] for name, rows in problem.apply(x[None]).items()}
        coordinate, velocity = (arguments.pop(name, None) for name in ("coordinate", "velocity"))
        motion = simulate(
            plain,
            0.4,
            samples=times,
            method="rk853",
            rtol=1e-8,
            coordinate=coordinate,
            velocity=velocity,
            arguments=arguments,
            stepping=Stepping(control="steps"),
        )
        counts["differences"] += 1
        return ((np.stack([motion.node_position[1:, n, a] for n, a in places], 1) - measured) / 1e-4).ravel()

    kept: dict[bytes, tuple[FloatArray, FloatArray]] = {}

    def recall(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        if x.tobytes() not in kept:
            kept.clear()
            kept[x.tobytes()] = by_columns(x)
        return kept[x.tobytes()]

    began = time.process_time()
    near = {"bounds": (0.8 * problem.start, 1.2 * problem.start), "x_scale": "jac"}
    first = scipy.optimize.least_squares(lambda x: recall(x)[0], start, lambda x: recall(x)[1], **near)
    own = time.process_time() - began
    began = time.process_time()
    second = scipy.optimize.least_squares(by_differences, start, "2-point", **near)
    other = time.process_time() - began
    apart = np.abs(first.x - second.x).max() / np.abs(first.x).max()
    return [
        ("columns", f"{own:.2f}", str(counts["columns"]), "1"),
        ("differences", f"{other:.2f}", str(counts["differences"]), f"{other / own:.1f}, {apart:.0e} apart"),
    ]


if __name__ == "__main__":
    main()
