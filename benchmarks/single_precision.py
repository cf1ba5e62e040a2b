"""Error of single precision on the prism, by its distance from the origin, in two formulations.

    python benchmarks/single_precision.py

The largest error of a member tension over the largest tension, of a library of floats
against one of doubles: at the same deformed state, whose coordinates are floats, and at the state that the
rounding of the coordinates makes of the exact one.
"""

from dataclasses import replace

import numpy as np
from harness.turns import EXAMPLES

from tensegrity_codegen import build_library, load_scene

PRISM = EXAMPLES / "prism.toml"
OFFSETS = (0.0, 1.0, 10.0, 100.0, 1000.0)
QUANTITIES = ("member_tension",)


def find_errors(formulation: str, offset: float) -> list[float]:
    """Return both errors of the tensions, the prism moved by `offset` along x, y and z."""
    structure, request = load_scene(PRISM)
    position = structure.node_position + offset
    wanted = replace(request.wanting(*QUANTITIES), formulation=formulation)
    moved = structure.with_changes(node_position=position)
    results: list[list[np.ndarray]] = []
    found = np.zeros(0, dtype=np.float32)
    for precision in ("double", "single"):
        model = build_library(moved, replace(wanted, precision=precision)).load()
        if precision == "double":
            exact = model.nominal("coordinate") + 1e-3 * np.sin(np.arange(len(model.nominal("coordinate"))))
            found = exact.astype(np.float32)
            results.append([np.asarray(model.compute(name, coordinate=exact)) for name in QUANTITIES])
        state = found.astype(model.dtype)
        values = [model.compute(name, coordinate=state) for name in QUANTITIES]
        results.append([np.asarray(value, dtype=np.float64) for value in values])
    largest = np.abs(results[0][0]).max()
    true, same, single = results
    return [float(np.abs(other[0] - single[0]).max() / largest) for other in (same, true)]


def main() -> None:
    """Print one row an offset."""
    print("| offset [m] | node_position: same state | rounded state | node_distance: same | rounded |")
    for offset in OFFSETS:
        cells = [f"{e:.1e}" for name in ("node_position", "node_distance") for e in find_errors(name, offset)]
        print(f"| {offset:g} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
