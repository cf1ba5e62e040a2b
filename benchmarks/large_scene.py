"""From a scene file to a loaded library, in a process of its own: seconds, bytes of code.

    python benchmarks/large_scene.py STAGES EMITTER

Writes a scene of the shipped shape `tower` with that many stages (18 STAGES - 6 members), then reads, emits,
compiles and loads it with an empty cache, and prints one line of JSON: what was measured, or the error.
Wanted are force, energy and stiffness; where the emitter has no stiffness, the line names the other two.
"""

import json
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

SCENE = """\
name = "tower"
gravity = [0, 0, -9.81]
[model]
quantities = {quantities}
[classes.bar]
kind = "bar"
spring_constant = 2e5
[classes.cable]
kind = "cable"
spring_constant = 500
prestress = 10
[shape]
kind = "tower"
stages = {stages}
radius = 0.2
height = 0.5
node_mass = 0.05
anchor_bottom = true
"""
QUANTITIES = ["node_force", "elastic_energy", "tangent_stiffness"]


def main() -> None:
    """Measure and print."""
    stages, emitter = int(sys.argv[1]), sys.argv[2]
    started = time.perf_counter()  # before the imports, which a user waits for too
    from tensegrity_codegen.system.errors import FormulationError, TensegrityError

    try:
        answer = build(stages, emitter, QUANTITIES, started)
    except FormulationError:
        answer = build(stages, emitter, QUANTITIES[:2], time.perf_counter())
    except TensegrityError as error:
        answer = {"error": str(error).splitlines()[0]}
    print(json.dumps(answer))


def build(stages: int, emitter: str, quantities: list[str], started: float) -> dict[str, Any]:
    """Return seconds since `started` and bytes of the library of that scene."""
    from harness.tools import read_sections

    from tensegrity_codegen.codegen.compilation.cache import Cache
    from tensegrity_codegen.pipeline.build_library import build_library
    from tensegrity_codegen.pipeline.compile_scene import load_scene

    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "scene.toml"
        path.write_text(SCENE.format(stages=stages, quantities=quantities), encoding="utf-8")
        structure, request = load_scene(path)
        read = time.perf_counter() - started
        cache = Cache(Path(name) / "cache")
        library = build_library(structure, replace(request, emitter=emitter), flags="native", cache=cache)
        library.load()
        seconds = time.perf_counter() - started
        sizes = read_sections(library.path) or (None, None)
    return {
        "members": structure.n_members,
        "emitter": library.manifest.emitter,
        "quantities": quantities,
        "read_seconds": read,
        "seconds": seconds,
        "code_bytes": sizes[0],
        "table_bytes": sizes[1],
    }


if __name__ == "__main__":
    main()
