"""The tower of the third paper driven through its 18 tendons by a table: in C and by SciPy, at equal error.

python benchmarks/profiles.py [--rounds 5]

Rest lengths and the torque of a planned motion of 5 s are sampled every 0.1 s, and joined by straight lines
or a cubic spline. The reference is DOP853 at its least tolerance, begun anew at every knot. Of each method's
settings the loosest that reaches an error at the samples counts; times are medians of CPU time of `simulate`,
in rounds that take turns. SciPy runs as it did before there were profiles, with a function of time; `auto`
controls the error at the samples, methods by name that of each step.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from harness.turns import markdown_head, markdown_row, time_in_turns
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline

from tensegrity_codegen import CompiledModel, Profile, simulate
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.integrate.scipy_methods import build_derivative
from tensegrity_codegen.runtime.profiles.driven import bind_profile
from tensegrity_codegen.studies.papers.scs.figures import load_paper_tower, plan_paper_motions
from tensegrity_codegen.studies.papers.scs.printed import compile_tower, drive
from tensegrity_codegen.studies.papers.scs.reconfiguration import Reconfiguration

FloatArray = NDArray[np.float64]

END, KNOTS, SAMPLES = 5.0, 51, 11
IN_C = ("rk54", "tsit5", "rk853")
OURS = (*IN_C, "auto")
SCIPY = ("scipy_dop853", "scipy_rk45", "scipy_lsoda", "auto, function")
TOLERANCES = tuple(10.0 ** (-0.5 * k) for k in range(6, 27))
ERRORS = (1e-6, 1e-8, 1e-10)


@dataclass(frozen=True)
class Found:
    """The loosest setting of a method that reaches an error, the error found, and a call that runs it."""

    tolerance: float
    error: float
    run: Callable[[], Any]
    seconds: float = float("nan")


def main() -> None:
    """Print a table for each kind of profile."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    rounds = parser.parse_args().rounds
    tower = load_paper_tower()
    plan = plan_paper_motions(tower)["with_torque"]
    model = compile_tower(tower, IN_C)
    for kind, degree in (("linear", 1), ("cubic", 3)):
        compare(model, plan, kind, degree, rounds)


def compare(model: CompiledModel, plan: Reconfiguration, kind: str, degree: int, rounds: int) -> None:
    """Print what methods in C and of SciPy take for errors, and how many times faster the former are."""
    knots = np.linspace(0.0, END, KNOTS)
    rows = [drive(plan)(float(t)) for t in knots]
    table = {name: np.array([row[name] for row in rows]) for name in ("rest_length", "input")}
    profile = Profile(knots, table, kind)  # type: ignore[arg-type]
    curves = {name: make_interp_spline(knots, values, k=degree) for name, values in table.items()}
    start = {"coordinate": plan.tower.restricted.coordinate(plan.path.at(0.0).s)}
    start["velocity"] = np.zeros(len(start["coordinate"]))
    exact = find_reference(model, profile, start)

    def function(t: float) -> dict[str, FloatArray]:
        return {name: curve(t) for name, curve in curves.items()}

    print(f"\n{kind} profile of {KNOTS} knots, 18 rest lengths and 6 inputs\n")
    print(markdown_head("error", "method", "tolerance", "error found", "CPU time [ms]"))
    least, closest = [], {"C": np.inf, "SciPy": np.inf}
    for error in ERRORS:
        found: dict[str, Found] = {}
        for method in (*OURS, *SCIPY):
            schedule = profile if method in OURS else function
            own = "C" if method in OURS else "SciPy"
            for tolerance in TOLERANCES:
                run = make_run(model, method.split(",")[0], tolerance, schedule, start)
                off = apart(run(), exact)
                closest[own] = min(closest[own], off)
                if off <= error:
                    found[method] = Found(tolerance, off, run)
                    break
        times = time_in_turns({name: item.run for name, item in found.items()}, rounds)
        for name, item in found.items():
            row = (f"{item.tolerance:.1e}", f"{item.error:.1e}", f"{1e3 * times[name]:.2f}")
            print(markdown_row(f"{error:.0e}", name, *row))
        ours, theirs = (min(times[name] for name in found if name in group) for group in (OURS, SCIPY))
        by_auto = times["auto, function"] / times["auto"] if {"auto", SCIPY[-1]} <= found.keys() else np.nan
        least.append(markdown_row(f"{error:.0e}", f"{theirs / ours:.0f}", f"{by_auto:.0f}"))
    heads = ("error", "C, fastest beside SciPy's fastest", "C, auto beside auto with a function")
    print("", markdown_head(*heads), *least, sep="\n")
    print(f"\nsmallest error found: {closest['C']:.1e} in C, {closest['SciPy']:.1e} by SciPy")


def make_run(
    model: CompiledModel, method: str, tolerance: float, schedule: Any, start: dict[str, FloatArray]
) -> Callable[[], Any]:
    """Return a call of `simulate`; the tolerance is that of the steps."""
    control = None if method == "auto" else "steps"
    given = {
        "rtol": tolerance,
        "stepping": Stepping(atol=0.1 * tolerance, control=control),
        "schedule": schedule,
        **start,
    }
    return lambda: simulate(model, END, samples=SAMPLES, method=method, **given)


def apart(run: Any, exact: FloatArray) -> float:
    """Return the largest error of coordinates and velocities at the samples [rad, m, rad/s, m/s]."""
    if run.status != "ok":
        return float("inf")
    return float(np.abs(np.hstack([run.coordinate, run.velocity]) - exact).max())


def find_reference(model: CompiledModel, profile: Profile, start: dict[str, FloatArray]) -> FloatArray:
    """Return the states at the samples (n_t, n_states) by DOP853 at 3e-14, begun anew at each knot."""
    derivative = build_derivative(model, {}, bind_profile(model, profile, {}, END))
    state = np.concatenate([start["coordinate"], start["velocity"]])
    times, found = np.linspace(0.0, END, SAMPLES), [state]
    for first, last in pairwise(np.unique(np.concatenate([profile.time, times])).tolist()):
        run = solve_ivp(derivative, (first, last), state, "DOP853", rtol=3e-14, atol=1e-15)
        state = run.y[:, -1]
        if last in times:
            found.append(state)
    return np.array(found)


if __name__ == "__main__":
    main()
