"""What each example needs, how it is built, and how it is run.

Commands run in the folder of the example. In them {mast}, {tower} and {wasm} are folders that `build --out`
wrote, {out} is the folder of what the example builds, {motor} the argument of the program, {python} a Python
with the package ament_package, if there is one, {runner} the Python that runs the examples.
"""

import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.system.errors import CompilerMissingError
from trial.browser import find_browser

EXAMPLES = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Tool:
    """A program that an example needs, and how to install it."""

    program: str
    install: str


CC = Tool("a C compiler", "apt-get install gcc, or pip install ziglang")
ZIG = Tool("zig", "pip install ziglang")
MAKE = Tool("make", "apt-get install make")
PKG_CONFIG = Tool("pkg-config", "apt-get install pkg-config")
CMAKE = Tool("cmake", "apt-get install cmake")
CC_LINKER = Tool("cc", "apt-get install gcc")
CARGO = Tool("cargo", "apt-get install cargo")
MKOCTFILE = Tool("mkoctfile", "apt-get install octave-dev")
OCTAVE = Tool("octave", "apt-get install octave")
NODE = Tool("node", "apt-get install nodejs")
BROWSER = Tool("chromium", "apt-get install chromium")
JULIA = Tool("julia", "see julialang.org")
CXX = Tool("c++", "apt-get install g++")


@dataclass(frozen=True)
class Bundle:
    """A folder with a library: scene, quantities in place of the scene's, machine."""

    scene: Path
    quantities: tuple[str, ...] = ()
    target: str | None = None

    def command(self, folder: str) -> tuple[str, ...]:
        """Return the words of the command that writes it, as a user types it at the top of the checkout."""
        scene = self.scene.relative_to(EXAMPLES.parent).as_posix()
        words = ["tensegrity-codegen", "build", scene]
        words += [word for name in self.quantities for word in ("--quantity", name)]
        words += ["--target", self.target] if self.target else []
        return (*words, "--out", folder)


BUNDLES = {
    "mast": Bundle(EXAMPLES / "mast.toml"),
    "tower": Bundle(
        EXAMPLES.parent / "tensegrity_codegen" / "scene" / "examples" / "tower.toml", ("member_tension",)
    ),
    "wasm": Bundle(EXAMPLES / "mast.toml", target="wasm32"),
}


@dataclass(frozen=True)
class Recipe:
    """One example: tools, libraries, commands that build it, the command that runs it."""

    name: str
    folder: str
    tools: tuple[Tool, ...]
    bundles: tuple[str, ...]
    build: tuple[str, ...]
    run: str
    expected: tuple[str, ...] = ("mast",)  # libraries whose numbers it prints
    remark: str = ""  # regular expression: what to repeat of the output of the build

    def commands(self, **folders: str) -> tuple[tuple[str, ...], ...]:
        """Return the words of the commands that build it."""
        return tuple(_fill(line, folders) for line in self.build)

    def program(self, motor: str, **folders: str) -> tuple[str, ...]:
        """Return the words of the command that runs it."""
        return _fill(self.run, {**folders, "motor": motor})


def _fill(line: str, values: dict[str, str]) -> tuple[str, ...]:
    return tuple(word.format(**values) for word in line.split())


RECIPES = (
    Recipe(
        name="c",
        folder="c",
        tools=(CC, MAKE),
        bundles=("mast",),
        build=("make BUNDLE={mast} OUT={out} {out}/mast",),
        run="{out}/mast {motor}",
    ),
    Recipe(
        name="c-shared",
        folder="c",
        tools=(CC, MAKE, PKG_CONFIG),
        bundles=("mast",),
        build=("make BUNDLE={mast} OUT={out} {out}/mast_shared",),
        run="{out}/mast_shared {motor}",
    ),
    Recipe(
        name="cpp",
        folder="cpp",
        tools=(CMAKE, MAKE, CXX),
        bundles=("mast", "tower"),
        build=("cmake -S . -B {out} -DCMAKE_PREFIX_PATH={mast};{tower}", "cmake --build {out}"),
        run="{out}/mast {motor}",
        expected=("mast", "tower"),
    ),
    Recipe(
        name="rust",
        folder="rust",
        tools=(CARGO, CC_LINKER),
        bundles=("mast",),
        build=("env MAST_BUNDLE={mast} cargo build --offline --release --target-dir {out}",),
        run="{out}/release/mast {motor}",
    ),
    Recipe(
        name="octave",
        folder="octave",
        tools=(OCTAVE, MKOCTFILE),
        bundles=("mast",),
        build=(
            "mkdir -p {out}",
            "mkoctfile --mex -I{mast} -o {out}/mast_mex.mex mast_mex.c {mast}/mast.c",
        ),
        run="octave --no-gui --norc --quiet --path {out} --eval mast_example('{motor}')",
    ),
    Recipe(
        name="julia",
        folder="julia",
        tools=(JULIA,),
        bundles=("mast",),
        build=(),
        run="julia --startup-file=no main.jl {mast} {motor}",
    ),
    Recipe(
        name="javascript",
        folder="javascript",
        tools=(NODE, ZIG),
        bundles=("wasm",),
        build=(),
        run="node main.mjs {wasm} {motor}",
    ),
    Recipe(
        name="browser",
        folder="javascript",
        tools=(BROWSER, ZIG),
        bundles=("wasm",),
        build=(
            "mkdir -p {out}",
            "cp index.html page.mjs rows.mjs mast.mjs {wasm}/mast.wasm {wasm}/manifest.json {out}",
        ),
        run="{runner} ../trial/browser.py {out} {motor}",
    ),
    Recipe(
        name="ros2",
        folder="ros2/mast_simulation",
        tools=(CMAKE, MAKE, CXX),
        bundles=("mast",),
        build=(
            "cmake -S . -B {out} -DCMAKE_PREFIX_PATH={mast} -DCMAKE_INSTALL_PREFIX={out}/install"
            " -DPython3_EXECUTABLE={python}",
            "cmake --build {out}",
            "cmake --install {out}",
        ),
        run="{out}/install/lib/mast_simulation/mast_ticks {motor}",
        remark=r"built with(?:out)? ament_cmake.*",
    ),
)


def find_ament_python() -> str:
    """Return a Python that has ament's package: Debian's, that of the path, or this one where none has it."""
    candidates = (shutil.which("python3", path="/usr/bin"), shutil.which("python3"))
    for python in filter(None, candidates):
        done = subprocess.run([python, "-c", "import ament_package"], capture_output=True, check=False)
        if done.returncode == 0:
            return python
    return sys.executable


def find_missing(tool: Tool) -> bool:
    """Whether a tool is not installed here."""
    if tool in (CC, ZIG):
        try:
            find_compiler("zig" if tool is ZIG else None)
        except CompilerMissingError:
            return True
        return False
    if tool is BROWSER:
        return find_browser() is None
    path = shutil.which(tool.program)
    if path is None or tool is not CARGO:
        return path is None
    # rustup's cargo is a launcher, which may have no toolchain to launch
    return subprocess.run([path, "--version"], capture_output=True, check=False).returncode != 0
