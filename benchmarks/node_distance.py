"""What the right-hand side costs in node distances against node positions: C time and operations.

python benchmarks/node_distance.py
"""

from __future__ import annotations

from build_time import PRISM
from timing import time_functions

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.flags import FLAG_SETS
from tensegrity_codegen.codegen.toolchain import find_compiler
from tensegrity_codegen.pipeline import load_scene
from tensegrity_codegen.request import ModelRequest
from tensegrity_codegen.structure import Structure

SCENES = ("prism", "icosahedron", "tower")
QUANTITIES = ("acceleration", "state_derivative")
CHOICES = {
    "positions": ModelRequest(QUANTITIES),
    "connected": ModelRequest(QUANTITIES, formulation="node_distance", options={"pairs": "connected"}),
    "full": ModelRequest(QUANTITIES, formulation="node_distance", options={"pairs": "full"}),
}


def measure(structure: Structure, request: ModelRequest, flags: str) -> tuple[float, int]:
    """Return nanoseconds and operations of one acceleration, the least of three medians."""
    source = emit(structure, request)
    times = [time_functions(source, find_compiler(), FLAG_SETS[flags])["acceleration"] for _ in range(3)]
    return min(times), source.manifest.functions[0].operations


def main() -> None:
    """Print the table."""
    print("| scene | members | flags | pairs | operations | ns | ratio to positions |")
    print("|---|---|---|---|---|---|---|")
    for name in SCENES:
        structure, _ = load_scene(PRISM.parent / f"{name}.toml")
        for flags in ("reference", "native"):
            base = 0.0
            for pairs, request in CHOICES.items():
                nanoseconds, operations = measure(structure, request, flags)
                base = base or nanoseconds
                print(
                    f"| {name} | {structure.n_members} | {flags} | {pairs} | {operations} "
                    f"| {nanoseconds:.0f} | {nanoseconds / base:.2f} |"
                )


if __name__ == "__main__":
    main()
