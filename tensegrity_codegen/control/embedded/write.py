"""All texts of a controller: header, source, example, build files, those of its model, its description."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tensegrity_codegen.codegen.build_manifest import find_program_versions
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.print.printer import print_number, print_numbers
from tensegrity_codegen.codegen.print.render import BANNER, render, wrap_lines
from tensegrity_codegen.control.embedded.calls import Calls, find_measured, write_calls
from tensegrity_codegen.control.embedded.daqp_source import emit_daqp, find_daqp_archive, read_daqp_licence
from tensegrity_codegen.control.embedded.loaded import ControllerDescription
from tensegrity_codegen.control.embedded.parts import CONTROL_STATUS, ControllerParts, find_quantities
from tensegrity_codegen.control.embedded.prediction import PredictionTables, build_prediction_tables
from tensegrity_codegen.control.embedded.tables import (
    DistributionTables,
    build_distribution_tables,
    build_tables,
    count_knots,
)
from tensegrity_codegen.runtime.model.state_names import name_moving_states
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.precision import Precision
from tensegrity_codegen.tables.request import ModelRequest

SPAN_TOLERANCE = {"double": 1e-6, "single": 1e-3}  # of a sample
COMMAND_TOLERANCE = {"double": 1e-12, "single": 1e-7}  # [m]
ITEM_BYTES = {"int": 4, "unsigned char": 1, "float": 4, "double": 8}
SPANS = re.compile(r"/\*.*?\*/|#ifdef __cplusplus\n.*?#endif|^#[^\n]*", re.DOTALL | re.MULTILINE)


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
    """Return what the templates of a controller need.

    model: of the model that the controller calls; None where it calls none.
    precision: of all numbers.
    Returns: sizes, tables as C text, functions of the model.
    """
    measured = find_measured(parts.sensors, parts.manifest)
    calls = write_calls(model, measured, precision)
    name, tensions = precision.name, _distribute(parts, model, precision)
    predicted = _predict(parts, model, precision)
    sizes = find_sizes(parts, calls) | ({} if predicted is None else predicted.sizes)
    return {
        "banner": BANNER,
        "name": parts.name,
        "NAME": parts.name.upper(),
        "model": "" if model is None else parts.model_name,
        "real": precision.c_type,
        "suffix": precision.suffix,
        "precision": name,
        "made_by": ", ".join(f"{what} {release}" for what, release in find_program_versions().items()),
        "settings": _find_settings(parts, name)
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
        "tables": [
            *build_tables(parts, precision),
            *([] if tensions is None else tensions.tables),
            *([] if predicted is None else predicted.tables),
        ],
        "distribution": tensions,
        "prediction": predicted,
        "calls": calls,
        "daqp": _write_daqp(parts, precision),
        "is_length": [int(item.is_length) for item in measured],
        "start": _print_start(parts, precision),
    }


def _distribute(
    parts: ControllerParts, model: Manifest | None, precision: Precision
) -> DistributionTables | None:
    """Return the numbers of the distribution of tensions, None without one."""
    if parts.distribution is None or model is None:
        return None
    matrix = next(spec for spec in model.functions if spec.quantity == "equilibrium_matrix")
    return build_distribution_tables(
        parts.distribution, parts.motion, matrix, precision, iterations=parts.qp_iterations
    )


def _predict(parts: ControllerParts, model: Manifest | None, precision: Precision) -> PredictionTables | None:
    """Return the numbers of model-predictive control, None without it."""
    if parts.mpc is None or model is None:
        return None
    return build_prediction_tables(parts, parts.mpc, model, precision)


def _write_daqp(parts: ControllerParts, precision: Precision) -> dict[str, str]:
    """Return file name -> text of the solver of quadratic programs and of its licence, {} without one."""
    if parts.distribution is None and parts.mpc is None:
        return {}
    archive = find_daqp_archive(parts.daqp_sdist)
    text = emit_daqp(archive, single=precision.name == "single", soft=parts.mpc is not None)
    return {f"{parts.name}_control_daqp.h": text, "LICENSE-DAQP.txt": read_daqp_licence(archive)}


def _find_settings(parts: ControllerParts, precision: str) -> dict[str, bool]:
    return {
        "WITH_FLOAT": precision == "single",
        "WITH_ESTIMATOR": parts.estimator is not None,
        "WITH_GAINS": parts.gains is not None,
        "WITH_SUMS": len(parts.integral_action) > 0,
        "WITH_MPC": parts.mpc is not None,
        "WITH_PUSH": parts.mpc is not None and len(parts.disturbed) > 0 and not len(parts.integral_action),
        "WITH_CLIP": parts.mpc is None and parts.distribution is None,
        "WITH_DELAY": parts.n_past > 0 or bool(parts.bounds.delay.any()),
        "WITH_PAST": parts.n_past > 0,
        "WITH_DISTURBANCE": len(parts.disturbed) > 0,
        "WITH_DISTRIBUTION": parts.distribution is not None,
    }


def find_sizes(parts: ControllerParts, calls: Calls) -> dict[str, int]:
    """Return the sizes that the header states, by their names."""
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
    """Return the names that a controller can tell, by what they are of."""
    states = name_moving_states(parts.manifest)
    return {
        "actuator": parts.bounds.names,
        "coordinate": states[: len(states) // 2],
        "sensor": () if parts.estimator is None else parts.estimator.sensing.names,
    }


def _print_start(parts: ControllerParts, precision: Precision) -> dict[str, list[str]]:
    """Return the state at the start of the motion, and the measurements there."""
    point = parts.motion.at(0.0)
    state = np.concatenate([point.coordinate, point.velocity])
    found = {"state": print_numbers(state, precision, "the start")}
    if parts.estimator is not None:
        at = {"coordinate": point.coordinate, "velocity": point.velocity, "input": point.input}
        found["measured"] = print_numbers(parts.estimator.sensing.measure(at), precision, "the start")
    return found


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
    """Return the files of a controller and of its model, which has only what the controller calls."""
    source, quantities = None, find_quantities(parts)
    if quantities:
        source = emit(replace(parts.subject, name=parts.model_name), replace(request, quantities=quantities))
    model = None if source is None else source.manifest
    context = build_context(parts, model, precision)
    texts = write_controller(context)
    if source is not None:
        texts |= {name: source.files[name] for name in source.files if name.startswith(parts.model_name)}
    header = texts[f"{parts.name}_control.h"]
    description = ControllerDescription(
        name=parts.name,
        precision=precision.name,
        sample=parts.sample,
        duration=parts.motion.duration,
        sizes=context["sizes"],
        knots=context["knots"],
        actuators=find_names(parts)["actuator"],
        coordinates=find_names(parts)["coordinate"],
        sensors=find_names(parts)["sensor"],
        inputs=parts.motion.input_name,
        statuses=tuple(CONTROL_STATUS),
        table_bytes=sum(ITEM_BYTES[table.c_type] * len(table.values) for table in context["tables"]),
        library="",
        declarations=read_declarations(header),
        made_by=find_program_versions(),
        model=None if model is None else json.loads(model.to_json()),
    )
    return ControllerFiles(texts, description)


def read_declarations(header: str) -> str:
    """Return types and functions of the header as C that cffi reads, with the enumerations of sizes."""
    text = re.sub(r"\b\w+_API ", "", SPANS.sub("", header))
    return re.sub(r"\s+", " ", text).replace("; ", ";\n").strip()
