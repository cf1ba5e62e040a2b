"""All texts of a controller: calls of its model, header, source, example, build files, its description."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np

from tensegrity_codegen.codegen.build_manifest import find_program_versions
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.integrators.work_memory import count_entries
from tensegrity_codegen.codegen.print.printer import print_number, print_numbers
from tensegrity_codegen.codegen.print.render import BANNER, render, wrap_lines
from tensegrity_codegen.control.embedded.daqp_source import emit_daqp, find_daqp_archive, read_daqp_licence
from tensegrity_codegen.control.embedded.loaded import ControllerDescription
from tensegrity_codegen.control.embedded.parts import CONTROL_STATUS, ControllerParts, find_quantities
from tensegrity_codegen.control.embedded.prediction import build_prediction_tables
from tensegrity_codegen.control.embedded.tables import (
    build_distribution_tables,
    build_tables,
    count_knots,
    list_entries,
)
from tensegrity_codegen.runtime.model.interface import name_moving_states
from tensegrity_codegen.structure.actuators import Sensor
from tensegrity_codegen.system.arrays import IntArray
from tensegrity_codegen.tables.manifest import FunctionSpec, Manifest
from tensegrity_codegen.tables.precision import Precision
from tensegrity_codegen.tables.request import ModelRequest

SPAN_TOLERANCE = {"double": 1e-6, "single": 1e-3}  # of a sample
COMMAND_TOLERANCE = {"double": 1e-12, "single": 1e-7}  # [m]
ITEM_BYTES = {"int": 4, "unsigned char": 1, "float": 4, "double": 8}
UNSAFE = re.compile(r'[^ -~]|["\\?]')  # characters that strings in C do not hold as they are
SPANS = re.compile(r"/\*.*?\*/|#ifdef __cplusplus\n.*?#endif|^#[^\n]*", re.DOTALL | re.MULTILINE)


@dataclass(frozen=True)
class MeasuredNumber:
    """One measured number."""

    source: str  # a quantity of the model, ``"coordinate"``, ``"velocity"``, or ``""`` for a constant
    index: int = 0  # place in the source
    value: float = 0.0
    is_length: bool = False  # whether it is a length, above 0


def find_measured(sensors: tuple[Sensor, ...], manifest: Manifest) -> tuple[MeasuredNumber, ...]:
    """Return the numbers that sensors measure, in their order."""
    return tuple(number for sensor in sensors for number in _measure(sensor, manifest))


def _measure(sensor: Sensor, manifest: Manifest) -> list[MeasuredNumber]:
    if sensor.kind in ("member_length", "member_tension"):
        is_length = sensor.kind == "member_length"
        return [MeasuredNumber(sensor.kind, e, is_length=is_length) for e in sensor.targets]
    axes, coordinates = manifest.axes, [tuple(row) for row in manifest.coordinate_node_axis]
    if sensor.kind == "angular_velocity":
        places = [(body, column) for body in sensor.targets for column in range(len(axes))]
        return [MeasuredNumber("body_angular_velocity", len(axes) * body + k) for body, k in places]
    moves = sensor.kind == "node_velocity"
    points = set(manifest.body_points)
    numbers = []
    for node in sensor.targets:
        for column, axis in enumerate(axes):
            if not coordinates or node in points:
                numbers.append(MeasuredNumber(sensor.kind, node * len(axes) + column))
            elif (node, axis) in coordinates:
                source = "velocity" if moves else "coordinate"
                numbers.append(MeasuredNumber(source, coordinates.index((node, axis))))
            else:
                value = 0.0 if moves else float(manifest.stated_position[node, axis])
                numbers.append(MeasuredNumber("", value=value))
    return numbers


# The lower half of a symmetric matrix, row by row from the first entry of each row to the diagonal.


@dataclass(frozen=True)
class Envelope:
    """Where a matrix is stored."""

    first: IntArray  # (n,): first column of each row
    row: IntArray  # (n,): place of the first entry of each row
    place: IntArray  # (n_entries,): place of each entry that the model computes, -1 for one of the upper half
    size: int  # number of stored entries


def find_envelope(spec: FunctionSpec) -> Envelope:
    """Return the envelope of a symmetric matrix that a model computes, sparse or dense."""
    n = spec.shape[0]
    rows, columns = list_entries(spec)
    start = np.arange(n)
    lower = rows >= columns
    np.minimum.at(start, rows[lower], columns[lower])
    width = np.arange(n) - start + 1
    row = np.concatenate([[0], np.cumsum(width)[:-1]])
    index = np.where(lower, row[rows] + columns - start[rows], -1)
    return Envelope(start, row, index, int(width.sum()))


@dataclass(frozen=True)
class Calls:
    """Statements of the functions that call the model, and sizes of their memory."""

    acceleration: str  # C statements
    measure: list[str]
    mass: str
    length: str
    equilibrium: str
    state_jacobian: str
    input_jacobian: str
    envelope: Envelope | None  # of the mass matrix, None without one
    size_measured: int  # numbers of memory
    size_entries: int


def write_calls(model: Manifest | None, measured: tuple[MeasuredNumber, ...], precision: Precision) -> Calls:
    """Return the statements with which a controller calls its model."""
    functions = {} if model is None else {spec.quantity: spec for spec in model.functions}
    mass = functions.get("mass_matrix")
    sources = {number.source for number in measured} & set(functions)
    return Calls(
        acceleration=_call(functions.get("acceleration"), "acceleration"),
        measure=write_measure(functions, measured, precision),
        mass=_call(mass, "memory"),
        length=_call(functions.get("member_length"), "length"),
        equilibrium=_call(functions.get("equilibrium_matrix"), "entry"),
        state_jacobian=_call(functions.get("state_jacobian"), "by_state"),
        input_jacobian=_call(functions.get("input_jacobian"), "by_input"),
        envelope=None if mass is None else find_envelope(mass),
        size_measured=max((count_entries(functions[source]) for source in sources), default=1),
        size_entries=1 if mass is None else count_entries(mass),
    )


def _call(spec: FunctionSpec | None, result: str) -> str:
    return "" if spec is None else f"{spec.symbol}({', '.join((*spec.arguments, result))})"


def write_measure(
    functions: dict[str, FunctionSpec], measured: tuple[MeasuredNumber, ...], precision: Precision
) -> list[str]:
    """Return the lines that read the numbers, one call for each run of numbers of one source."""
    lines, ready = [], ""
    rows = list(enumerate(measured))
    for source, run in groupby(rows, key=lambda row: row[1].source):
        if source in functions and source != ready:
            lines += [f"if ({_call(functions[source], 'memory')} != 0) {{", "  return 1;", "}"]
            ready = source
        for k, number in run:
            memory = "memory" if source in functions else source
            value = f"{memory}[{number.index}]" if source else print_number(number.value, precision)
            lines.append(f"measured[{k}] = {value};")
    return lines


# The texts of all files.


def write_controller(context: dict[str, Any]) -> dict[str, str]:
    """Return file name -> text of all files of a controller but those of its model and its manifest."""
    name = context["name"]
    return {
        f"{name}_control.h": wrap_lines(render("control/control.h", context)),
        f"{name}_control.c": wrap_lines(render("control/control.c", context)),
        **context["daqp"],
        "example.c": wrap_lines(render("control/example.c", context)),
        "Makefile": render("control/Makefile", context),
        "CMakeLists.txt": render("control/CMakeLists.txt", context),
        "README.md": render("control/README.md", context),
    }


def build_context(parts: ControllerParts, model: Manifest | None, precision: Precision) -> dict[str, Any]:
    """Return the values of the templates of a controller; model: None if the controller calls none."""
    measured = find_measured(parts.sensors, parts.manifest)
    calls = write_calls(model, measured, precision)
    name, tensions, predicted = precision.name, None, None
    # The numbers of a distribution of tensions, or of model-predictive control.
    if parts.distribution is not None and model is not None:
        matrix = next(spec for spec in model.functions if spec.quantity == "equilibrium_matrix")
        tensions = build_distribution_tables(
            parts.distribution, parts.motion, matrix, precision, iterations=parts.qp_iterations
        )
    if parts.mpc is not None and model is not None:
        predicted = build_prediction_tables(parts, parts.mpc, model, precision)
    sizes = find_sizes(parts, calls) | ({} if predicted is None else predicted.sizes)
    return {
        "banner": BANNER,
        "name": parts.name,
        "NAME": parts.name.upper(),
        "model": "" if model is None else parts.model_name,
        "real": precision.c_type,
        "suffix": precision.suffix,
        "precision": name,
        "made_by": ", ".join(f"{program} {release}" for program, release in find_program_versions().items()),
        "settings": _list_settings(parts, name)
        | {
            "WITH_OTHERS": tensions is not None and tensions.has_others,
            "WITH_LIMITED": predicted is not None and predicted.sizes["N_LIMITED"] > 0,
        },
        "statuses": CONTROL_STATUS,
        "sample": print_number(parts.sample, precision),
        "duration": print_number(parts.motion.duration, precision),
        "same_span": print_number(SPAN_TOLERANCE[name], precision),
        "same_command": print_number(COMMAND_TOLERANCE[name], precision),
        "sizes": sizes if tensions is None else sizes | tensions.sizes,
        "substeps": 1 if parts.estimator is None else parts.estimator.substeps,
        "knots": count_knots(parts),
        "names": find_names(parts),
        "owners": {
            "nodes": parts.manifest.node_name,
            "members": parts.manifest.member_name,
            "bodies": tuple(body.name for body in parts.manifest.body_places),
        },
        "tables": [
            *build_tables(parts, precision),
            *([] if tensions is None else tensions.tables),
            *([] if predicted is None else predicted.tables),
        ],
        "distribution": tensions,
        "prediction": predicted,
        "calls": calls,
        "daqp": _write_daqp(parts, precision),
        "is_length": [int(number.is_length) for number in measured],
        "start": _print_start(parts, precision),
        "seen": "observation" if parts.policy else "length" if parts.estimator else "",
        "policy": parts.policy,
    }


def _write_daqp(parts: ControllerParts, precision: Precision) -> dict[str, str]:
    """Return file name -> text of the solver of quadratic programs and of its licence, {} without one."""
    if parts.distribution is None and parts.mpc is None:
        return {}
    archive = find_daqp_archive(parts.daqp_sdist)
    source = emit_daqp(archive, single=precision.name == "single", soft=parts.mpc is not None)
    return {f"{parts.name}_control_daqp.h": source, "LICENSE-DAQP.txt": read_daqp_licence(archive)}


def _list_settings(parts: ControllerParts, precision: str) -> dict[str, bool]:
    return {
        "WITH_FLOAT": precision == "single",
        "WITH_ESTIMATOR": parts.estimator is not None,
        "WITH_GAINS": parts.gains is not None,
        "WITH_SUMS": len(parts.integral_action) > 0,
        "WITH_MPC": parts.mpc is not None,
        "WITH_PUSH": parts.mpc is not None and len(parts.disturbed) > 0 and not len(parts.integral_action),
        "WITH_POLICY": parts.policy is not None,
        "WITH_CLIP": parts.mpc is None and parts.distribution is None,
        "WITH_DELAY": parts.policy is None and (parts.n_past > 0 or bool(parts.bounds.delay.any())),
        "WITH_PAST": parts.n_past > 0,
        "WITH_DISTURBANCE": len(parts.disturbed) > 0,
        "WITH_DISTRIBUTION": parts.distribution is not None,
    }


def find_sizes(parts: ControllerParts, calls: Calls) -> dict[str, int]:
    """Return the sizes that the header states, by their names."""
    if parts.policy is not None:
        return {
            "N_ACTUATORS": len(parts.bounds.names),
            "N_INPUTS": len(parts.motion.input_name),
            "N_SENSORS": len(find_names(parts)["sensor"]),
            "N_SENT": len(parts.delays().commands),
            "SIZE_LAYER": max(parts.policy.sizes),
        }
    n = parts.motion.coordinate.shape[1]
    return {
        "N_COORDINATES": n,
        "N_STATES": 2 * n,
        "N_ACTUATORS": len(parts.bounds.names),
        "N_INPUTS": len(parts.motion.input_name),
        "N_SUMS": len(parts.integral_action),
        "N_SENSORS": 0 if parts.estimator is None else len(parts.estimator.sensing.noise),
        "N_DISTURBANCES": len(parts.disturbed),
        "N_PAST": parts.n_past,
        "N_SENT": len(parts.delays().commands),
        "SIZE_MEASURED": calls.size_measured,
        "SIZE_MASS": 1 if calls.envelope is None else calls.envelope.size,
        "SIZE_ENTRIES": calls.size_entries,
    }


def find_names(parts: ControllerParts) -> dict[str, tuple[str, ...]]:
    """Return the names that a controller can tell, by the kinds of their owners."""
    if parts.policy is not None:
        numbers = [UNSAFE.sub("_", number) for number in parts.policy.description.numbers]
        return {"actuator": parts.bounds.names, "sensor": tuple(numbers)}
    states = name_moving_states(parts.manifest)
    return {
        "actuator": parts.bounds.names,
        "coordinate": states[: len(states) // 2],
        "sensor": () if parts.estimator is None else parts.estimator.sensing.names,
    }


def _print_start(parts: ControllerParts, precision: Precision) -> dict[str, list[str]]:
    """Return the state at the start of the motion, and the measurements there."""
    if parts.policy is not None:
        mean = parts.policy.mean[parts.policy.description.sources >= 0]
        return {"measured": print_numbers(mean, precision, "the mean")}
    point = parts.motion.at(0.0)
    state = np.concatenate([point.coordinate, point.velocity])
    start = {"state": print_numbers(state, precision, "the start")}
    if parts.estimator is not None:
        at = {"coordinate": point.coordinate, "velocity": point.velocity, "input": point.input}
        start["measured"] = print_numbers(parts.estimator.sensing.measure(at), precision, "the start")
    return start


@dataclass(frozen=True)
class ControllerFiles:
    """Texts of the files of a controller by name, without its manifest; and its description."""

    texts: Mapping[str, str]
    description: ControllerDescription

    def sources(self) -> dict[str, str]:
        """Return the C files of the library."""
        return {
            name: text
            for name, text in self.texts.items()
            if name.endswith((".c", ".h")) and name != "example.c"
        }


def write_files(parts: ControllerParts, request: ModelRequest, precision: Precision) -> ControllerFiles:
    """Return the files of a controller and of its model, with only the functions that it calls."""
    source, quantities = None, find_quantities(parts)
    if quantities:
        source = emit(replace(parts.subject, name=parts.model_name), replace(request, quantities=quantities))
    model = None if source is None else source.manifest
    context = build_context(parts, model, precision)
    texts = write_controller(context)
    if source is not None:
        texts |= {name: source.files[name] for name in source.files if name.startswith(parts.model_name)}
    # The description, with declarations for cffi.
    header = texts[f"{parts.name}_control.h"]
    description = ControllerDescription(
        name=parts.name,
        precision=precision.name,
        sample=parts.sample,
        duration=parts.motion.duration,
        sizes=context["sizes"],
        knots=context["knots"],
        actuators=find_names(parts)["actuator"],
        coordinates=find_names(parts).get("coordinate", ()),
        sensors=find_names(parts)["sensor"],
        inputs=parts.motion.input_name,
        statuses=tuple(CONTROL_STATUS),
        table_bytes=sum(ITEM_BYTES[table.c_type] * len(table.values) for table in context["tables"]),
        library="",
        declarations=read_declarations(header),
        made_by=find_program_versions(),
        model=None if model is None else json.loads(model.to_json()),
        policy=None if parts.policy is None else parts.policy.summary,
    )
    return ControllerFiles(texts, description)


def read_declarations(header: str) -> str:
    """Return types and functions of the header as C that cffi reads, with the enumerations of sizes."""
    declarations = re.sub(r"\b\w+_API ", "", SPANS.sub("", header))
    return re.sub(r"\s+", " ", declarations).replace("; ", ";\n").strip()
