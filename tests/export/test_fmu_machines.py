"""The binary of a unit for another machine, under qemu-user; a unit that is linked statically."""

import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.export.export_fmu import export_fmu
from tensegrity_codegen.tables.targets import TARGETS
from tests.codegen.build_c import run
from tests.codegen.other_machines import GLIBC, require
from tests.export.scenes import write_loose

pytestmark = pytest.mark.thorough

PROGRAM = """
#include "fmi2.h"
#include <stdio.h>
#include <stdlib.h>
#ifdef FMI2_FUNCTION_PREFIX
#define FMI2(name) loose_##name
#else
#define FMI2(name) name
#endif
fmi2Component FMI2(fmi2Instantiate)(
    fmi2String, fmi2Type, fmi2String, fmi2String, const fmi2CallbackFunctions *, fmi2Boolean, fmi2Boolean);
fmi2Status FMI2(fmi2SetupExperiment)(fmi2Component, fmi2Boolean, fmi2Real, fmi2Real, fmi2Boolean, fmi2Real);
fmi2Status FMI2(fmi2EnterInitializationMode)(fmi2Component);
fmi2Status FMI2(fmi2ExitInitializationMode)(fmi2Component);
fmi2Status FMI2(fmi2DoStep)(fmi2Component, fmi2Real, fmi2Real, fmi2Boolean);
fmi2Status FMI2(fmi2GetReal)(fmi2Component, const fmi2ValueReference[], size_t, fmi2Real[]);
void FMI2(fmi2FreeInstance)(fmi2Component);

int main(void)
{
  fmi2CallbackFunctions callbacks = {NULL, calloc, free, NULL, NULL};
  const fmi2ValueReference place[] = {PLACES};
  double value[sizeof place / sizeof place[0]];
  int k, status;
  fmi2Component c = FMI2(fmi2Instantiate)("one", fmi2CoSimulation, "TOKEN", "", &callbacks, 0, 0);
  if (c == NULL) {
    return 2;
  }
  status = FMI2(fmi2SetupExperiment)(c, 1, 1e-9, 0.0, 0, 0.0);
  status += FMI2(fmi2EnterInitializationMode)(c);
  status += FMI2(fmi2ExitInitializationMode)(c);
  for (k = 0; k < 100; ++k) {
    status += FMI2(fmi2DoStep)(c, 1e-3 * k, 1e-3, 1);
  }
  status += FMI2(fmi2GetReal)(c, place, sizeof place / sizeof place[0], value);
  printf("%d\\n", status);
  for (k = 0; k < (int)(sizeof place / sizeof place[0]); ++k) {
    printf("%.17g\\n", value[k]);
  }
  FMI2(fmi2FreeInstance)(c);
  return 0;
}
"""


PLACES = {"aarch64-linux": "binaries/aarch64-linux/loose.so"}


def unpack(place: Path, **options: Any) -> Path:
    """Export a unit, unpack it, and write the program that runs it; return the folder."""
    out = place / "loose.fmu"
    exported = export_fmu(write_loose(place), out, **options)
    assert exported.facts["binaries"] == [PLACES[name] for name in options.get("targets", ())]
    with zipfile.ZipFile(out) as archive:
        archive.extractall(place)
    root = ElementTree.parse(place / "modelDescription.xml").getroot()
    chosen = [
        item.get("valueReference") or ""
        for item in root.iter("ScalarVariable")
        if (item.get("name") or "").startswith("node_position.")
    ]
    text = PROGRAM.replace("PLACES", ", ".join(chosen)).replace("TOKEN", root.get("guid") or "")
    (place / "program.c").write_text(text, encoding="utf-8")
    return place


def read_numbers(text: str) -> np.ndarray:
    numbers = np.array(text.split(), dtype=float)
    assert numbers[0] == 0
    return numbers[1:]


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    """Positions after 0.1 s on this machine, by the sources linked statically with their prefix."""
    folder = unpack(tmp_path_factory.mktemp("here"), sources_only=True)
    options = ("-std=c99", "-O1", "-ffp-contract=off", "-DFMI2_FUNCTION_PREFIX=loose_", "-Isources")
    compiler = find_compiler()
    files = ("program.c", "sources/loose_fmu.c", "-lm", "-o", "here")
    run([*compiler.command, *options, *files], folder, compiler)
    return read_numbers(run([str(folder / "here")], folder).stdout)


def find_emulator(name: str, folder: Path) -> tuple[list[str], dict[str, str]]:
    """Return the command that runs programs of a machine, and its environment; skips where it is missing."""
    library = folder / PLACES[name]
    place, package = GLIBC[name]
    if not Path(place).is_dir():
        pytest.skip(f"{place} is missing; on Debian and Ubuntu: apt install {package}")
    return [require("qemu-aarch64", "qemu-user"), "-L", place], {"LD_LIBRARY_PATH": str(library.parent)}


@pytest.mark.parametrize("name", PLACES)
def test_the_binary_of_another_machine_moves_the_same(name: str, here: np.ndarray, tmp_path: Path) -> None:
    pytest.importorskip("ziglang", reason="the package ziglang is not installed")
    emulator, words = find_emulator(name, tmp_path)
    folder = unpack(tmp_path, targets=(name,))
    zig, program = find_compiler("zig"), f"program-{name}.exe"
    options = ("-std=c99", "-O1", "-Isources", *TARGETS[name].options)
    run([*zig.command, *options, "program.c", f"./{PLACES[name]}", "-o", program], folder, zig)
    found = read_numbers(run([*emulator, str(folder / program)], folder, **words).stdout)
    # sqrt, sums and products are the same everywhere; pow in the step control may differ in the last place.
    assert np.abs(found - here).max() < 1e-9
