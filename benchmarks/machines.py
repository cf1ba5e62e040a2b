"""Numbers of libraries for other machines against those of this one.

python benchmarks/machines.py [--targets aarch64-linux thumbv7em wasm32 x86_64-windows] [--write]

Every function of example scenes, at three states near their own, and integrations of 2 ms are computed under
qemu-user, wasmtime and wine. Printed is the largest difference over the largest value of a result, and how
many results have the same bits.
"""

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from harness.turns import draw_bars, find_about, publish, table_text

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
HEADS = ("scene", "target", "largest difference", "results", "results with equal bits")
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
    """Print a table, and write it if asked to."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--targets", nargs="*", default=list(RUNS), choices=list(RUNS))
    parser.add_argument("--write", action="store_true", help="write into docs/answers_measured.md")
    words = parser.parse_args()
    rows: list[tuple[str, str, str, int, int]] = []
    with tempfile.TemporaryDirectory() as folder:
        for name, subject, request in list_subjects(Path(folder)):
            for target in words.targets:
                place = Path(folder) / name
                place.mkdir(exist_ok=True)
                try:
                    error, equal, count = measure(target, subject, request, place)
                except pytest.skip.Exception as reason:
                    print(f"{target}: {reason}", flush=True)
                    continue
                rows.append((name, target, f"{error:.1e}", count, equal))
                print(*rows[-1], sep=", ", flush=True)
    if not rows:
        raise SystemExit("no target runs on this machine")
    worst = max(rows, key=lambda row: float(row[2]))
    finding = (
        f"{sum(row[4] for row in rows)} of {sum(row[3] for row in rows)} results on other machines have "
        "the bits "
        f"of this one; the largest difference is {worst[2]} ({worst[0]}, {worst[1]})"
    )
    bars = draw_bars("scene, target", HEADS[4])
    parts = (bars, table_text(HEADS, rows), find_about(__doc__))
    publish("answers_measured.md", finding, *parts, write=words.write)


if __name__ == "__main__":
    main()
