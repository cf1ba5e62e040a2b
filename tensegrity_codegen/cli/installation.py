"""Installed packages and C compilers, and whether they work."""

import os
import platform
import shutil
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from tensegrity_codegen.codegen.compilation.cache import Cache
from tensegrity_codegen.codegen.compilation.toolchain import check_compiler, find_compiler, find_compilers
from tensegrity_codegen.live.three_module import THREE_REVISION, describe_three
from tensegrity_codegen.system.errors import TensegrityError, UnsafeCacheError
from tensegrity_codegen.system.extras import PACKAGES, name_install
from tensegrity_codegen.system.version import VERSION

NEEDED = (
    "casadi",
    "cffi",
    "filelock",
    "jinja2",
    "numpy",
    "platformdirs",
    "pydantic",
    "pyyaml",
    "rich",
    "scipy",
    "typer",
)
OPTIONAL = {package: extra for extra, packages in PACKAGES.items() for package in packages}


def examine_installation() -> dict[str, Any]:
    """Return the facts that `doctor --json` prints."""
    packages = {name: _version(name) for name in (*NEEDED, *OPTIONAL)}
    compilers = _compilers()
    problems = [f"{name} is not installed" for name in NEEDED if packages[name] is None]
    problems += _compiler_problems(compilers)
    cache = Cache()
    size, problem = _measure_cache(cache)
    three = describe_three()
    problems += problem
    return {
        "status": "error" if problems else "ok",
        "version": VERSION,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "packages": packages,
        "compilers": compilers,
        "cache": str(cache.root),
        "cache_bytes": size,
        "three": {
            "is_here": three[0],
            "where": three[1].replace("`three=PATH`", "--three PATH"),  # an option of other verbs
            "revision": THREE_REVISION,
        },
        "ffmpeg": shutil.which("ffmpeg") is not None,
        "problems": problems,
    }


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _compilers() -> list[dict[str, Any]]:
    rows = []
    for compiler in find_compilers():
        try:
            works, report = True, check_compiler(compiler)
        except TensegrityError as error:
            works, report = False, str(error)
        rows.append(
            {
                "name": compiler.name,
                "command": " ".join(compiler.command),
                "version": compiler.version,
                "works": works,
                "report": report,
            }
        )
    return rows


def _compiler_problems(rows: list[dict[str, Any]]) -> list[str]:
    """Return the reason why libraries cannot be built: no compiler works, or not the one that is chosen."""
    if not any(row["works"] for row in rows):
        return [f"no working C compiler: {name_install('cc')}"]
    try:
        find_compiler()
    except TensegrityError as error:  # $CC names nothing that answers
        return [f"{error.problem} (CC={error.given}): {error.hint}"]
    if not rows[0]["works"]:
        wording = (
            "the environment variable CC names" if os.environ.get("CC", "").strip() else "is found first"
        )
        hint = "set CC to a compiler that works, for example CC=" + next(
            row["command"] for row in rows if row["works"]
        )
        return [f"the compiler that {wording}, {rows[0]['command']}, does not work: {hint}"]
    return []


def _measure_cache(cache: Cache) -> tuple[int, list[str]]:
    """Return the bytes in the cache, and its problem."""
    try:
        return cache.size(), []
    except UnsafeCacheError as error:
        return 0, [f"{error.problem}: {error.where}: {error.given}; {error.hint}"]


def describe_installation(data: dict[str, Any]) -> list[str]:
    """Return the same as lines of text."""
    lines = [f"tensegrity_codegen {data['version']}, Python {data['python']}, {data['platform']}"]
    for name, release in data["packages"].items():
        extra = f"  (extra [{OPTIONAL[name]}])" if name in OPTIONAL else ""
        lines.append(f"  {name:<14} {release or 'not installed'}{extra}")
    for row in data["compilers"]:
        state = "ok " if row["works"] else "BAD"
        lines.append(f"  {state} {row['name']:<6} {row['version']}: {row['report']}")
    lines.append(f"  cache {data['cache']}, {data['cache_bytes'] / 2**20:.1f} MiB")
    three = data["three"]
    state = "" if three["is_here"] else "not here: "
    lines.append(f"  three.js r{three['revision']} for live pages: {state}{three['where']}")
    lines.append(f"  ffmpeg {'found' if data['ffmpeg'] else 'not release (needed for .mp4 only)'}")
    return lines + [f"problem: {problem}" for problem in data["problems"]]
