"""From the parts of a controller to its files: header, source, example, build files, description."""

from typing import Any

import numpy as np

from tensegrity_codegen.codegen.describe import made_by
from tensegrity_codegen.codegen.print.banner import BANNER
from tensegrity_codegen.codegen.print.printer import print_number, print_numbers
from tensegrity_codegen.codegen.print.render import render
from tensegrity_codegen.codegen.print.wrap_lines import wrap_lines
from tensegrity_codegen.control.embedded.calls import Calls, write_calls
from tensegrity_codegen.control.embedded.daqp_source import emit_daqp, read_daqp_licence
from tensegrity_codegen.control.embedded.distribution_tables import (
    DistributionTables,
    build_distribution_tables,
)
from tensegrity_codegen.control.embedded.measured import find_measured
from tensegrity_codegen.control.embedded.parts import ControllerParts
from tensegrity_codegen.control.embedded.status import CONTROL_STATUS
from tensegrity_codegen.control.embedded.tables import build_tables, count_knots
from tensegrity_codegen.runtime.model.state_names import name_states
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.precision import Precision

SAME_SPAN = {"double": 1e-6, "single": 1e-3}  # of a sample
SAME_COMMAND = {"double": 1e-12, "single": 1e-7}  # [m]


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

    Parameters
    ----------
    parts : ControllerParts
        The controller.
    model : Manifest or None
        Of the model that the controller calls; None where it calls none.
    precision : Precision
        Of all numbers.

    Returns
    -------
    dict
        Sizes, tables as C text, functions of the model.
    """
    measured = find_measured(parts.sensors, parts.manifest)
    calls = write_calls(model, measured, precision)
    name, tensions = precision.name, _distribute(parts, model, precision)
    sizes = find_sizes(parts, calls)
    return {
        "banner": BANNER,
        "name": parts.name,
        "NAME": parts.name.upper(),
        "model": "" if model is None else parts.model_name,
        "real": precision.c_type,
        "suffix": precision.suffix,
        "precision": name,
        "made_by": ", ".join(f"{what} {release}" for what, release in made_by().items()),
        "settings": _settings(parts, name) | {"WITH_OTHERS": tensions is not None and tensions.has_others},
        "statuses": CONTROL_STATUS,
        "sample": print_number(parts.sample, precision),
        "duration": print_number(parts.motion.duration, precision),
        "same_span": print_number(SAME_SPAN[name], precision),
        "same_command": print_number(SAME_COMMAND[name], precision),
        "sizes": sizes if tensions is None else sizes | tensions.sizes,
        "substeps": 1 if parts.estimator is None else parts.estimator.substeps,
        "knots": count_knots(parts),
        "names": find_names(parts),
        "tables": [*build_tables(parts, precision), *([] if tensions is None else tensions.tables)],
        "distribution": tensions,
        "calls": calls,
        "daqp": _write_daqp(parts, precision),
        "is_length": [int(item.is_length) for item in measured],
        "start": _start(parts, precision),
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


def _write_daqp(parts: ControllerParts, precision: Precision) -> dict[str, str]:
    """Return file name -> text of the solver of quadratic programs and of its licence, {} without one."""
    if parts.distribution is None:
        return {}
    text = emit_daqp(parts.daqp, single=precision.name == "single")
    return {f"{parts.name}_control_daqp.h": text, "LICENSE-DAQP.txt": read_daqp_licence(parts.daqp)}


def _settings(parts: ControllerParts, precision: str) -> dict[str, bool]:
    return {
        "WITH_FLOAT": precision == "single",
        "WITH_ESTIMATOR": parts.estimator is not None,
        "WITH_GAINS": parts.gains is not None,
        "WITH_SUMS": parts.gains is not None and len(parts.gains.integral_action) > 0,
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
        "N_SUMS": 0 if parts.gains is None else len(parts.gains.integral_action),
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
    states = name_states(parts.manifest)
    return {
        "actuator": parts.bounds.names,
        "coordinate": states[: len(states) // 2],
        "sensor": () if parts.estimator is None else parts.estimator.sensing.names,
    }


def _start(parts: ControllerParts, precision: Precision) -> dict[str, list[str]]:
    """Return the state at the start of the motion, and the measurements there."""
    point = parts.motion.at(0.0)
    state = np.concatenate([point.coordinate, point.velocity])
    found = {"state": print_numbers(state, precision, "the start")}
    if parts.estimator is not None:
        at = {"coordinate": point.coordinate, "velocity": point.velocity, "input": point.input}
        found["measured"] = print_numbers(parts.estimator.sensing.measure(at), precision, "the start")
    return found
