"""Optimisation with IPOPT: compiled functions by casadi.external against the same functions as CasADi graphs.

    python benchmarks/casadi_external.py

Shape control of a prism (rest lengths with which a node reaches a point, tensions above 1 N) and optimal
control of a planar arm in 50 steps. All ways solve the same problem with exact second derivatives; what
differs is who evaluates them: compiled C, CasADi's virtual machine call by call, or CasADi's virtual machine
with the whole problem as one graph (`expand`). The total time is that of building the solver and of solving;
compilation of the library, which happens once for a scene, is listed apart.
"""

import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from harness.turns import EXAMPLES

from tensegrity_codegen import build_library, load_scene, symbolic_functions
from tensegrity_codegen.pipeline.scene_functions import SymbolicFunctions

REPEATS = 5
QUIET = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-10}

# A planar arm of crossed bars, held at its left end; its upper and lower cables have motors.
ARM_LENGTH, ARM_HEIGHT, ARM_DENSITY = 0.4, 0.3, 100.0  # [m], [m], [N/m]


def write_arm(n_modules: int = 3) -> str:
    """Return the scene of a planar arm of so many modules."""
    diagonal = ARM_DENSITY * float(np.hypot(ARM_LENGTH, ARM_HEIGHT))
    lines = [
        'name = "arm"',
        'axes = "xz"',
        "gravity = [0, -9.81]",
        "[model]",
        'quantities = ["acceleration", "member_tension", "node_residual", "tangent_stiffness"]',
        "[classes]",
        f'bar = {{ kind = "bar", spring_constant = 1e5, mass = 0.1, prestress = {-diagonal!r} }}',
        f'rail = {{ kind = "cable", spring_constant = 1000, damping = 5, prestress = '
        f"{ARM_DENSITY * ARM_LENGTH!r} }}",
        f'post = {{ kind = "cable", spring_constant = 1000, damping = 5, prestress = '
        f"{2 * ARM_DENSITY * ARM_HEIGHT!r} }}",
        "[nodes]",
    ]
    for k in range(n_modules + 1):
        held = ", anchored = true" if k == 0 else ""
        lines += [
            f"{row}{k} = {{ position = [{k * ARM_LENGTH!r}, {height!r}], mass = 0.1{held} }}"
            for row, height in (("a", 0.0), ("b", ARM_HEIGHT))
        ]
    lines += ["[members]"]
    for k in range(1, n_modules + 1):
        last = f", prestress = {ARM_DENSITY * ARM_HEIGHT!r}" if k == n_modules else ""
        lines += [
            f'up{k} = {{ class = "bar", nodes = ["a{k - 1}", "b{k}"] }}',
            f'down{k} = {{ class = "bar", nodes = ["b{k - 1}", "a{k}"] }}',
            f'lower{k} = {{ class = "rail", nodes = ["a{k - 1}", "a{k}"] }}',
            f'upper{k} = {{ class = "rail", nodes = ["b{k - 1}", "b{k}"] }}',
            f'post{k} = {{ class = "post", nodes = ["a{k}", "b{k}"]{last} }}',
        ]
    for k in range(1, n_modules + 1):
        for row in ("lower", "upper"):
            lines += ["[[actuators]]", f'name = "{row}{k}"', f'members = "{row}{k}"', "rate = 0.5"]
            lines += [f"range = [{0.5 * ARM_LENGTH!r}, {1.2 * ARM_LENGTH!r}]"]
    return "\n".join(lines) + "\n"


ARM = write_arm()


@dataclass(frozen=True)
class Problem:
    """A nonlinear program in CasADi's form, with its start and bounds."""

    nlp: dict[str, ca.MX]
    bounds: dict[str, Any]


@dataclass(frozen=True)
class Solution:
    """What IPOPT found, its statistics, and the time to build the solver and to solve [s]."""

    x: np.ndarray
    objective: float
    stats: dict[str, Any]
    build: float
    solve: float

    @property
    def total(self) -> float:
        """Time to build the solver and to solve [s]."""
        return self.build + self.solve


Functions = Mapping[str, ca.Function]


def externals(name: str, library: Path, symbolic: SymbolicFunctions) -> dict[str, ca.Function]:
    """Return the functions of a compiled library."""
    return {quantity: ca.external(f"{name}_{quantity}", str(library)) for quantity in symbolic}


def prism_shape(functions: Functions, symbolic: SymbolicFunctions) -> Problem:
    """Return the program: the smallest changes of rest lengths with which node t1 reaches a point 21 mm away.

    Unknowns are the coordinates and the rest lengths of all members; the prism is in equilibrium, and its
    cables have at least 1 N.
    """
    q0, u0 = symbolic.nominal["coordinate"], symbolic.nominal["rest_length"]
    q, u = ca.MX.sym("q", len(q0)), ca.MX.sym("u", len(u0))
    force = functions["node_residual"](q, u)
    tension = functions["member_tension"](q, u)
    place = [symbolic.coordinate_name.index(f"t1_{axis}") for axis in "xyz"]
    target = q0[place].ravel() + np.array([0.005, -0.005, 0.02])
    n_force, n_bars = len(q0), 3
    n_cables = len(u0) - n_bars
    low = [*[0.0] * n_force, *[1.0] * n_cables, *target]
    high = [*[0.0] * n_force, *[np.inf] * n_cables, *target]
    constraints = ca.vertcat(force, tension[n_bars:], q[place])
    nlp = {"x": ca.vertcat(q, u), "f": 100.0 * ca.sumsqr(u - u0), "g": constraints}
    return Problem(nlp, {"x0": np.concatenate([q0, u0]), "lbg": low, "ubg": high})


def arm_control(
    functions: Functions, symbolic: SymbolicFunctions, start: np.ndarray, steps: int = 50
) -> Problem:
    """Return the program: the tip of the arm rises by 50 mm within 1 s, from rest at `start` to rest.

    Unknowns are coordinates, velocities and inputs at every step of the implicit midpoint rule.
    """
    n, m, h = len(start), len(symbolic.input_name), 1.0 / steps
    q, v, u = (ca.MX.sym(name, size, steps + k) for name, size, k in (("q", n, 1), ("v", n, 1), ("u", m, 0)))
    tip = [symbolic.coordinate_name.index(f"{row}3_z") for row in "ab"]
    constraints, low, high = [], [], []

    def require(value: ca.MX, least: Any, most: Any) -> None:
        constraints.append(value)
        low.append(np.broadcast_to(least, value.numel()))
        high.append(np.broadcast_to(most, value.numel()))

    require(q[:, 0], start, start)
    require(v[:, 0], 0.0, 0.0)
    cost = 1e-3 * ca.sumsqr(v)
    for k in range(steps):
        q_mid, v_mid = 0.5 * (q[:, k] + q[:, k + 1]), 0.5 * (v[:, k] + v[:, k + 1])
        require(q[:, k + 1] - q[:, k] - h * v_mid, 0.0, 0.0)
        rate = functions["acceleration"](q_mid, v_mid, u[:, k])
        require((v[:, k + 1] - v[:, k]) - h * rate, 0.0, 0.0)
        cost += 100.0 * h * ca.sumsqr(u[:, k]) + (1e3 * h * ca.sumsqr(u[:, k] - u[:, k - 1]) if k else 0.0)
    require(q[tip, steps], start[tip] + 0.05, start[tip] + 0.05)
    require(v[:, steps], 0.0, 0.0)
    x = ca.veccat(q, v, u)
    guess = np.concatenate([np.tile(start, steps + 1), np.zeros(n * (steps + 1) + m * steps)])
    nlp = {"x": x, "f": cost, "g": ca.vertcat(*constraints)}
    return Problem(nlp, {"x0": guess, "lbg": np.concatenate(low), "ubg": np.concatenate(high)})


def solve(build: Callable[[], Problem], **options: Any) -> Solution:
    """Return IPOPT's solution of a program, with the time of building it and its derivatives."""
    started = time.perf_counter()
    problem = build()
    solver = ca.nlpsol("solver", "ipopt", problem.nlp, {**QUIET, **options})
    built = time.perf_counter()
    found = solver(**problem.bounds)
    done = time.perf_counter()
    x = np.array(found["x"]).ravel()
    return Solution(x, float(found["f"]), solver.stats(), built - started, done - built)


@dataclass(frozen=True)
class Case:
    """One problem: its scene, what is needed of it, and the program from its functions."""

    name: str
    scene: Path
    quantities: tuple[str, ...]
    parameters: Mapping[str, tuple[int, ...]]
    make: Callable[[Functions, SymbolicFunctions, Any], Problem]


def _prism(functions: Functions, symbolic: SymbolicFunctions, built: Any) -> Problem:
    return prism_shape(functions, symbolic)


def _arm(functions: Functions, symbolic: SymbolicFunctions, built: Any) -> Problem:
    return arm_control(functions, symbolic, find_rest(symbolic))


def find_rest(symbolic: SymbolicFunctions) -> np.ndarray:
    """Return the coordinates at which the arm is at rest under its weight."""
    x = ca.MX.sym("x", len(symbolic.nominal["coordinate"]))
    force = symbolic["node_residual"](x, np.zeros(len(symbolic.input_name)))
    root = ca.rootfinder("rest", "newton", {"x": x, "g": force})
    return np.array(root(symbolic.nominal["coordinate"], [])).ravel()


def list_cases(folder: Path) -> tuple[Case, ...]:
    """Return the two problems; their scenes are written to a folder."""
    arm, prism = folder / "arm.toml", folder / "prism.toml"
    arm.write_text(ARM)
    prism.write_text(
        (EXAMPLES / "prism.toml").read_text().replace('anchor_bottom = "z"', "anchor_bottom = true")
    )
    return (
        Case(
            "prism shape",
            prism,
            ("node_residual", "member_tension"),
            {"rest_length": tuple(range(12))},
            _prism,
        ),
        Case("arm, 50 steps", arm, ("acceleration", "node_residual"), {}, _arm),
    )


PROBLEMS = ("prism shape", "arm, 50 steps")


def _compare(case: Case) -> None:
    structure, request = load_scene(case.scene)
    wanted = request.wanting(*case.quantities, parameters=case.parameters)
    built = build_library(structure, replace(wanted, interfaces=("casadi_hessian",)))
    symbolic = symbolic_functions(case.scene, quantities=case.quantities, parameters=case.parameters)
    compiled = externals(
        structure.name,
        built.path,
        SymbolicFunctions({name: symbolic[name] for name in case.quantities}, {}, (), ()),
    )
    ways: dict[str, tuple[Functions, dict[str, Any]]] = {
        "casadi.external": (compiled, {}),
        "CasADi graph": (symbolic, {}),
        "CasADi graph, expand": (symbolic, {"expand": True}),
    }
    best: dict[str, Solution] = {}
    for _ in range(REPEATS):
        for way, (functions, options) in ways.items():
            found = solve(lambda functions=functions: case.make(functions, symbolic, built), **options)
            if way not in best or found.total < best[way].total:
                best[way] = found
    own = best["casadi.external"]
    print(f"{case.name}: {len(own.x)} unknowns, library {built.seconds:.1f} s (once)")
    for way, found in best.items():
        gap = float(np.abs(found.x - own.x).max())
        print(
            f"  {way:22s} {found.stats['return_status']:16s} {found.stats['iter_count']:4d} iterations"
            f"  build {1e3 * found.build:7.1f} ms  solve {1e3 * found.solve:7.1f} ms"
            f"  total/external {found.total / own.total:5.2f}  largest difference {gap:.1e}"
        )


def main() -> None:
    """Print one block a problem."""
    with tempfile.TemporaryDirectory() as folder:
        for case in list_cases(Path(folder)):
            _compare(case)


if __name__ == "__main__":
    main()
