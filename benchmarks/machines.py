"""Numbers of libraries for other machines against those of this one, as in docs/machines.md.

    python benchmarks/machines.py [--targets aarch64-linux thumbv7em wasm32 x86_64-windows]

Every function of example scenes, at three states near their own, and integrations of 2 ms are computed under
qemu-user, wasmtime and wine. Printed is the largest difference over the largest value of a result, and how
many results have the same bits.
"""

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tensegrity_codegen.cli.verbs.examples import list_examples
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.tables.request import ModelRequest
from tests.codegen.other_machines import Numbers, compare, in_c, in_qemu, in_wasm, in_wine
from tests.codegen.subjects import everything

RUNS: dict[str, Callable[[Path, object], Numbers]] = {
    "aarch64-linux": in_qemu,
    "thumbv7em": in_qemu,
    "wasm32": in_wasm,
    "x86_64-windows": in_wine,
}
EXAMPLES = ("prism", "icosahedron", "tower", "planar", "prism12")


def list_subjects(folder: Path) -> list[tuple[str, Subject, ModelRequest]]:
    """Return example scenes, and a structure with every feature, quantity and integrator."""
    subjects = []
    for name, text in list_examples().items():
        if name in EXAMPLES:
            path = folder / f"{name}.toml"
            path.write_text(text, encoding="utf-8")
            subjects.append((name, *load_scene(path)))
    return [*subjects, ("every feature", *everything())]


def measure(target: str, subject: Subject, request: ModelRequest, folder: Path) -> tuple[float, int, int]:
    """Return the largest relative difference, how many results have equal bits, and how many there are."""
    built = build_library(subject, request, target=target)
    made = built.export(folder / target, overwrite=True)
    there, here = RUNS[target](made, built.manifest), in_c(made, built.manifest)
    errors = compare(here, there)
    equal = sum(np.array_equal(here[name], there[name]) for name in errors)
    return max(errors.values()), equal, len(errors)


def main() -> None:
    """Print a table for each target."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--targets", nargs="*", default=list(RUNS), choices=list(RUNS))
    words = parser.parse_args()
    print("| scene | target | largest difference | results with equal bits |")
    print("| --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        for name, subject, request in list_subjects(Path(folder)):
            for target in words.targets:
                place = Path(folder) / name
                place.mkdir(exist_ok=True)
                error, equal, count = measure(target, subject, request, place)
                print(f"| {name} | {target} | {error:.1e} | {equal} of {count} |", flush=True)


if __name__ == "__main__":
    main()
