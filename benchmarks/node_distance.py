"""What the right-hand side costs in node distances against node positions: C time and operations.

python benchmarks/node_distance.py
"""

from build_time import PRISM

from tensegrity_codegen.codegen.compilation.flags import FLAG_SETS
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.measure import time_functions
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.request import ModelRequest

SCENES = ("prism", "icosahedron", "tower")
QUANTITIES = ("acceleration", "state_derivative")
CHOICES = {
    "positions": ModelRequest(QUANTITIES),
    "connected": ModelRequest(QUANTITIES, formulation="node_distance", options={"pairs": "connected"}),
    "full": ModelRequest(QUANTITIES, formulation="node_distance", options={"pairs": "full"}),
}


ROUNDS = 5


def measure(structure: Structure, flags: str) -> dict[str, tuple[float, int]]:
    """Return pairs -> nanoseconds and operations of one acceleration: the least median of rounds in turn."""
    sources = {pairs: emit(structure, request) for pairs, request in CHOICES.items()}
    times: dict[str, list[float]] = {pairs: [] for pairs in CHOICES}
    for _ in range(ROUNDS):
        for pairs, source in sources.items():
            times[pairs].append(time_functions(source, find_compiler(), FLAG_SETS[flags])["acceleration"])
    return {
        pairs: (min(times[pairs]), source.manifest.functions[0].operations)
        for pairs, source in sources.items()
    }


def main() -> None:
    """Print the table."""
    print("| scene | members | flags | pairs | operations | ns | ratio to positions |")
    print("|---|---|---|---|---|---|---|")
    for name in SCENES:
        structure, _ = load_scene(PRISM.parent / f"{name}.toml")
        for flags in ("reference", "native"):
            measured = measure(structure, flags)
            base = measured["positions"][0]
            for pairs, (nanoseconds, operations) in measured.items():
                print(
                    f"| {name} | {structure.n_members} | {flags} | {pairs} | {operations} "
                    f"| {nanoseconds:.0f} | {nanoseconds / base:.2f} |"
                )


if __name__ == "__main__":
    main()
