"""Files by which other programs find a library: for CMake and pkg-config, a page, a notice of licences."""

import math
from collections.abc import Iterable
from pathlib import PurePath
from typing import Any

from tensegrity_codegen.codegen.casadi_functions import TOO_LONG
from tensegrity_codegen.codegen.compilation.flags import find_flags
from tensegrity_codegen.codegen.print.render import BANNER, render
from tensegrity_codegen.system.summaries import describe_count
from tensegrity_codegen.tables.manifest import C_API_VERSION, Manifest
from tensegrity_codegen.tables.quantities import PARAMETERS

LICENCE = """\
MIT License

Copyright (c) 2026 the tensegrity_codegen authors

Permission is hereby granted, free of charge, to any person obtaining a copy
of this software and associated documentation files (the "Software"), to deal
in the Software without restriction, including without limitation the rights
to use, copy, modify, merge, publish, distribute, sublicense, and/or sell
copies of the Software, and to permit persons to whom the Software is
furnished to do so, subject to the following conditions:

The above copyright notice and this permission notice shall be included in all
copies or substantial portions of the Software.

THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR
IMPLIED, INCLUDING BUT NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY,
FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE
AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER
LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM,
OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE
SOFTWARE.
"""


def name_package(scene: str) -> str:
    """Return the name of a library as a package, which no other package has."""
    return f"tensegrity_{scene}"


def emit_bundle(manifest: Manifest, sources: Iterable[str], library: str) -> dict[str, str]:
    """Return the files for other programs, name -> text."""
    package, name = name_package(manifest.name), manifest.name
    nodes, members = len(manifest.node_name), len(manifest.member_name)
    counts = f"{describe_count(nodes, 'node')} and {describe_count(members, 'member')}"
    context = {
        "banner": BANNER,
        "name": name,
        "NAME": name.upper(),
        "package": package,
        "c_api_version": C_API_VERSION,
        "description": f"Tensegrity structure {name}: {counts}, {manifest.precision} precision",
        "sources": list(sources),
        "library": library,
        "library_word": PurePath(library).stem.removeprefix("lib"),
        "options": [
            option for option in find_flags(manifest.flags).options if not option.startswith("-std=")
        ],
        "functions": manifest.functions,
        "integrators": manifest.integrators,
        "solvers": manifest.solvers,
        "interfaces": manifest.interfaces,
        **_describe_derivatives(manifest),
        **_describe_state(manifest),
        "licence": LICENCE.splitlines(),
        "made_by": ", ".join(f"{program} {release}" for program, release in manifest.made_by.items()),
    }
    files = {
        "CMakeLists.txt": "CMakeLists.txt",
        f"{package}Sources.cmake": "Sources.cmake",
        f"{package}Config.cmake": "Config.cmake",
        f"{package}ConfigVersion.cmake": "ConfigVersion.cmake",
        f"{package}.pc.in": "package.pc.in",
        f"{package}.pc": "package.pc",
        "README.md": "README.md",
        "NOTICE.md": "NOTICE.md",
    }
    return {file: render(f"bundle/{template}", context) for file, template in files.items()}


def _describe_derivatives(manifest: Manifest) -> dict[str, Any]:
    """Return which derivatives casadi.external finds, in words, and the names of those that it does not."""
    parts = {source_part.name: source_part for source_part in manifest.parts}
    orders = {"casadi_derivatives": "first", "casadi_second_derivatives": "second"}
    made = [order for name, order in orders.items() if name in parts and parts[name].is_included]
    lost = "".join(parts[name].why.partition(TOO_LONG)[2] for name in orders if name in parts)
    return {
        "derivatives": f"with {' and '.join(made)} derivatives" if made else "without derivatives",
        "missing": [name for name in lost.split(", ") if name],
    }


def _describe_state(manifest: Manifest) -> dict[str, Any]:
    """Return the composition of state, control and parameters of acados."""
    sizes = {
        argument.name: f"`{argument.name}` ({math.prod(argument.shape)})" for argument in manifest.arguments
    }
    return {
        "state": [sizes[name] for name in ("coordinate", "velocity") if name in sizes],
        "control": ", ".join(f"`{name}`" for name in manifest.input_name) or "empty",
        "constants": [sizes[name] for name in PARAMETERS if name in sizes],
    }
