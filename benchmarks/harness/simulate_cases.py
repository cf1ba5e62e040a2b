"""Seven structures whose motions are simulated, and their certified motions."""

import hashlib
import json
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from live_pages import write_net
from stiff_bars import TOWER

from harness.turns import EXAMPLES
from tensegrity_codegen.pipeline.compile_scene import compile_scene, load_scene
from tensegrity_codegen.runtime.accuracy.tolerance import Tolerance
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.studies.work_precision.library_contenders import ATOL_OF_RTOL
from tensegrity_codegen.studies.work_precision.measure import Reference, find_agreement
from tensegrity_codegen.system.arrays import FloatArray

SAMPLES = 11
MAX_STEPS = 100_000_000
# Methods that certify a reference: two runs of different ones, those that agree best. Rounding keeps some
# from the tightest setting, or makes it no better.
CERTIFYING = {"rk853": (1e-13, 1e-12, 1e-10), "rk54": (1e-13, 1e-12, 1e-10)}
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
    structure, _ = load_scene(scene)
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


def place_file(case: Case, folder: Path, ending: str) -> Path:
    """Return where what is known of a case is kept."""
    key = hashlib.sha256(json.dumps([case.scene(), case.t_end, CERTIFYING]).encode()).hexdigest()[:12]
    return folder / f"{case.name.replace(' ', '_')}-{key}{ending}"


def find_truth(case: Case, folder: Path) -> Truth:
    """Return the reference of a case, from its file if there is one."""
    scene, path = case.scene(), place_file(case, folder, ".npz")
    if not path.exists():
        model = compile_scene(scene, for_=("simulate",), integrators=tuple(CERTIFYING))
        runs: dict[str, dict[str, Trajectory]] = {}
        for method, rtols in CERTIFYING.items():
            for rtol in rtols:
                stepping = Stepping(atol=ATOL_OF_RTOL * rtol, control="steps", max_steps=MAX_STEPS)
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
