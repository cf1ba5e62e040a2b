"""How long a build takes: cold (empty cache) and from the cache, in processes of their own.

    python benchmarks/build_time.py [scene.toml]

Cold is the wall time of the verb `build`. Cached is process time (user + system) above a process that imports
the same packages and does nothing; medians of several runs.
"""

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

RUNS = 5
PRISM = Path(__file__).resolve().parent.parent / "tensegrity_codegen/scene/examples/prism.toml"
MODULES = ("cli.app", "pipeline.compile_scene", "report.tables")
IMPORTS = "import " + ", ".join(f"tensegrity_codegen.{name}" for name in MODULES)


def run(command: list[str], cache: str) -> tuple[float, float]:
    """Return wall and process time [s] of a command and its children."""
    environment = dict(os.environ, TENSEGRITY_CODEGEN_CACHE=cache)
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wall, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print cold and cached times."""
    scene = sys.argv[1] if len(sys.argv) > 1 else str(PRISM)
    build = [sys.executable, "-m", "tensegrity_codegen", "build", scene]
    with tempfile.TemporaryDirectory() as folder:
        cold = [run(build, f"{folder}/{k}") for k in range(RUNS)]
        warm = [run(build, f"{folder}/0") for _ in range(RUNS)]
    with tempfile.TemporaryDirectory() as folder:
        bare = [run([sys.executable, "-c", IMPORTS], folder) for _ in range(RUNS)]
    above = statistics.median(t for _, t in warm) - statistics.median(t for _, t in bare)
    print(f"{scene}, medians of {RUNS}")
    print(f"cold:   {statistics.median(t for t, _ in cold):.2f} s wall, all included")
    print(f"cached: {statistics.median(t for t, _ in warm):.2f} s wall")
    print(f"cached: {above:.3f} s process time above imports ({statistics.median(t for _, t in bare):.2f} s)")


if __name__ == "__main__":
    main()
