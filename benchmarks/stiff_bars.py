"""Time against stiffness of the bars: radau, our explicit methods, and IDAS and CVODES through CasADi.

python benchmarks/stiff_bars.py [prism | icosahedron | tower1000] [seconds]

Every run starts from the scene's own state, bars at the same force whatever their stiffness. The error is the
largest of all positions at the end, against radau at 1e-8 or at twice the vibration of the bars at the start;
how far radau at ten times that tolerance is from it is shown.
IDAS and CVODES integrate q'' = H^-1 f as CasADi makes it, Jacobians included; only the call is timed.
"""

from __future__ import annotations

import statistics
import sys
import time
import tomllib
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np

from tensegrity_codegen.pipeline import build_library, load_scene
from tensegrity_codegen.request import ModelRequest
from tensegrity_codegen.runtime.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.model import CompiledModel
from tensegrity_codegen.runtime.radau import integrate_radau
from tensegrity_codegen.scene.assemble import assemble
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.structure import Structure
from tensegrity_codegen.symbolic.build import build_model

EXAMPLES = Path(__file__).parent.parent / "tensegrity_codegen" / "scene" / "examples"
TOWER = """
name = "tower"
gravity = [0, 0, -9.81]
[classes.bar]
kind = "bar"
axial_stiffness = 2e5
density = 1600
radius = 0.01
[classes.cable]
kind = "cable"
axial_stiffness = 1e4
prestress = 10.0
[shape]
kind = "tower"
stages = 56
bars = 3
radius = 0.5
height = 1.0
node_mass = 0.1
anchor_bottom = true
"""
RATIOS = (1e3, 1e5, 1e7, 1e9)
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
PATIENCE = 60.0  # seconds that a run of a peer may take before the next, tighter one is left out
ROUNDS = 5


def scaled(structure: Structure, ratio: float) -> Structure:
    """Return the structure with all bars `ratio` times as stiff as the stiffest cable, at the same forces."""
    mu = structure.spring_constant + structure.axial_stiffness / structure.rest_length
    stiff = ratio * mu[structure.tension_only].max()
    bars = ~structure.tension_only
    rest = structure.member_length() - structure.static_tension() / stiff
    return structure.with_changes(
        spring_constant=np.where(bars, stiff, structure.spring_constant),
        axial_stiffness=np.where(bars, 0.0, structure.axial_stiffness),
        rest_length=np.where(bars, rest, structure.rest_length),
    )


def load(name: str) -> tuple[Structure, str]:
    """Return a structure and the emitter that serves it."""
    if name == "tower1000":
        return assemble(parse_scene(tomllib.loads(TOWER), where="tower"))[0], "table"
    return load_scene(EXAMPLES / f"{name}.toml")[0], "unrolled"


def compiled(structure: Structure, emitter: str) -> CompiledModel:
    """Return the model with its integrators."""
    request = ModelRequest(("acceleration",), integrators=("radau", "rk853"), emitter=emitter)
    return build_library(structure, request).load()


def timed(call: object, rounds: int = ROUNDS) -> tuple[float, object]:
    """Return the median time of a call [s] and its last result."""
    times = []
    for _ in range(rounds):
        started = time.perf_counter()
        result = call()  # type: ignore[operator]
        times.append(time.perf_counter() - started)
        if times[0] > 1.0:
            break
    return statistics.median(times), result


def report(ratio: float, method: str, tolerance: float, seconds: float, error: float, more: str = "") -> None:
    """Print one line of the table."""
    print(
        f"{ratio:8.0e} {method:>7} {tolerance:8.0e} {1e3 * seconds:11.3f} ms {error:9.1e} m  {more}",
        flush=True,
    )


def own(model: CompiledModel, ratio: float, span: float) -> np.ndarray:
    """Time our methods; return the reference positions at the end."""
    n = len(model.manifest.coordinate_name)
    state = np.concatenate([model.nominal("coordinate"), model.nominal("velocity")])
    ends = np.array([0.0, span])
    # Beyond twice the vibration that stiff bars start with every step would have to follow it.
    vibration = integrate_radau(model, state, ends, 1e-2, 1e-2).evidence["vibration"]
    tight = 1e-8 if ratio <= 1e5 else max(1e-8, 2.0 * vibration)
    near, exact = (integrate_radau(model, state, ends, tol, tol).state[-1, :n] for tol in (10 * tight, tight))
    print(f"{ratio:8.0e} references differ by {np.abs(near - exact).max():.1e} m")
    for tolerance in TOLERANCES:
        if tolerance < tight:
            break
        seconds, raw = timed(lambda tol=tolerance: integrate_radau(model, state, ends, tol, tol))
        told = f"{raw.n_steps} steps, {raw.evidence['iterations']} iterations"
        report(ratio, "radau", tolerance, seconds, np.abs(raw.state[-1, :n] - exact).max(), told)
    for tolerance in (1e-3, 1e-5):
        if ratio > 1e5:
            break
        seconds, raw = timed(lambda tol=tolerance: integrate_adaptive("rk853", model, state, ends, tol, tol))
        told = f"{raw.n_steps} steps"
        report(ratio, "rk853", tolerance, seconds, np.abs(raw.state[-1, :n] - exact).max(), told)
    return exact


def peers(structure: Structure, ratio: float, span: float, exact: np.ndarray) -> None:
    """Time SUNDIALS through CasADi."""
    model = build_model(structure, ModelRequest(()))
    x = ca.vertcat(model.arguments["coordinate"].symbol, model.arguments["velocity"].symbol)
    dae = {"x": x, "ode": model.expression("state_derivative")}
    names = ("coordinate", "velocity")
    start = np.concatenate([model.arguments[name].nominal.ravel() for name in names])
    for method in ("idas", "cvodes"):
        for tolerance in (1e-4, 1e-6, 1e-8):
            options = {"abstol": tolerance, "reltol": tolerance, "max_num_steps": 10**7}
            solver = ca.integrator("peer", method, dae, 0.0, span, options)
            try:
                seconds, found = timed(lambda solver=solver: solver(x0=start), 3)
            except RuntimeError as error:
                print(f"{ratio:8.0e} {method:>7} {tolerance:8.0e} fails: {str(error).splitlines()[-1][:60]}")
                continue
            end = np.array(found["xf"]).ravel()[: len(exact)]
            report(ratio, method, tolerance, seconds, np.abs(end - exact).max())
            if seconds > PATIENCE:
                break


def main() -> None:
    """Print the table of one structure."""
    name = sys.argv[1] if len(sys.argv) > 1 else "prism"
    span = float(sys.argv[2]) if len(sys.argv) > 2 else 1.0
    structure, emitter = load(name)
    print(f"{name}: {structure.n_members} members, {span:g} s")
    for ratio in RATIOS:
        stiff = scaled(structure, ratio)
        exact = own(compiled(stiff, emitter), ratio, span)
        peers(replace(stiff), ratio, span, exact)


if __name__ == "__main__":
    main()
