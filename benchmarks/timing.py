"""Timing generated functions in C: a small driver beside the generated source, medians of rounds."""

from __future__ import annotations

import json
import statistics
import subprocess
import tempfile
from pathlib import Path

from tensegrity_codegen.codegen.compile import compiler_environment
from tensegrity_codegen.codegen.emit import GeneratedSource
from tensegrity_codegen.codegen.flags import Compiler, FlagSet

__all__ = ["time_functions"]

ROUNDS = 9

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
  while (now() - begun < 0.1) sink += 1.0;
  printf("{{");
{blocks}
  printf("\\n\\"end\\": []}}\\n");
  return sink == 1.0;
}}
"""

BLOCK = """\
  {{
    static double result[{size}];
    int count = 64;
    double started, taken = 0.0;
    while (taken < 0.01) {{
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
      sink += result[0];
    }}
    printf("],");
  }}
"""


def time_functions(source: GeneratedSource, compiler: Compiler, flags: FlagSet) -> dict[str, float]:
    """Return quantity -> median nanoseconds a call at nominal values, with its checks."""
    manifest = source.manifest
    blocks = "".join(
        BLOCK.format(
            size=len(spec.pattern.row) if spec.pattern else max(1, _product(spec.shape)),
            symbol=spec.symbol,
            quantity=spec.quantity,
            rounds=ROUNDS,
            arguments="".join(f"{manifest.name}_nominal_{argument}, " for argument in spec.arguments),
        )
        for spec in manifest.functions
    )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file_name, text in source.files.items():
            (folder / file_name).write_text(text, encoding="utf-8")
        (folder / "driver.c").write_text(DRIVER.format(name=manifest.name, blocks=blocks), encoding="utf-8")
        command = [*compiler.command, *flags.options, "-o", "driver", "driver.c", f"{manifest.name}.c", "-lm"]
        subprocess.run(command, cwd=folder, env=compiler_environment(compiler, folder), check=True)
        answer = subprocess.run([str(folder / "driver")], capture_output=True, text=True, check=True).stdout
    return {quantity: statistics.median(rounds) for quantity, rounds in json.loads(answer).items() if rounds}


def _product(shape: tuple[int, ...]) -> int:
    result = 1
    for size in shape:
        result *= size
    return result
