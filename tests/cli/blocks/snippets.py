"""Pieces of C of a page: each is the body of a program that is compiled with a library and run."""

import subprocess
from dataclasses import replace
from pathlib import Path

from tensegrity_codegen import load_scene
from tensegrity_codegen.codegen.emit import emit
from tests.cli.blocks.find_blocks import Block
from tests.cli.blocks.surroundings import C_BEFORE, C_HEAD
from tests.codegen.build_c import write_files
from tests.codegen.compilers import require_compiler

INTEGRATORS = ("rk4", "rk54", "rk853")
QUANTITIES = ("member_tension", "acceleration", "potential_energy", "node_residual", "tangent_stiffness")


def run_snippet(block: Block, folder: Path) -> None:
    """Compile a piece of C with all that its scene's library can have, and run it."""
    name = "prism12" if "prism12_" in block.code else "prism"
    library = folder / f"library_of_{name}"
    if not library.exists():
        structure, request = load_scene(folder / f"{name}.toml")
        wanted = request.wanting(*QUANTITIES, integrators=INTEGRATORS)
        wanted = replace(wanted, events=("auto",), solvers=("equilibrium",), batch_width=8)
        write_files(library, emit(structure, wanted).files)
    head = f'{C_HEAD}#include "{name}.h"\n'
    before = C_BEFORE[block.page] if name == "prism" else ""
    if "coordinate[" in block.code.split("=")[0] or name != "prism":
        before = ""
    program = folder / "snippet.c"
    program.write_text(
        f"{head}int main(void)\n{{\n{before}\n{{\n{block.code}}}\nreturn 0;\n}}\n", encoding="utf-8"
    )
    compiler = require_compiler("gcc").command
    out = str(folder / "snippet")
    sources = [str(program), str(library / f"{name}.c")]
    subprocess.run([*compiler, "-O0", f"-I{library}", "-o", out, *sources, "-lm"], check=True)
    subprocess.run([out], check=True, capture_output=True, timeout=120)
