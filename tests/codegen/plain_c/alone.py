"""Compiling the plain C files in `templates/c/` against their sample configuration."""

from collections.abc import Sequence
from pathlib import Path

from tensegrity_codegen.codegen.print.render import plain_c_folder, template_folder
from tests.codegen.build_c import STRICT, require_cpp, run
from tests.codegen.compilers import require_compiler

FOLDER = plain_c_folder(template_folder())
FILES = sorted(path.name for path in FOLDER.iterdir() if path.suffix in (".c", ".h"))
# The controller has a sample configuration of its own. Files left out need DAQP, whose source comes from
# elsewhere: tests/control/embedded compiles them.
NEED_DAQP = {"daqp_settings.h", "distribute.h", "quadratic_program.h", "distribute_step.h"}
NEED_SOFT_DAQP = {path.name for path in FOLDER.glob("control/mpc_*.h")}  # these in another form
CONTROL = sorted(
    f"control/{path.name}"
    for path in FOLDER.glob("control/*.h")
    if path.name not in NEED_DAQP | NEED_SOFT_DAQP
)
GROUPS = {"structure": FILES, "control": CONTROL}
STRICTER = (*STRICT, "-Wshadow")


def options_for(n: int, single: bool) -> tuple[str, ...]:
    """Return what sets the number of coordinates and the precision in the sample configuration."""
    return (f"-DCONFIG_N={n}", f"-DWITH_FLOAT={int(single)}", f"-I{FOLDER}")


def compile_alone(
    files: Sequence[str], family: str, language: str, options: Sequence[str], folder: Path
) -> None:
    """Compile a unit that includes these files and nothing else, without a warning."""
    includes = "".join(f'#include "{name}"\n' for name in files)
    unit = folder / ("unit.c" if language == "c" else "unit.cpp")
    unit.write_text(f"{includes}extern int unit_;\nint unit_ = 0;\n", encoding="utf-8")
    command = require_compiler(family).command if language == "c" else require_cpp(family)
    standard = "-std=c99" if language == "c" else "-std=c++11"
    run([*command, standard, "-O0", *STRICTER, *options, "-c", unit.name, "-o", "unit.o"], folder)


def run_c(source: str, folder: Path, *options: str) -> str:
    """Compile a program against the plain C files, run it, and return what it prints."""
    (folder / "main.c").write_text(source, encoding="utf-8")
    flags = ("-std=c99", "-O1", "-ffp-contract=off", *STRICTER)
    command = [*require_compiler("gcc").command, *flags, *options, "main.c", "-lm", "-o", "main"]
    run(command, folder)
    return run([str(folder / "main")], folder).stdout
