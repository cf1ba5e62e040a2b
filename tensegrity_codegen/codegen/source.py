"""From a manifest and C bodies to files: header, source, example, Makefile, for every emitter the same."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from tensegrity_codegen.codegen.casadi_functions import (
    CASADI_INTERFACES,
    MAX_ENTRIES,
    NO_DERIVATIVES,
    Derivatives,
    casadi_context,
    casadi_pattern,
)
from tensegrity_codegen.codegen.compilation.flags import INSTRUCTION_SETS, find_flags
from tensegrity_codegen.codegen.emitter import Bodies, PrunedFunction, WantedFunction, result_size
from tensegrity_codegen.codegen.integrators.integrators import (
    copies_context,
    integrator_context,
    motion_settings,
)
from tensegrity_codegen.codegen.integrators.solvers import solver_context
from tensegrity_codegen.codegen.integrators.work_memory import count_line
from tensegrity_codegen.codegen.print.lane_printer import PrintedLanes
from tensegrity_codegen.codegen.print.printer import print_numbers
from tensegrity_codegen.codegen.print.reachable import drop_unreached
from tensegrity_codegen.codegen.print.render import BANNER, render, wrap_lines
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.manifest import (
    ALL_STATUS,
    C_API_VERSION,
    STATUS_TEXT,
    ArgumentSpec,
    FunctionSpec,
    Manifest,
)
from tensegrity_codegen.tables.precision import Precision, find_precision
from tensegrity_codegen.tables.quantities import QUANTITIES
from tensegrity_codegen.tables.quantities.quantity import REFERENCES

# How the example program names the entries of a result: by nodes, members, coordinates and inputs.


INDEX = {"format": "[%d]", "value": "@"}


def label_entries(manifest: Manifest, spec: FunctionSpec) -> Mapping[str, Any]:
    """Return how C prints the place of an entry of a result."""
    sizes = {kind: len(names) for kind, names in _indices(manifest).items()}
    shape = QUANTITIES[spec.quantity].shape
    if spec.pattern is not None:
        rows, columns = spec.pattern.shape
        return {
            "rows": _label(manifest, shape[0], rows, sizes),
            "columns": _label(manifest, shape[1], columns, sizes),
        }
    if len(spec.shape) == 2:
        return {"rows": None, "entries": _label_vectors(manifest, shape[0], spec.shape, sizes)}
    if not spec.shape:
        return {"rows": None, "entries": {"format": "value", "value": ""}}
    return {"rows": None, "entries": _label(manifest, shape[0], spec.shape[0], sizes)}


def _label(manifest: Manifest, dimension: str, count: int, sizes: Mapping[str, int]) -> Mapping[str, str]:
    """Return the label of an index that runs over a dimension of the table of quantities."""
    kind = dimension.removeprefix("n_").removesuffix("s")
    if sizes.get(kind) == count and count:
        return {"format": "%s", "value": f"{manifest.name}_{kind}_name[@]"}
    n = sizes["coordinate"]
    if kind == "state" and count == 2 * n and n:
        name = f"{manifest.name}_coordinate_name[@ % {n}]"
        return {"format": "%s%s", "value": f'{name}, @ < {n} ? "" : "\'"'}
    return INDEX


def _label_vectors(
    manifest: Manifest, dimension: str, shape: tuple[int, ...], sizes: Mapping[str, int]
) -> Mapping[str, str]:
    """Return the label of an entry of a table of vectors, whose rows run over a dimension."""
    count, width = shape
    kind = dimension.removeprefix("n_").removesuffix("s")
    if sizes.get(kind) != count or not count or width != len(manifest.axes):
        return INDEX
    axes = "".join("xyz"[axis] for axis in manifest.axes)
    value = f'{manifest.name}_{kind}_name[@ / {width}], "{axes}"[@ % {width}]'
    return {"format": "%s_%c", "value": value}


# Declarations for a foreign-function interface: types and functions, from the library's own header.


SPANS = re.compile(r"/\*.*?\*/|#ifdef __cplusplus\n.*?#endif|^#[^\n]*", re.DOTALL | re.MULTILINE)
CONSTANTS = re.compile(r"enum (?:\w+ )?\{[^}]*\};|extern \w+_API const \w+ \w+\[[^;]*;")
SPACE = re.compile(r"\s+")


def read_declarations(header: str) -> str:
    """Return types and functions of a generated header, one a line, as C that cffi reads."""
    text = CONSTANTS.sub("", SPANS.sub("", header))
    text = SPACE.sub(" ", re.sub(r"\b\w+_API ", "", text)).strip()
    text = text.replace("extern const ", "extern ")  # cffi reads no constants but whole numbers
    return re.sub(r"; (?=typedef|extern|int|const)(?![^{]*\})", ";\n", text)


# Rows of lanes that registers of 512 bits hold: they are transposed in whole multiples of it.
REGISTER_LANES = 8

# Constants that stand in the source file itself; more of them get a file of their own, compiled beside it.
MAX_CONSTANTS = 20_000


def write_sources(
    manifest: Manifest,
    functions: Sequence[WantedFunction],
    bodies: Bodies,
    lanes: Mapping[str, PrintedLanes] = MappingProxyType({}),
    derivatives: Derivatives = NO_DERIVATIVES,
) -> tuple[Manifest, dict[str, str]]:
    """Return the manifest with the declarations of the header, and file name -> text of all files."""
    context = _context(manifest, functions, bodies, lanes)
    if manifest.interfaces:
        with_casadi = bool(set(manifest.interfaces).intersection(CASADI_INTERFACES))
        plain = context["functions"] if with_casadi else ()
        context["casadi_functions"] = casadi_context(manifest.name, plain, derivatives)
        context["casadi_int"] = "long long int" if with_casadi else "int"
        context["casadi_memory"] = "int mem" if with_casadi else "void *mem"
    name, prefix = manifest.name, manifest.name.upper()
    source = drop_unreached(render("scene.c", context), (f"{prefix}_WITHOUT_NAMES",))
    returned = set(re.findall(rf"\b{prefix}_(\w+)", source))
    context["statuses"] = {word: n for word, n in context["statuses"].items() if word.upper() in returned}
    source += render("status_text.c", context)
    table_files = {f"{name}_tables.c": render("scene_tables.c", context)} if context["tables_apart"] else {}
    header = wrap_lines(render("scene.h", context))
    manifest = replace(manifest, declarations=read_declarations(header))
    return manifest, {
        f"{name}.h": header,
        f"{name}.c": wrap_lines(source),
        **{file: wrap_lines(text) for file, text in table_files.items()},
        "example.c": wrap_lines(render("example.c", context)),
        "Makefile": render("Makefile", context),
        "manifest.json": manifest.to_json(),
    }


def _context(
    manifest: Manifest, functions: Sequence[WantedFunction], bodies: Bodies, lanes: Mapping[str, PrintedLanes]
) -> dict[str, Any]:
    precision = find_precision(manifest.precision)
    arguments = {
        argument.name: _argument_context(argument, precision)
        for argument in manifest.arguments
        if argument.nominal
    }
    by_quantity = {spec.quantity: spec for spec in manifest.functions}
    n_coordinates = len(manifest.coordinate_name)
    sizes = {
        "nodes": len(manifest.node_name),
        "members": len(manifest.member_name),
        "axes": len(manifest.axes),
        "coordinates": n_coordinates,
    }
    if manifest.integrators or any("n_states" in QUANTITIES[name].shape for name in by_quantity):
        sizes["states"] = 2 * n_coordinates + manifest.n_internal
    optional = {
        "inputs": manifest.input_name,
        "internal": manifest.internal_name,
        "contacts": manifest.contact_name,
        "bar_pairs": manifest.bar_pair,
    }
    sizes |= {kind: len(names) for kind, names in optional.items() if names}
    passed = {"coordinate"}.union(
        *(function.arguments for function in manifest.functions),
        *(integrator.arguments for integrator in manifest.integrators),
        *(solver.arguments for solver in manifest.solvers),
    )
    passed |= {"velocity", "internal"} if manifest.integrators else set()
    has_table_file = _count_constants(manifest) > MAX_CONSTANTS
    integrators = integrator_context(manifest, arguments, _find_reach(manifest, functions))
    function_contexts = [
        _function_context(f, by_quantity[f.quantity.name], arguments, bodies)
        | {"lanes": lanes.get(f.quantity.name)}
        | {"label": label_entries(manifest, by_quantity[f.quantity.name])}
        for f in functions
    ]
    return {
        "banner": BANNER,
        "flags": " ".join(find_flags(manifest.flags).options),
        "instruction_sets": INSTRUCTION_SETS,
        "name": manifest.name,
        "NAME": manifest.name.upper(),
        "sources": f"{manifest.name}.c {manifest.name}_tables.c" if has_table_file else f"{manifest.name}.c",
        "tables_apart": has_table_file,
        "statuses": {word: number for number, word in enumerate(ALL_STATUS)},
        "status_text": STATUS_TEXT,
        "c_api_version": C_API_VERSION,
        "abi_version": manifest.abi_version,
        "scene_hash": manifest.scene_hash,
        "formulation": manifest.formulation,
        "emitter": manifest.emitter,
        "has_checks": manifest.checks != "none",
        "precision": precision.name,
        "real": precision.c_type,
        "suffix": precision.suffix,
        "settings": {
            "WITH_FLOAT": precision.name == "single",
            "WITH_NATIVE": not find_flags(manifest.flags).portable,
            **motion_settings(integrators),
        },
        "smallest": "1e-300" if precision.name == "double" else "1e-37",  # step of time [s]
        "has_casadi_abi": bool(manifest.interfaces),
        "has_machine_check": not find_flags(manifest.flags).portable,
        "made_by": ", ".join(f"{program} {release}" for program, release in manifest.made_by.items())[:159],
        "n": {key: sizes[key] for key in ("nodes", "members", "coordinates")},
        "sizes": sizes,
        "indices": _indices(manifest),
        "coordinate_node": [node for node, _ in manifest.coordinate_node_axis],
        "coordinate_axis": [axis for _, axis in manifest.coordinate_node_axis],
        "arguments": [argument for name, argument in arguments.items() if name in passed],
        "functions": function_contexts,
        "copies": copies_context(manifest, arguments, function_contexts),
        "batch": {
            "width": manifest.batch_width,
            "line": count_line(precision),
            "has_lanes": bool(lanes),
            # whether batch functions transpose 8 rows at once
            "has_avx512": bool(lanes)
            and precision.name == "double"
            and manifest.batch_width % REGISTER_LANES == 0,
        },
        "preamble": list(bodies.preamble),
        "references": {
            name: text
            for name, text in REFERENCES.items()
            if any(QUANTITIES[quantity].source.startswith(name) for quantity in by_quantity)
        },
        **integrators,
        "solvers": [solver_context(spec, manifest, arguments) for spec in manifest.solvers],
    }


def _find_reach(manifest: Manifest, functions: Sequence[WantedFunction]) -> dict[str, int]:
    """Return how many coordinates, from the first, each function depends on, where it may be few.

    In node distances the last ones are centres of mass, which are as large as the distance from the origin;
    functions of differences alone are free of their rounding.
    """
    if not find_formulation(manifest.formulation).has_centres:
        return {}
    return {f.quantity.name: f.coordinate_reach for f in functions if isinstance(f, PrunedFunction)}


def _count_constants(manifest: Manifest) -> int:
    """Return how many numbers the header's constant arrays hold."""
    patterns = [function.pattern for function in manifest.functions if function.pattern is not None]
    entries = sum(len(pattern.row) + len(pattern.column_start) for pattern in patterns)
    nominal = sum(len(argument.nominal) for argument in manifest.arguments)
    return 2 * len(manifest.coordinate_node_axis) + nominal + entries


def _indices(manifest: Manifest) -> dict[str, list[str]]:
    return {
        "node": list(manifest.node_name),
        "member": list(manifest.member_name),
        "coordinate": list(manifest.coordinate_name),
        "input": list(manifest.input_name),
        "bar_pair": list(manifest.bar_pair_name),
        "internal": list(manifest.internal_name),
        "contact": list(manifest.contact_name),
    }


def _argument_context(argument: ArgumentSpec, precision: Precision) -> dict[str, Any]:
    # Nominal values without the zeros at their end, one at least: C fills up an array with zeros.
    array = np.array(argument.nominal, dtype=np.float64)
    nonzero = np.flatnonzero((array != 0) | np.signbit(array))
    return {
        "name": argument.name,
        "size": len(argument.nominal),
        "shape_text": str(argument.shape or "scalar"),
        "unit": argument.unit,
        "sentence": argument.sentence,
        "nominal": print_numbers(array[: nonzero[-1] + 1 if nonzero.size else 1], precision, argument.name),
        "casadi_pattern": [
            *(reversed(argument.shape) if len(argument.shape) == 2 else (*argument.shape, 1)),
            1,
        ],
    }


def _function_context(
    function: WantedFunction, spec: FunctionSpec, arguments: Mapping[str, dict[str, Any]], bodies: Bodies
) -> dict[str, Any]:
    has_casadi_abi = spec.pattern is None or len(spec.pattern.row) <= MAX_ENTRIES
    return {
        "quantity": spec.quantity,
        "symbol": spec.symbol,
        "sentence": spec.sentence,
        "unit": spec.unit,
        "source": QUANTITIES[spec.quantity].source,
        "operations": spec.operations,
        "shape_text": str(spec.shape or "scalar"),
        "size": result_size(function),
        "pattern": spec.pattern,
        "has_casadi_abi": has_casadi_abi,
        "arguments": [arguments[name] for name in function.arguments],
        "input_size": max((arguments[name]["size"] for name in function.arguments), default=0),
        "is_checked": spec.quantity in bodies.checked,
        "lines": bodies.statements[spec.quantity],
        "casadi_pattern": casadi_pattern(function.shape, function.pattern) if has_casadi_abi else [],
    }
