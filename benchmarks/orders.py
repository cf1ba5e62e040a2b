"""Observed orders of rk4, rk54, rk853 and radau on a smooth motion and through cables that go slack and taut.

python benchmarks/orders.py

The order is the slope of log(error) over log(steps), fitted over steps (rk4) or tolerances (the others),
errors at the end against rk853 at 1e-14. A soft bar flies about with one end between four cables; in the
smooth case these are so short that they stay taut. rk4 and radau do not end steps at events.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from tensegrity_codegen.pipeline import SIMULATION_QUANTITIES, build_library
from tensegrity_codegen.request import ModelRequest
from tensegrity_codegen.runtime.integrate import integrate_once
from tensegrity_codegen.runtime.model import CompiledModel
from tensegrity_codegen.runtime.motion import Motion
from tensegrity_codegen.runtime.options import RunOptions
from tensegrity_codegen.runtime.raw_trajectory import RawTrajectory
from tensegrity_codegen.scene.assemble import assemble
from tensegrity_codegen.scene.read import parse_scene

SCENE = {
    "name": "net",
    "axes": "xz",
    "nodes": {
        "left": {"position": [0, 0, 0], "anchored": True},
        "right": {"position": [3, 0, 0], "anchored": True},
        "top": {"position": [1.3, 0, 2.5], "anchored": True},
        "low": {"position": [1.7, 0, -2.2], "anchored": True},
        "mass": {"position": [1.45, 0, 0.1], "mass": 0.3, "velocity": [1.0, 0, 0.7]},
        "end": {"position": [1.75, 0, 0.5], "mass": 0.2, "velocity": [1.0, 0, 0.7]},
    },
    "members": {
        "rod": {"kind": "bar", "nodes": ["mass", "end"], "spring_constant": 80.0, "rest_length": 0.5},
    },
}
CABLES = {"left": (1.5, 40.0), "right": (1.6, 60.0), "top": (2.5, 30.0), "low": (2.4, 50.0)}
SPAN = 6.0
STEPS = {"rk4": (2000, 4000, 8000, 16000, 32000)}
TOLERANCES = {
    "rk54": (1e-7, 1e-8, 1e-9, 1e-10, 1e-11),
    "rk853": (1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11),
    "radau": (1e-5, 1e-6, 1e-7, 1e-8),
}
THEORY = {"rk4": 4, "rk54": 5, "rk853": 8, "radau": 5}


def model_of(slack: bool) -> CompiledModel:
    """Return the model; slack: whether cables go slack."""
    members = dict(SCENE["members"])  # type: ignore[call-overload]
    for name, (rest, stiffness) in CABLES.items():
        members[f"c_{name}"] = {
            "kind": "cable",
            "nodes": [name, "mass"],
            "rest_length": rest if slack else 0.3 * rest,
            "spring_constant": stiffness,
        }
    structure = assemble(parse_scene({**SCENE, "members": members}, where="net"))[0]
    request = ModelRequest(SIMULATION_QUANTITIES, integrators=("rk4", "rk54", "rk853", "radau"))
    return build_library(structure, request).load()


def runs(motion: Motion) -> dict[str, list[Callable[[], RawTrajectory]]]:
    """Return the runs of each method, from coarse to fine."""
    asked = {"rk4": [RunOptions("rk4", step=SPAN / n) for n in STEPS["rk4"]]}
    asked |= {name: [RunOptions(name, t, t) for t in TOLERANCES[name]] for name in TOLERANCES}
    return {
        name: [partial(integrate_once, motion, options) for options in each] for name, each in asked.items()
    }


def main() -> None:
    """Print one line for each method and case."""
    print("case         method  theory  observed  events  steps             errors")
    for word, slack in (("smooth", False), ("slack, taut", True)):
        model = model_of(slack)
        state = np.concatenate([model.nominal("coordinate"), model.nominal("velocity")])
        motion = Motion(model, state, np.array([0.0, SPAN]))
        best = integrate_once(motion, RunOptions("rk853", 1e-14, 1e-14))
        for name, calls in runs(motion).items():
            found = [call() for call in calls]
            errors = [float(np.abs(raw.state[-1] - best.state[-1]).max()) for raw in found]
            steps = [raw.n_steps for raw in found]
            order = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
            print(
                f"{word:12} {name:6} {THEORY[name]:7} {order:9.2f} {found[-1].log.count:7}  "
                f"{steps[0]:6} .. {steps[-1]:6}  {errors[0]:.1e} .. {errors[-1]:.1e}"
            )


if __name__ == "__main__":
    main()
