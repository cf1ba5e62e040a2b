"""The distribution of tensions in C without a controller around it: its plain C files, called by ctypes."""

import ctypes
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.codegen.print.render import paste_text, plain_c_folder, template_folder
from tensegrity_codegen.control.embedded.tables import (
    ProgramTables,
    Table,
    build_distribution_tables,
)
from tensegrity_codegen.control.feedback.loop.tension_distribution import Distributed, TensionDistribution
from tensegrity_codegen.tables.precision import find_precision
from tests.codegen.build_c import STRICT, run
from tests.codegen.compilers import require_compiler

Array = NDArray[np.float64]


FOLDER = plain_c_folder(template_folder()) / "control"
STATUS = ("ok", "rate_limited", "range_limited", "tension_limited", "least_tension", "not_solved")
DOUBLE = find_precision("double")
ALIASES = {
    "N_Q": "N_COORDINATES", "N_U": "N_ACTUATORS", "N_MEMBERS": "N_MEMBERS", "N_DRIVEN": "N_DRIVEN",
    "N_PULLS": "N_PULLS", "N_SHARED": "N_SHARED", "N_ROWS": "N_ROWS", "N_EQUILIBRIUM": "SIZE_EQUILIBRIUM",
    "N_BOUNDS": "N_BOUNDS", "N_SUMMED": "N_SUMMED", "N_SET": "N_SET",
}  # fmt: skip
FILES = ("distribution_memory.h", "daqp_settings.h", "quadratic_program.h", "distribute.h")
TAIL = """
int run(const real *coordinate, const real *wanted, const real *low, const real *high,
        const real *least, const real *most, const real *base, const real *preferred,
        real *command, int *yields, int *iterations);
int run(const real *coordinate, const real *wanted, const real *low, const real *high,
        const real *least, const real *most, const real *base, const real *preferred,
        real *command, int *yields, int *iterations)
{
  static scene_control_distribution memory; /* a sample begins with the constraints of the last one */
  distribution_sample s;
  int status;
  s.coordinate = coordinate;
  s.wanted = wanted;
  s.low = low;
  s.high = high;
  s.range_low = least;
  s.range_high = most;
  memcpy(memory.base, base, sizeof memory.base);
  memcpy(memory.preferred, preferred, sizeof memory.preferred);
  status = distribution_find(&s, command, &memory);
  memcpy(yields, memory.yields, sizeof memory.yields);
  *iterations = memory.iterations;
  return status;
}
int size(void);
int size(void) { return (int)sizeof(scene_control_distribution); }
"""


PROGRAM = """
#include <stdio.h>
int main(void)
{
  static double sample[N_Q + 5 * N_U], base[N_DRIVEN], preferred[N_DRIVEN], command[N_U];
  static int yields[N_DRIVEN];
  FILE *file = fopen("samples.bin", "rb");
  int iterations, k, is_inside = 1;
  for (k = 0; k < N_DRIVEN; ++k) {
    base[k] = DRIVEN_REST[k];
    preferred[k] = PREFERRED_TENSION[k];
  }
  while (file != NULL && fread(sample, sizeof sample, 1, file) == 1) {
    const double *wanted = sample + N_Q, *low = wanted + N_U, *high = low + N_U;
    run(sample, wanted, low, high, high + N_U, high + 2 * N_U, base, preferred, command, yields, &iterations);
    for (k = 0; k < N_U; ++k) {
      is_inside &= command[k] >= low[k] && command[k] <= high[k];
    }
  }
  return file == NULL || fclose(file) != 0 || !is_inside;
}
"""
GEOMETRY = """
int {name}_compute_member_length(const double *, double *);
int {name}_compute_equilibrium_matrix(const double *, double *);
static int control_geometry(const real *coordinate, real *length, real *entry)
{{
  const int status = {name}_compute_member_length(coordinate, length);
  return status != 0 ? status : {name}_compute_equilibrium_matrix(coordinate, entry);
}}
"""


def write_source(
    tables: ProgramTables,
    n_coordinates: int,
    n_actuators: int,
    geometry: str,
    *,
    single: bool = False,
) -> str:
    """Return one unit of C that includes daqp_static.h: tables, geometry, and what calls the distribution."""
    real, suffix = ("float", "f") if single else ("double", "")
    sizes = {"N_COORDINATES": n_coordinates, "N_ACTUATORS": n_actuators, **tables.sizes}
    lines = ["#include <math.h>\n#include <stddef.h>\n#include <string.h>\nenum {"]
    lines += [f"  SCENE_CONTROL_{name} = {value}," for name, value in sizes.items()]
    lines += [f"  SCENE_CONTROL_{name.upper()} = {k}," for k, name in enumerate(STATUS)]
    lines += [f"  {name} = SCENE_CONTROL_{of}," for name, of in ALIASES.items()]
    lines += [*(f"  {name} = {value}," for name, value in tables.constants.items()), "  LAST_ONE = 0\n};"]
    lines += [_write_table(table) for table in tables.tables]
    lines.append("void not_used(void);\nvoid not_used(void) { (void)DRIVEN_REST; (void)PREFERRED_TENSION; }")
    files = [(FOLDER / name).read_text(encoding="utf-8") for name in FILES]
    settings = {"WITH_FLOAT": single}
    memory, *rest = (paste_text(text, {}, settings, real, suffix) for text in files)
    head = paste_text("\n".join(lines), {}, settings, real, suffix)
    return "\n".join(
        [head, memory, geometry, '#include "daqp_static.h"', *rest, re.sub(r"\breal\b", real, TAIL)]
    )


def _write_table(table: Table) -> str:
    return f"static const {table.c_type} {table.name}[{len(table.values)}] = {{{', '.join(table.values)}}};"


def compile_unit(
    distribution: TensionDistribution,
    daqp: str,
    folder: Path,
    *,
    iterations: int = 100,
    options: tuple[str, ...] = ("-O1",),
    program: bool = False,
) -> None:
    """Write unit.o and unit.so of a distribution, or the program unit, which reads samples.bin."""
    model = distribution.model
    matrix = next(item for item in model.manifest.functions if item.quantity == "equilibrium_matrix")
    tables = build_distribution_tables(
        distribution, distribution.motion, matrix, DOUBLE, iterations=iterations
    )
    shape = (distribution.motion.coordinate.shape[1], len(distribution.bounds.names))
    geometry = GEOMETRY.format(name=model.manifest.name).replace("real", "double")
    source = write_source(tables, *shape, geometry)
    (folder / "unit.c").write_text(source + (PROGRAM if program else ""), encoding="utf-8")
    (folder / "daqp_static.h").write_text(daqp, encoding="utf-8")
    command = [
        *require_compiler("gcc").command,
        "-std=c99",
        "-ffp-contract=off",
        *options,
        *STRICT,
        "-Wshadow",
    ]
    run([*command, "-fPIC", "-c", "unit.c", "-o", "unit.o"], folder)
    linked = ["unit.o", str(model.path), f"-Wl,-rpath,{model.path.parent}", "-lm"]
    run([*command, *linked, *(["-o", "unit"] if program else ["-shared", "-o", "unit.so"])], folder)


class DistributionInC:
    """A distribution compiled in a folder, with lengths and equilibrium matrix of the model's library."""

    def __init__(
        self, distribution: TensionDistribution, daqp: str, folder: Path, *, iterations: int = 100
    ) -> None:
        compile_unit(distribution, daqp, folder, iterations=iterations)
        self.distribution = distribution
        self.library = ctypes.CDLL(str(folder / "unit.so"))
        self.iterations = 0

    def distribute(
        self, time: float, coordinate: Array, wanted: Array, low: Array, high: Array
    ) -> Distributed:
        """Return what TensionDistribution.distribute returns, from C."""
        cables, motion = self.distribution.cables, self.distribution.motion
        driven, bounds = cables.driven, self.distribution.bounds
        base = cables.rest_length(motion.at(time).input, np.zeros(len(wanted)))[driven]
        preferred = self.distribution.preferred
        if preferred is None:
            preferred = np.array([np.interp(time, motion.time, row) for row in motion.member_tension.T])
        command, yields = np.full(len(wanted), np.nan), np.zeros(len(driven), dtype=np.int32)
        count = ctypes.c_int(0)
        given = [coordinate, wanted, low, high, bounds.least, bounds.most, base, preferred[driven]]
        arrays = [np.ascontiguousarray(values, dtype=float) for values in given]
        pointers: list[Any] = [ctypes.c_void_p(item.ctypes.data) for item in (*arrays, command, yields)]
        status = self.library.run(*pointers, ctypes.byref(count))
        self.iterations = count.value
        yielding = np.zeros(len(cables.base), dtype=bool)
        yielding[driven] = yields.astype(bool)
        return Distributed(command, STATUS[status], yielding)
