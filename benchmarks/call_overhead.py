"""What a call from Python costs above the C function itself, on the prism.

python benchmarks/call_overhead.py
"""

import statistics
import timeit

from tensegrity_codegen.codegen.compilation.flags import FLAG_SETS
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.measure import time_functions
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.model.model import CompiledModel

ROUNDS, COUNT = 9, 20_000


def microseconds(call: object) -> float:
    """Return the median time of one call [us]."""
    rounds = timeit.repeat(call, number=COUNT, repeat=ROUNDS)  # type: ignore[arg-type]
    return statistics.median(rounds) / COUNT * 1e6


def main() -> None:
    """Print the table."""
    from build_time import PRISM

    structure, request = load_scene(PRISM)
    model: CompiledModel = build_library(structure, request).load()
    inside = time_functions(emit(structure, request), find_compiler(), FLAG_SETS["reference"])
    q = model.nominal("coordinate")
    print("| quantity | C [us] | function(q) [us] | compute(name) [us] | overhead [us] |")
    print("|---|---|---|---|---|")
    for name in ("member_length", "member_tension", "acceleration"):
        function = model.function(name)
        direct = microseconds(lambda function=function: function(q))
        by_name = microseconds(lambda name=name: model.compute(name, coordinate=q))
        c = inside[name] * 1e-3
        print(f"| {name} | {c:.3f} | {direct:.2f} | {by_name:.2f} | {direct - c:.2f} |")


if __name__ == "__main__":
    main()
