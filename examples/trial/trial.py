"""Building and running the examples, one after the other."""

import functools
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from tensegrity_codegen import compile_scene, load_scene
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.pipeline.build_library import BuiltLibrary, build_library
from trial.expected import MOTOR, expect_mast, expect_tower
from trial.recipes import BUNDLES, EXAMPLES, Recipe, Tool, find_ament_python, find_missing
from trial.rows import Row, compare_rows, parse_rows

TIME_LIMIT = 280.0  # s, for one command
# What a program is given besides a length, and what its message on stderr must have; its exit code is not 0.
WRONG = {"nan": "an argument holds a NAN or an infinity", "long": "usage:"}


@dataclass(frozen=True)
class Outcome:
    """How one example ended: ``"same numbers"``, ``"failed"``, or ``"not run"`` where tools are missing."""

    name: str
    status: str
    message: str = ""
    missing: tuple[Tool, ...] = ()
    largest: dict[str, float] = field(default_factory=dict)


class FailedError(Exception):
    """A command of an example failed, or printed other numbers than Python."""


def run_examples(recipes: Iterable[Recipe], libraries: "Libraries") -> Iterator[Outcome]:
    """Build the libraries that are needed, build and run each example, and compare its numbers."""
    for recipe in recipes:
        missing = tuple(tool for tool in recipe.tools if find_missing(tool))
        if missing:
            yield Outcome(recipe.name, "not run", missing=missing)
            continue
        try:
            message, largest = _try_example(recipe, libraries)
        except FailedError as error:
            yield Outcome(recipe.name, "failed", str(error))
        else:
            yield Outcome(recipe.name, "same numbers", message, largest=largest)


class Libraries:
    """Libraries of the examples and the numbers of Python, each made once.

    out: the folder of all that is written: a folder for each library, and `build` for the programs.
    """

    def __init__(self, out: Path) -> None:
        self.out = out
        self.folder = functools.cache(self._export)
        self.expected = functools.cache(self._expect)

    def _build(self, name: str) -> BuiltLibrary:
        bundle = BUNDLES[name]
        structure, request = load_scene(bundle.scene)
        if bundle.quantities:
            request = replace(request, quantities=bundle.quantities, integrators=())
        return build_library(structure, request, target=bundle.target)

    def _export(self, name: str) -> Path:
        return self._build(name).export(self.out / name, overwrite=True)

    def _expect(self, name: str) -> tuple[Row, ...]:
        if name == "tower":
            return expect_tower(self._build(name).load())
        return expect_mast(
            compile_scene(BUNDLES[name].scene, for_=("equilibrium", "simulate"), method="rk853")
        )


def _try_example(recipe: Recipe, libraries: Libraries) -> tuple[str, dict[str, float]]:
    """Return a remark and the largest differences of an example; FailedError where it fails."""
    own = libraries.out / "build" / recipe.name
    own.mkdir(parents=True, exist_ok=True)
    folders = {name: str(libraries.folder(name)) for name in recipe.bundles}
    folders |= {"out": str(own), "python": find_ament_python(), "runner": sys.executable}
    folder = EXAMPLES / recipe.folder
    printed = "".join(_succeed(command, folder) for command in recipe.commands(**folders))
    remark = re.search(recipe.remark, printed) if recipe.remark else None
    output = _succeed(recipe.program(str(MOTOR), **folders), folder)
    expected = [row for name in recipe.expected for row in libraries.expected(name)]
    try:
        compared = compare_rows(parse_rows(output), tuple(expected))
    except ValueError as error:
        raise FailedError(f"{recipe.name}: {error}") from error
    if compared.problems:
        raise FailedError("\n".join((f"{recipe.name}: other numbers than Python", *compared.problems)))
    for given, text in WRONG.items():
        _check_refused(recipe.program(given, **folders), folder, text)
    return (remark[0] if remark else ""), compared.largest


def _run(command: tuple[str, ...], folder: Path) -> subprocess.CompletedProcess[str]:
    own = find_compiler()
    chosen = {} if "CC" in os.environ else {"CC": shlex.join(own.command)}
    try:
        return subprocess.run(
            command,
            cwd=folder,
            env={**os.environ, **chosen},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=TIME_LIMIT,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise FailedError(f"{shlex.join(command)}: still running after {TIME_LIMIT:g} s") from error


def _succeed(command: tuple[str, ...], folder: Path) -> str:
    """Return what a command printed on stdout; FailedError with all that it printed where it fails."""
    done = _run(command, folder)
    if done.returncode != 0:
        text = f"{shlex.join(command)}\nin {folder}: exit code {done.returncode}"
        raise FailedError("\n".join((text, done.stdout[-3000:], done.stderr[-3000:])))
    return done.stdout


def _check_refused(command: tuple[str, ...], folder: Path, text: str) -> None:
    """FailedError unless a command with a wrong argument fails with this text on stderr."""
    done = _run(command, folder)
    if done.returncode == 0 or text not in done.stderr:
        raise FailedError(
            f"{shlex.join(command)}: exit code {done.returncode}, expected: not 0; "
            f"message {done.stderr.strip()!r}, expected: {text!r} in it"
        )
