"""The call that README shows, `simulate` from Python by its defaults, over seven structures and tolerances.

python benchmarks/simulate_calls.py --references DIR [--only NAME ...] [--rtol 1e-3 ...] [--quick]
                                    [--ours-only] [--json FILE] [--document FILE]

Ours is `simulate(model, t_end, samples=11, rtol=rtol)`, all else by default, on a model that
`compile_scene(scene, for_=("simulate",), rtol=rtol)` made before. Times are medians of processor time over
rounds that take turns. The true error is the largest of all node coordinates at the eleven times, against a
motion of the elastic structure that two methods certify and that `--references` keeps. Told over true compares
`error_estimate` with the true error in the norm of the tolerance, of positions and velocities of nodes, without
what the evidence states apart (`vibration_speed_error`); told over tolerance is `error_estimate` itself.
"""

import argparse
import hashlib
import json
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from harness.turns import (
    EXAMPLES,
    describe_origin,
    measure_call,
    table_text,
    take_turns,
)
from live_pages import write_net
from stiff_bars import TOWER

from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.accuracy.scales import set_atol_by_motion, tolerance_of_options
from tensegrity_codegen.runtime.accuracy.tolerance import Tolerance
from tensegrity_codegen.runtime.integrate.options import Stepping, read_stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.motion_input import read_motion
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.studies.work_precision.measure import Reference, find_agreement
from tensegrity_codegen.system.arrays import FloatArray

SAMPLES = 11
RTOLS = (1e-3, 1e-5, 1e-7)
ROUNDS = 9
ENOUGH = 0.02  # seconds over which short calls are repeated in a round
# Methods that certify a reference: two runs of different ones, those that agree best. Rounding keeps some
# from the tightest setting, or makes it no better.
CERTIFYING = {"rk853": (1e-13, 1e-12, 1e-10), "rk54": (1e-13, 1e-12, 1e-10)}
ATOL_OF_RTOL = 1e-2
STANDING = """\
name = "standing"
gravity = [0, 0, -9.81]
[classes.bar]
kind = "bar"
spring_constant = 2e5
damping = 5
mass = 0.1
radius = 0.006
[classes.cable]
kind = "cable"
spring_constant = 2000
damping = 2
[shape]
kind = "prism"
bars = 3
bottom_radius = 0.15
top_radius = 0.12
height = 0.30
node_mass = 0.02
prestress = 20
[ground]
offset = -0.05
stiffness = 2e4
restitution = { value = 0.5, speed = 1.0 }
friction = 0.5
"""


@dataclass(frozen=True)
class Case:
    """A structure and the simulated time [s]; scene: makes its document."""

    name: str
    t_end: float
    scene: Callable[[], dict[str, Any]]

    @property
    def times(self) -> FloatArray:
        """Sample times (n_t,) [s]."""
        return np.linspace(0.0, self.t_end, SAMPLES)


def _prism(ratio: float, **shape: Any) -> dict[str, Any]:
    """Return the example prism, bars so many times as stiff as its cables."""
    scene = _example("prism", shape)
    scene["classes"]["bar"]["spring_constant"] = ratio * scene["classes"]["cable"]["spring_constant"]
    return scene


def _example(name: str, shape: Mapping[str, Any]) -> dict[str, Any]:
    """Return an example, the mass of its bars at their ends: springs have no mass in MuJoCo."""
    scene = tomllib.loads((EXAMPLES / f"{name}.toml").read_text(encoding="utf-8"))
    scene["shape"].update(shape)
    structure = compile_scene(scene).structure
    (mass,) = set(np.round(structure.lumped_mass, 15).tolist())  # one bar at every node
    scene["shape"]["node_mass"] = mass
    for values in scene["classes"].values():
        for key in ("density", "mass", "inner_radius"):
            values.pop(key, None)
    return scene


def _net() -> dict[str, Any]:
    """Return a flat square net of 112 cables that hangs at its edge, with a load on two nodes."""
    scene = tomllib.loads(write_net(9))
    scene["loads"] = [{"node": "n40", "force": [0, 0, -5]}, {"node": "n21", "force": [0, 2, -5]}]
    return scene


CASES = (
    Case("prism, bars 1e3", 1.0, partial(_prism, 1e3)),
    Case("prism, bars 1e5", 1.0, partial(_prism, 1e5)),
    Case("icosahedron", 1.0, partial(_example, "icosahedron", {})),
    Case("tower of 50", 0.1, partial(tomllib.loads, TOWER)),
    Case("pinned prism", 1.0, partial(_prism, 1e3, anchor_bottom=True)),
    Case("cable net", 1.0, _net),
    Case("prism on the ground", 0.5, partial(tomllib.loads, STANDING)),
    Case("tower of the papers", 1.0, partial(_example, "tower", {})),
)


@dataclass(frozen=True)
class Truth:
    """A certified motion: positions of nodes, states (n_t, n_states), and whether a cable goes slack."""

    reference: Reference
    state: FloatArray
    goes_slack: bool

    def error(self, motion: Trajectory, tolerance: Tolerance) -> float:
        """Return the largest error of the position or velocity of a node, over the tolerance.

        The error of velocities that the result states apart from its estimate does not count.
        """
        apart = tolerance.lengths(np.hstack([motion.coordinate, motion.velocity]) - self.state)
        stated = np.array([0.0, motion.evidence.get("vibration_speed_error", 0.0)])
        apart = np.maximum(apart - np.repeat(stated, len(tolerance.first)), 0.0)
        return float(np.max(apart / tolerance.allowed(self.state)))


def find_truth(case: Case, folder: Path) -> Truth:
    """Return the reference of a case, from its file if there is one."""
    scene = case.scene()
    key = hashlib.sha256(json.dumps([scene, case.t_end, CERTIFYING]).encode()).hexdigest()[:12]
    path = folder / f"{case.name.replace(' ', '_')}-{key}.npz"
    if not path.exists():
        model = compile_scene(scene, for_=("simulate",), integrators=tuple(CERTIFYING))
        runs: dict[str, dict[str, Trajectory]] = {}
        for method, rtols in CERTIFYING.items():
            for rtol in rtols:
                stepping = Stepping(atol=ATOL_OF_RTOL * rtol, control="steps", max_steps=10**8)
                run = simulate(
                    model, case.t_end, samples=SAMPLES, method=method, rtol=rtol, stepping=stepping
                )
                if run.status == "ok":
                    runs.setdefault(method, {})[f"{method} at {rtol:.0e}"] = run
        first, second = runs.values()
        pairs = product(first.items(), second.items())
        agreements = [find_agreement([(n, r.node_position) for n, r in pair]) for pair in pairs]
        found = min(agreements, key=lambda agreement: agreement.uncertainty)
        best = first[found.first]
        slack = bool(
            "cable" in best.log.kind or (best.member_tension[:, model.structure.tension_only] <= 0).any()
        )
        folder.mkdir(parents=True, exist_ok=True)
        state = np.hstack([best.coordinate, best.velocity])
        text = json.dumps({"reference": found.as_dict(), "goes_slack": slack})
        np.savez(path, text=text, state=state)
        print(
            f"{case.name}: {found.first} and {found.second} differ by {found.uncertainty:.1e} m", flush=True
        )
    with np.load(path) as data:
        kept = json.loads(str(data["text"]))
        state = data["state"]
    shape = np.shape(kept["reference"]["node_position"])
    reference = Reference.from_dict(kept["reference"], shape)
    assert reference is not None
    return Truth(reference, state, kept["goes_slack"])


@dataclass
class Row:
    """Our call for a structure and a tolerance; told: its error estimate over the tolerance."""

    case: str
    rtol: float
    seconds: float
    error: float
    told: float
    true: float
    size: float
    uncertainty: float
    n_steps: int
    n_rejected: int
    method: str
    status: str

    @property
    def told_over_true(self) -> float:
        """The error estimate over the true error, both over the tolerance."""
        return self.told / self.true

    def cells(self) -> tuple[str, ...]:
        """Return the cells of the table."""
        near = "" if self.error > 10 * self.uncertainty else f" (reference to {self.uncertainty:.0e})"
        return (
            self.case,
            f"{self.rtol:.0e}",
            f"{1e3 * self.seconds:.2f}",
            f"{self.error:.1e}{near}",
            f"{self.told_over_true:.2g}",
            f"{self.told:.1e}",
            f"{self.n_steps} ({self.n_rejected})",
            self.method if self.status == "ok" else f"{self.method}: {self.status}",
        )


HEADS = (
    "structure",
    "rtol",
    "CPU [ms]",
    "true error [m]",
    "told/true",
    "told/tolerance",
    "steps (rejected)",
    "method",
)


def prepare(case: Case, rtol: float, truth: Truth) -> tuple[Row, Callable[[], Trajectory]]:
    """Return the row of a call, its time not measured yet, and the call."""
    model = compile_scene(case.scene(), for_=("simulate",), rtol=rtol)
    call = partial(simulate, model, t_end=case.t_end, samples=SAMPLES, rtol=rtol)
    motion = call()
    rejected = re.search(r"([\d,]+) rejected", motion.message)
    row = Row(
        case.name,
        rtol,
        float("nan"),
        truth.reference.error(motion.node_position),
        float("nan") if motion.error_estimate is None else motion.error_estimate,
        truth.error(motion, find_tolerance(model, case, rtol)),
        float(np.ptp(model.structure.node_position, axis=0).max()),
        truth.reference.uncertainty,
        motion.n_steps,
        int(rejected[1].replace(",", "")) if rejected else 0,
        motion.method,
        motion.status,
    )
    return row, call


def find_tolerance(model: CompiledModel, case: Case, rtol: float) -> Tolerance:
    """Return the tolerance that the call of a case keeps to by default."""
    options = read_stepping(None).with_method("auto", rtol)
    motion = read_motion(model, options, case.t_end, SAMPLES, None, None, None, None)
    return tolerance_of_options(model.manifest, set_atol_by_motion(motion, options))


def time_rows(rows: Mapping[str, tuple[Row, Callable[[], object]]], rounds: int) -> None:
    """Measure the calls in rounds that take turns."""
    runs = {}
    for name, (_, call) in rows.items():
        once = measure_call(call)
        runs[name] = partial(measure_call, call, max(1, min(100, int(ENOUGH / once))))
    for name, seconds in take_turns(runs, rounds).items():
        rows[name][0].seconds = float(np.median(seconds))


def main() -> None:
    """Print the table, and write it where asked to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--references", type=Path, required=True, help="folder of the certified motions")
    parser.add_argument("--only", nargs="*", default=[], help="words of the names of structures")
    parser.add_argument("--rtol", nargs="*", type=float, default=RTOLS, help="relative tolerances")
    parser.add_argument("--quick", action="store_true", help="fewer rounds")
    parser.add_argument("--ours-only", action="store_true", help="without other programs")
    parser.add_argument("--json", type=Path, help="file for the rows")
    words = parser.parse_args()
    rows = {}
    for case in CASES:
        if words.only and not any(word in case.name for word in words.only):
            continue
        truth = find_truth(case, words.references)
        for rtol in words.rtol:
            rows[f"{case.name} {rtol:.0e}"] = prepare(case, rtol, truth)
    time_rows(rows, 3 if words.quick else ROUNDS)
    found = [row for row, _ in rows.values()]
    print(describe_origin())
    print(table_text(HEADS, [row.cells() for row in found]))
    if words.json:
        words.json.write_text(json.dumps([asdict(row) for row in found], indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
