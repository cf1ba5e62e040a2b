"""Large scenes: seconds of each stage from scene to loaded library, peak memory, bytes of code, speed.

    python benchmarks/large.py [--sizes 1000 9003 100000] [--kinds tower random] [--compiler gcc]

Two kinds of structure: the shape `tower`, and random points joined to their neighbours, in random order,
written as tables, imported and read back as a scene of one line a member. Each is built by a process of its
own with an empty cache; "memory" is the largest sum over it and its compilers, sampled (proportional sets).
Where other programs run too, "all, of the cores" says more than the seconds of a clock.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from large_scenes import write_scene_of

QUANTITIES = ("acceleration", "member_tension", "node_force", "total_energy", "tangent_stiffness")
SIZES = (1_000, 9_003, 100_000)
KINDS = ("tower", "random")
LEAST_SECONDS = 0.2  # of evaluations for one figure


def main() -> None:
    """Print one table a kind of structure."""
    options = _parse()
    if options.one:
        print(json.dumps(measure(Path(options.one), options)))
        return
    for kind in options.kinds:
        rows = []
        for size in options.sizes:
            with tempfile.TemporaryDirectory() as folder:
                scene = write_scene_of(kind, size, Path(folder), QUANTITIES)
                rows.append(run_apart(scene, folder, options))
        print_table(kind, rows)


def _parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Stages, memory and speed of large scenes.")
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--compiler", default=None)
    parser.add_argument("--flags", default="reference")
    parser.add_argument("--one", help="a scene file: build it here and print one JSON object")
    return parser.parse_args()


def run_apart(scene: Path, folder: str, options: argparse.Namespace) -> dict[str, float]:
    """Return what `measure` returns in a process of its own, and the peak memory of all processes [byte]."""
    command = [sys.executable, __file__, "--one", str(scene), "--flags", options.flags]
    command += ["--compiler", options.compiler] if options.compiler else []
    environment = os.environ | {"TENSEGRITY_CODEGEN_CACHE": f"{folder}/cache"}
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as child:
        peak = 0
        while child.poll() is None:
            peak = max(peak, sum(map(_memory, _family(child.pid))))
            time.sleep(0.02)
        assert child.stdout is not None
        answer = child.stdout.read()
    if child.returncode:
        raise SystemExit(f"{' '.join(command)} ended with {child.returncode}")
    found: dict[str, float] = json.loads(answer)
    return found | {"memory": peak}


def _family(pid: int) -> list[int]:
    """Return a process and all below it."""
    found = [pid]
    for parent in found:
        for task in Path(f"/proc/{parent}/task").glob("*/children"):
            try:
                found += [int(word) for word in task.read_text().split()]
            except OSError:  # it has just ended
                continue
    return found


def _memory(pid: int) -> int:
    """Return the proportional set size of a process [byte], 0 if it has ended."""
    try:
        text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    except OSError:
        return 0
    return 1024 * sum(int(line.split()[1]) for line in text.splitlines() if line.startswith("Pss:"))


def measure(scene: Path, options: argparse.Namespace) -> dict[str, float]:
    """Build a scene stage by stage: seconds of each, bytes of object code and tables, ns an evaluation."""
    started = last = time.perf_counter()
    found: dict[str, float] = {}

    def stage(name: str) -> None:
        nonlocal last
        now = time.perf_counter()
        found[name], last = now - last, now

    from tensegrity_codegen.codegen import emit as _  # noqa: F401 - imports are a stage of their own
    from tensegrity_codegen.codegen.compilation.cache import Cache
    from tensegrity_codegen.codegen.compilation.flags import describe_toolchain, find_flags
    from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
    from tensegrity_codegen.pipeline.build_library import _compile, _emit, _Identity, _request_key
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.scene.read import read_scene
    from tensegrity_codegen.scene.subject import assemble_scene
    from tensegrity_codegen.tables.targets import find_target

    tool, flags, cache = find_compiler(options.compiler), find_flags(options.flags), Cache()
    target = find_target(None)
    toolchain = describe_toolchain(tool, flags)
    stage("imports")
    document = read_scene(scene)
    stage("read")
    structure, request = assemble_scene(document, str(scene))
    stage("assemble")
    identity = _Identity.of(structure, request)
    key = _request_key(identity, toolchain, False)
    stage("key")
    source = _emit(structure, request, tool, flags, target, False)
    stage("emit")
    entry = _compile(source, tool, flags, target, cache, identity)[0]
    cache.store_request(key, entry.key)
    stage("compile")
    model = CompiledModel(entry.library)
    stage("load")
    model.compute("acceleration")
    stage("first call")
    found["all"] = time.perf_counter() - started
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    found["all, of the cores"] = sum(item.ru_utime + item.ru_stime for item in used)
    found["members"] = structure.n_members
    found |= object_bytes(source.files, tool, flags)
    found |= {f"ns {name}": time_call(model, name) / structure.n_members for name in model.quantities}
    return found


def object_bytes(files: dict[str, str], tool: object, flags: object) -> dict[str, float]:
    """Return the bytes of machine code, and of constants, in the objects of the library [byte]."""
    from tensegrity_codegen.codegen.compilation.compile import compiler_environment
    from tensegrity_codegen.codegen.compilation.flags import build_command

    text = constants = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        for file, content in files.items():
            (folder / file).write_text(content, encoding="utf-8")
        for unit in (file for file in files if file.endswith(".c") and file != "example.c"):
            command = build_command(tool, flags, (unit,), "unit.o", shared=False)
            subprocess.run(command, cwd=folder, env=compiler_environment(tool, folder), check=True)
            sections = subprocess.run(
                ["size", "-A", "unit.o"], cwd=folder, check=True, capture_output=True, text=True
            ).stdout
            for words in map(str.split, sections.splitlines()):
                text += int(words[1]) if words and words[0].startswith(".text") else 0
                constants += (
                    int(words[1]) if words and words[0].startswith((".rodata", ".data.rel.ro")) else 0
                )
    return {"code bytes": text, "table bytes": constants}


def time_call(model: object, quantity: str) -> float:
    """Return the median time of one evaluation at nominal values [ns], through cffi."""
    function = model.function(quantity)
    pointer = model.library.ffi.from_buffer
    call = model.library.symbol(function.spec.symbol)
    values = [model.nominal(name) for name in function.arguments]
    passed = [pointer("double[]", array) for array in (*values, np.empty(function._shape))]
    started, once = time.perf_counter(), 0.0
    assert call(*passed) == 0
    once = time.perf_counter() - started
    rounds = []
    for _ in range(9):
        count = max(1, int(LEAST_SECONDS / 9 / max(once, 1e-7)))
        started = time.perf_counter()
        for _ in range(count):
            call(*passed)
        once = (time.perf_counter() - started) / count
        rounds.append(once)
    return 1e9 * float(np.median(rounds))


def print_table(kind: str, rows: list[dict[str, float]]) -> None:
    """Print one column a size."""
    print(f"\n{kind}: seconds of stages, megabytes of all processes, bytes, ns a member and evaluation")
    for name in rows[0]:
        scale = 1e6 if name == "memory" else 1.0
        cells = (row.get(name, float("nan")) / scale for row in rows)
        print(f"  {name:24s}" + "".join(f"{cell:14.5g}" for cell in cells))
    code = [row["code bytes"] for row in rows]
    print(f"  {'code against the first':24s}" + "".join(f"{value / code[0]:14.4f}" for value in code))


if __name__ == "__main__":
    main()
