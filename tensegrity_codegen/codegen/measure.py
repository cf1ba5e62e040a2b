"""Times of generated functions: a C driver beside the generated source, medians of interleaved rounds.

The text of the driver is made of names that the generator chose, and of the scene's name, which is a C
identifier; nothing else of a scene gets into it.
"""

import json
import math
import os
import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path

from tensegrity_codegen.codegen.compilation.child import run_limited
from tensegrity_codegen.codegen.compilation.compile import run_compiler
from tensegrity_codegen.codegen.compilation.flags import Compiler, FlagSet, build_program_command
from tensegrity_codegen.codegen.emit import GeneratedSource
from tensegrity_codegen.system.errors import CompileError, describe_reason
from tensegrity_codegen.system.temporary_files import work_folder
from tensegrity_codegen.tables.manifest import FunctionSpec, Manifest

PASSES = 5  # in which the programs take turns
ROUNDS = 5  # of one pass
RUN_TIMEOUT = 120.0  # s, for one pass of one program
PROGRAM = "driver"

DRIVER = """\
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <time.h>
#include "{name}.h"

static double now(void)
{{
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}}

int main(void)
{{
  int round, k;
  volatile double sink = 0.0;
  /* Let the core reach its working frequency first. */
  const double begun = now();
  while (now() - begun < 0.03) sink += 1.0;
  printf("{{");
{blocks}
  printf("\\n\\"end\\": []}}\\n");
  return 0;
}}
"""

# The number of calls is doubled until they take 2 ms, so that reading the clock does not count.
BLOCK = """\
  {{
    static {real} result[{size}];
    int count = 1;
    double started, taken = 0.0;
    while (taken < 0.002) {{
      count *= 2;
      started = now();
      for (k = 0; k < count; ++k) {symbol}({arguments}result);
      taken = now() - started;
    }}
    printf("\\n\\"{quantity}\\": [");
    for (round = 0; round < {rounds}; ++round) {{
      started = now();
      for (k = 0; k < count; ++k) {symbol}({arguments}result);
      printf("%s%.3f", round ? ", " : "", (now() - started) / count * 1e9);
      sink += (double)result[0];
    }}
    printf("],");
  }}
"""


def time_functions(source: GeneratedSource, compiler: Compiler, flags: FlagSet) -> dict[str, float]:
    """Return quantity -> median nanoseconds a call at nominal values, with its checks; CompileError."""
    with work_folder() as place:
        program = build_driver(source, compiler, flags, place)
        answer = run_drivers([program])[0]
    if isinstance(answer, CompileError):
        raise answer
    return answer


def build_driver(source: GeneratedSource, compiler: Compiler, flags: FlagSet, folder: Path) -> Path:
    """Compile source and driver in a folder of their own; return the program. Raises CompileError."""
    texts = {name: text for name, text in source.files.items() if name.endswith((".c", ".h"))}
    texts.pop("example.c", None)
    texts[f"{PROGRAM}.c"] = write_driver(source.manifest)
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    units = sorted(name for name in texts if name.endswith(".c"))
    run_compiler([build_program_command(compiler, flags, units, PROGRAM)], compiler, folder)
    return folder / PROGRAM


def run_drivers(programs: Sequence[Path]) -> list[dict[str, float] | CompileError]:
    """Return for each program quantity -> median nanoseconds a call, or why it gave no answer.

    The programs take turns, so that what slows the machine for a while slows them all.
    """
    rounds: list[dict[str, list[float]]] = [{} for _ in programs]
    failed: dict[int, CompileError] = {}
    for _ in range(PASSES):
        for number, program in enumerate(programs):
            if number not in failed:
                try:
                    for quantity, values in _run(program).items():
                        rounds[number].setdefault(quantity, []).extend(values)
                except CompileError as error:
                    failed[number] = error
    medians = [{name: statistics.median(values) for name, values in row.items()} for row in rounds]
    return [failed.get(number, row) for number, row in enumerate(medians)]


def write_driver(manifest: Manifest) -> str:
    """Return C text that calls every function with its nominal arguments and prints nanoseconds as JSON."""
    blocks = "".join(_block(manifest, spec) for spec in manifest.functions)
    return DRIVER.format(name=manifest.name, blocks=blocks)


def _block(manifest: Manifest, spec: FunctionSpec) -> str:
    return BLOCK.format(
        real="float" if manifest.precision == "single" else "double",
        size=len(spec.pattern.row) if spec.pattern else max(1, math.prod(spec.shape)),
        symbol=spec.symbol,
        quantity=spec.quantity,
        rounds=ROUNDS,
        arguments="".join(f"{manifest.name}_nominal_{argument}, " for argument in spec.arguments),
    )


def _run(program: Path) -> Mapping[str, list[float]]:
    where = program.name
    try:
        outcome = run_limited(
            [str(program)], folder=program.parent, environment=os.environ, timeout=RUN_TIMEOUT
        )
    except OSError as error:
        problem = "the measuring program could not be started"
        raise CompileError(problem, log=describe_reason(error), where=where) from error
    if not outcome.ok:
        problem = f"the measuring program failed ({outcome.ended} {outcome.number})"
        raise CompileError(problem, log=outcome.log, where=where)
    answer: dict[str, list[float]] = json.loads(outcome.log)
    return {quantity: values for quantity, values in answer.items() if values}
