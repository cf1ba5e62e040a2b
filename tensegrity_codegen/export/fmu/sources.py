"""The C sources of a unit: the library, the configuration, and the functions of the standard."""

import hashlib
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.codegen.compilation.compile import compile_library
from tensegrity_codegen.codegen.compilation.flags import find_flags
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler, find_cross_compiler
from tensegrity_codegen.codegen.print.printer import print_number, print_numbers
from tensegrity_codegen.codegen.print.render import BANNER, render, template_folder, wrap_lines
from tensegrity_codegen.export.fmu.layout import Argument, Layout, Tangent
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.integrators import INTEGRATORS, find_row
from tensegrity_codegen.tables.manifest import STATUS, FunctionSpec
from tensegrity_codegen.tables.quantities.arguments import GROUND_FROM_ZERO
from tensegrity_codegen.tables.targets import SHARED, TARGETS, Target, find_host, find_system, find_target

ATOL_RATIO = 1e-3  # absolute over relative tolerance, for a structure of a metre: 1e-9 over 1e-6
MAX_AHEAD, MAX_NUMBERS_AHEAD = 32, 65_536  # communication steps, and numbers of their states
# Kinds of events in the order of margins, and the event as a margin becomes negative, positive.
WATCHED = {
    "cable": ("goes slack", "goes taut"),
    "switch": ("switches down", "switches up"),
    "ground": ("leaves the ground", "touches the ground"),
    "stick": ("slips", "sticks"),
}


@dataclass(frozen=True)
class Experiment:
    """How a unit is used."""

    fmi: str  # version of the standard: "2.0" or "3.0"
    kinds: tuple[str, ...]  # interfaces: "me" (model exchange), "cs" (co-simulation)
    method: str  # integrator of the co-simulation
    t_end: float  # stop time [s] and relative tolerance of the default experiment
    rtol: float
    length: float  # size of the structure [m], which absolute tolerances follow


@dataclass(frozen=True)
class UnitSources:
    """Files of a unit: name -> text; compiled: those that are compiled; token: identifies all of it."""

    files: Mapping[str, str]
    compiled: tuple[str, ...]
    token: str


def write_unit_sources(
    library: Mapping[str, str], layout: Layout, tangent: Tangent | None, experiment: Experiment
) -> UnitSources:
    """Return the sources of a unit."""
    name, version = layout.manifest.name, experiment.fmi[0]
    templates = {
        file: (template_folder() / "fmu" / file).read_text(encoding="utf-8")
        for file in ("fmu.h", "fmu_core.h", f"fmi{version}.h")
    }
    functions = f"fmi{version}_functions.h"
    templates[functions] = render(f"fmu/{functions}", {})
    files = {f"{name}.h": library[f"{name}.h"], f"{name}_code.h": library[f"{name}.c"], **templates}
    tables = f"{name}_tables.c"
    if tables in library:
        files[tables] = library[tables]
    unit = f"{name}_fmu.c"
    included = ("fmu_config.h", f"{name}_code.h", "fmu_core.h", functions)
    files[unit] = f"/* {BANNER} */\n" + "".join(f'#include "{file}"\n' for file in included)
    context = _context(layout, tangent, experiment)
    token = _identify(files, render("fmu_config.h", {**context, "token": ""}), experiment)
    files["fmu_config.h"] = wrap_lines(render("fmu_config.h", {**context, "token": token}))
    return UnitSources(files, tuple(file for file in (unit, tables) if file in files), token)


def _identify(files: Mapping[str, str], config: str, experiment: Experiment) -> str:
    """Return a text in the form of a GUID that is the same for the same unit."""
    texts = [*(f"{name}\n{files[name]}" for name in sorted(files)), config, repr(experiment)]
    digest = hashlib.sha256("\0".join(texts).encode("utf-8")).hexdigest()
    return "{" + "-".join((digest[:8], digest[8:12], digest[12:16], digest[16:20], digest[20:32])) + "}"


def _context(layout: Layout, tangent: Tangent | None, experiment: Experiment) -> dict[str, Any]:
    manifest = layout.manifest
    margins = layout.margins
    functions = {item.quantity: item for item in manifest.functions}
    return {
        "banner": BANNER,
        "name": manifest.name,
        "NAME": manifest.name.upper(),
        "rtol": print_number(experiment.rtol),
        "atol_ratio": print_number(ATOL_RATIO * experiment.length),
        "nominal": print_number(experiment.length),
        "with_exchange": "me" in experiment.kinds,
        "with_steps": "cs" in experiment.kinds,
        "n": {
            "inputs": layout.n_inputs,
            "arguments": layout.n_arguments,
            "coordinates": layout.n_coordinates,
            "internal": layout.n_internal,
            "margin_blocks": sum(item.is_margin for item in layout.blocks),
            "margins": len(margins),
            "calculated": layout.n_values,
            "ahead": max(1, min(MAX_AHEAD, MAX_NUMBERS_AHEAD // layout.n_states)),
        },
        "status_texts": [item.replace("_", " ") for item in STATUS],
        "member_names": _strings(manifest.member_name),
        "contact_names": _strings(manifest.contact_name) if manifest.contact_name else [],
        "event_words": list(WATCHED.values()) if manifest.contact_name else list(WATCHED.values())[:2],
        "margin_names": _strings([name for name, _ in margins]),
        "margin_kinds": [kind for _, kind in margins] or [0],
        "block_starts": [*(item.start for item in layout.blocks), layout.n_values],
        "arguments": [{"name": item.name, "place": item.place} for item in layout.arguments],
        "least": [limit for item in layout.arguments for limit in _list_lower_bounds(item)] or ["FMU_ANY"],
        "acceleration": _call(layout, functions["acceleration"]),
        "internal_rate": _call(layout, functions["internal_rate"]) if layout.n_internal else None,
        "blocks": [
            {"quantity": item.quantity, "start": item.start, "symbol": "", "passed": ""}
            | (_call(layout, item.spec) if item.spec is not None else {})
            for item in layout.blocks
        ],
        "position": _place_positions(layout),
        "tangent": _describe_tangent(tangent),
        "integrator": _describe_integrator(layout, experiment.method),
    }


def _list_lower_bounds(argument: Argument) -> list[str]:
    """Return the lower bound of each value of an argument; a value of the scene itself is always allowed."""
    limit = f"FMU_{argument.least.upper()}"
    is_positive = [limit != "FMU_ABOVE_ZERO" or value > 0 for value in np.ravel(argument.spec.nominal)]
    if argument.name == "ground":
        is_positive = [name not in GROUND_FROM_ZERO for name in argument.spec.over]
    return [limit if positive else "FMU_FROM_ZERO" for positive in is_positive]


def _strings(names: Sequence[str]) -> list[str]:
    """Return names, which are identifiers, as C strings; one if there is none."""
    return [f'"{name}"' for name in names] or ['""']


def _pass(layout: Layout, names: Sequence[str]) -> str:
    """Return arguments of a function of the library as they are passed, each followed by a comma."""
    sources = {argument.name: f"argument + {argument.place}" for argument in layout.arguments}
    sources |= {"coordinate": "state", "velocity": "state + FMU_N_COORDINATES"}
    sources["internal"] = "state + 2 * FMU_N_COORDINATES"
    return "".join(f"{sources[name]}, " for name in names)


def _call(layout: Layout, spec: FunctionSpec) -> dict[str, str]:
    return {"symbol": spec.symbol, "passed": _pass(layout, spec.arguments)}


def _describe_tangent(tangent: Tangent | None) -> dict[str, Any] | None:
    if tangent is None:
        return None
    return {
        "lines": tangent.lines,
        "inputs": [{"name": name, "source": source} for name, source in tangent.inputs],
        "outputs": [{"name": name, "source": source} for name, source in tangent.outputs],
    }


def _describe_integrator(layout: Layout, method: str) -> dict[str, Any]:
    spec, manifest = layout.integrator(method), layout.manifest
    is_implicit = find_row(spec.name, bool(manifest.contact_name)).kind == "implicit"
    kinds = [kind.upper() for kind in WATCHED if kind in spec.events]
    return {
        "name": spec.name,
        "symbol": spec.symbol,
        "passed": _pass(layout, spec.arguments),
        "work_size": spec.work_size,
        "is_implicit": is_implicit,
        "has_run": not is_implicit or bool(spec.events) or bool(manifest.driven),
        "has_events": bool(spec.events),
        "watch": " | ".join(f"{manifest.name.upper()}_EVENT_{event}" for event in kinds) or "0",
        "n_counts": len(INTEGRATORS[spec.name].counts),
        "n_tensions": len(spec.tensions),
    }


def _place_positions(layout: Layout) -> dict[str, Any] | None:
    """Return the source of node positions, if they are coordinates and anchors."""
    if all(block.spec is not None for block in layout.blocks):
        return None
    manifest = layout.manifest
    coordinate = {position: k for k, position in enumerate(manifest.coordinate_node_axis)}
    anchors = {}
    for row in layout.arguments:
        if row.name == "anchor_position":
            anchors = {entry: row.place + k for k, entry in enumerate(row.parts)}
    positions = [(node, axis) for node in range(len(manifest.node_name)) for axis in manifest.axes]
    argument = [
        -1 if (node, axis) in coordinate else anchors.get((manifest.node_name[node], "xyz"[axis]), -1)
        for node, axis in positions
    ]
    places = manifest.body_places  # points of bodies are combinations of four corners
    return {
        "attached": [node for body in places for node in body.point],
        "corner": [node for body in places for _ in body.point for node in body.corner],
        "weight": print_numbers([x for body in places for row in body.weights for x in row]),
        "coordinate": [coordinate.get(position, -1) for position in positions],
        "argument": argument,
        "has_argument": max(argument) >= 0,
        "start": print_numbers([manifest.node_position[node][axis] for node, axis in positions]),
    }


OLD_NAMES = {"x86_64-linux": "linux64", "x86_64-windows": "win64", "x86_64-darwin": "darwin64"}
DATE = (1980, 1, 1, 0, 0, 0)  # the first that an archive can have


def check_targets(names: Sequence[str]) -> tuple[Target, ...]:
    """Return the machines of these names."""
    machines = tuple(find_target(name, "targets") for name in names)
    for target in machines:
        if target.kind != SHARED:
            raise InvalidValueError(
                f"an FMU holds shared libraries, and {target.name} has none",
                where="targets",
                given=target.name,
                allowed=", ".join(name for name, machine in TARGETS.items() if machine.kind == SHARED),
            )
    return machines


def compile_unit(
    name: str,
    sources: UnitSources,
    fmi: str,
    *,
    compiler: str | None,
    flags: str,
    targets: Sequence[Target] = (),
) -> dict[str, bytes]:
    """Return the binaries of a unit for these machines, for this one if none is named: place -> bytes."""
    texts = {key: content for key, content in sources.files.items() if key.endswith((".c", ".h"))}
    binaries = {}
    for target in targets or (find_system(),):
        tool = find_cross_compiler(target, compiler) if target.name else find_compiler(compiler)
        made = compile_library(texts, name=name, compiler=tool, flags=find_flags(flags), target=target)
        folder = (target.name or find_host()).replace("macos", "darwin")
        if fmi == "2.0":
            folder = OLD_NAMES.get(folder, folder)
        binaries[f"binaries/{folder}/{name}{target.suffix}"] = made.library
    return binaries


def write_archive(path: Path, files: Mapping[str, bytes]) -> None:
    """Write an archive of files, by their places in it."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files, key=lambda item: (item != "modelDescription.xml", item)):
            info = zipfile.ZipInfo(name, DATE)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(info, files[name])
