"""Observed orders of rk4, rk54, rk853 and radau on a smooth motion and through cables that go slack and taut.

python benchmarks/orders.py

The order is the slope of log(error) over log(steps), errors at the end against rk853 at 1e-14. rk4, rk54 and
rk853 take equal steps, each cut at its events; radau chooses its own by the tolerance, and one and a half an
event do not count: the glide over it, and half of the step that it cuts. A soft bar flies about with one end
between four cables; in the smooth case these are so short that they stay taut.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.accuracy.integrate import integrate_once
from tensegrity_codegen.runtime.integrate.integration import BoundIntegrator
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.trajectory.simulation_quantities import SIMULATION_QUANTITIES
from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.tables.manifest import EVENT_KINDS
from tensegrity_codegen.tables.request import ModelRequest

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
STEPS = {
    "rk4": (2000, 4000, 8000, 16000),
    "rk54": (800, 1600, 3200, 6400),
    "rk853": (250, 400, 640, 1000),
}
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
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
    integrators = ("rk4", "rk54", "rk853", "radau")
    request = ModelRequest(SIMULATION_QUANTITIES, integrators=integrators, events=("auto",))
    return build_library(structure, request).load()


def take_equal_steps(method: str, motion: Motion, count: int) -> tuple[NDArray[np.float64], int]:
    """Return the end state and the number of events; the tolerance is one that every step meets."""
    bound = BoundIntegrator(method, motion)
    null, now, counts = bound.ffi.NULL, bound.ffi.new("double *"), bound.ffi.new("integrator_run *")
    counts.watch = EVENT_KINDS["cable"]
    for end in np.linspace(0.0, SPAN, count + 1)[1:].tolist():
        step = bound.ffi.new("double *", SPAN / count)
        given = (end, 1e9, 1e9, 10_000, now, step, bound.pointer(bound.state), *bound.arguments(), 0)
        status = bound.call(*given, null, null, bound.n_sampled, counts, bound.pointer(bound.work))
        assert (status, now[0]) == (0, end)
    return bound.state, int(counts.n_events)


def follow(motion: Motion, name: str) -> Iterator[tuple[int, int, NDArray[np.float64]]]:
    """Yield steps, events and end state of runs from coarse to fine."""
    if name == "radau":
        for tol in TOLERANCES:
            raw = integrate_once(motion, RunOptions(name, tol, tol))
            yield raw.n_steps - 3 * raw.log.count // 2, raw.log.count, raw.state[-1]
        return
    for count in STEPS[name]:
        if name == "rk4":
            raw = integrate_once(motion, RunOptions(name, step=SPAN / count))
            yield count, raw.log.count, raw.state[-1]
        else:
            state, events = take_equal_steps(name, motion, count)
            yield count, events, state


def main() -> None:
    """Print one line for each method and case."""
    print("case         method  theory  observed  events  steps             errors")
    for word, slack in (("smooth", False), ("slack, taut", True)):
        model = model_of(slack)
        state = np.concatenate([model.nominal("coordinate"), model.nominal("velocity")])
        motion = Motion(model, state, np.array([0.0, SPAN]))
        best = integrate_once(motion, RunOptions("rk853", 1e-14, 1e-14)).state[-1]
        for name, theory in THEORY.items():
            steps, events, states = zip(*follow(motion, name), strict=True)
            errors = [float(np.abs(found - best).max()) for found in states]
            order = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
            print(
                f"{word:12} {name:6} {theory:7} {order:9.2f} {events[-1]:7}  "
                f"{steps[0]:6} .. {steps[-1]:6}  {errors[0]:.1e} .. {errors[-1]:.1e}"
            )


if __name__ == "__main__":
    main()
