"""Eleven equilibria of the prism under load (LIN Table 2) in one call of the generated C: microseconds.

python benchmarks/lin_prism.py
"""

import statistics
import time

import numpy as np

from tensegrity_codegen.runtime.statics.c_equilibrium import EquilibriumSolver
from tensegrity_codegen.studies.papers.lin.tables import compile_prism, place_load

CALLS = 200
ROUNDS = 9
AXES = "xyz"


def measure(top: int, axis: int, sign: float, tension_only: bool) -> tuple[float, int, str]:
    """Return the median time of a path from 0 to 10 N [us], Newton steps in it, and its status."""
    model = compile_prism(tension_only=tension_only)
    solver = EquilibriumSolver(model)
    loads = np.array([place_load(top, sign * k * np.eye(3)[axis]) for k in range(11)])
    found = solver.follow(loads)
    return time_path(solver, loads), int(found.iterations.sum()), found.status


def time_path(solver: EquilibriumSolver, loads: np.ndarray) -> float:
    """Return the median time of a call [us]."""
    times = []
    for _ in range(ROUNDS):
        started = time.perf_counter()
        for _ in range(CALLS):
            solver.follow(loads)
        times.append((time.perf_counter() - started) / CALLS)
    return 1e6 * statistics.median(times)


def main() -> None:
    """Print the table; the times hold the call from Python, which an empty path shows."""
    print("| load | springs | status | Newton steps | us for 11 equilibria |")
    print("|---|---|---|---|---|")
    worst = 0.0
    for top in (1, 2, 3):
        for axis in range(3):
            for sign in (1.0, -1.0):
                for tension_only in (False, True):
                    taken, steps, status = measure(top, axis, sign, tension_only)
                    worst = max(worst, taken)
                    law = "tension-only" if tension_only else "linear"
                    where = f"B{top} {'+' if sign > 0 else '-'}{AXES[axis]}"
                    print(f"| {where} | {law} | {status} | {steps} | {taken:.1f} |")
    empty = time_path(EquilibriumSolver(compile_prism()), np.zeros((0, 3, 3)))
    print(f"\nslowest: {worst:.1f} us, of which the call from Python: {empty:.1f} us; asked for: below 300")


if __name__ == "__main__":
    main()
