"""The C text of a simulated loop: a controller and what calls the plant, which is another library."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from tensegrity_codegen.codegen.print.banner import BANNER
from tensegrity_codegen.codegen.print.printer import print_numbers
from tensegrity_codegen.codegen.print.render import render
from tensegrity_codegen.codegen.print.wrap_lines import wrap_lines
from tensegrity_codegen.control.embedded.calls import write_measure
from tensegrity_codegen.control.embedded.measured import find_measured
from tensegrity_codegen.control.embedded.parts import ControllerParts
from tensegrity_codegen.control.embedded.tables import build_tables
from tensegrity_codegen.control.embedded.write import ControllerFiles, read_declarations
from tensegrity_codegen.control.feedback.loop.sampled_plant import ATOL, MOST_STEPS, NODE_LOAD, RTOL
from tensegrity_codegen.runtime.integrate.integration import find_integrator
from tensegrity_codegen.runtime.trajectory.control_quantities import CONTROL_METHOD
from tensegrity_codegen.tables.manifest import STATUS, FunctionSpec, IntegratorSpec, Manifest
from tensegrity_codegen.tables.precision import find_precision

DOUBLE = find_precision("double")
OF_STATE = {"coordinate": "state", "velocity": "state + N_Q"}
TABLES = ("ACTUATOR_PLACE", "DELAY_SAMPLES", "DELAY_REST")


@dataclass(frozen=True)
class LoopSource:
    """A simulated loop in C.

    Attributes
    ----------
    sources : mapping of str to str
        Files of the library.
    declarations : str
        Its types and functions, for cffi.
    symbols : mapping of str to str
        Field of ``plant_functions`` -> function of the plant's library.
    arguments : tuple of str
        Fields of ``plant_arguments``.
    function : str
        The function that simulates.
    """

    sources: Mapping[str, str]
    declarations: str
    symbols: Mapping[str, str]
    arguments: tuple[str, ...]
    function: str


def write_closed_loop(
    parts: ControllerParts, files: ControllerFiles, plant: Manifest, watch: int
) -> LoopSource:
    """Return the C text of a loop.

    Parameters
    ----------
    parts, files : ControllerParts, ControllerFiles
        The controller, in double precision.
    plant : Manifest
        Of the model that is simulated, with the integrator CONTROL_METHOD.
    watch : int
        Kinds of events at which its steps end.
    """
    spec = find_integrator(plant, CONTROL_METHOD)
    measured = find_measured(parts.sensors, plant)
    sources = {item.source for item in measured} | {"member_tension"}
    called = {item.quantity: item for item in plant.functions if item.quantity in sources}
    symbols = {name: item.symbol for name, item in called.items()}
    symbols["integrate"] = f"{spec.symbol}_run"
    sizes = {item.name: item.shape for item in plant.arguments if item.name not in OF_STATE}
    context = {
        "name": parts.name,
        "NAME": parts.name.upper(),
        "real": "double",
        "suffix": "",
        "settings": {
            "WITH_ESTIMATOR": parts.estimator is not None,
            "WITH_DISTRIBUTION": parts.distribution is not None,
            "WITH_LOADS": NODE_LOAD in sizes,
        },
        "functions": [_write_field(plant.declarations, *item) for item in symbols.items()],
        "arguments": tuple(sizes),
    }
    types = render("control/closed_loop_types.h", context)
    return LoopSource(
        sources={
            **files.sources(),
            "closed_loop.c": wrap_lines(
                render(
                    "control/closed_loop.c", context | _write_code(parts, plant, spec, called, watch, types)
                )
            ),
        },
        declarations="\n".join(
            (
                plant.declarations,
                files.description.declarations,
                read_declarations(types),
                f"void {parts.name}_simulate(const plant_functions *f, closed_loop *d);",
            )
        ),
        symbols=symbols,
        arguments=tuple(sizes),
        function=f"{parts.name}_simulate",
    )


def _write_code(
    parts: ControllerParts,
    plant: Manifest,
    spec: IntegratorSpec,
    called: Mapping[str, FunctionSpec],
    watch: int,
    types: str,
) -> dict[str, Any]:
    """Return what the template of the code needs besides names."""
    offsets = sorted({0.0, *(float(time) for time in parts.delays().offset if time > 0.0)})
    load = next((item for item in plant.arguments if item.name == NODE_LOAD), None)
    # A function is a field of plant_functions here, and its arguments are fields of plant_arguments.
    fields = {
        name: replace(item, symbol=f"f->{name}", arguments=tuple(map(_name_argument, item.arguments)))
        for name, item in called.items()
    }
    tension = fields["member_tension"]
    given = ", ".join(f"with->{name}" for name in spec.arguments)
    return {
        "banner": BANNER,
        "declarations": f"{plant.declarations}\n\n{types}",
        "n_members": len(plant.member_name),
        "load_size": 0 if load is None else math.prod(load.shape),
        "arrivals": print_numbers(offsets, DOUBLE, "delays"),
        "plant_ok": STATUS.index("ok"),
        "plant_step_too_small": STATUS.index("step_too_small"),
        "tables": [table for table in build_tables(parts, DOUBLE) if table.name in TABLES],
        "run_type": f"{plant.name}_run",
        "watch": watch,
        "integrate": f"f->integrate(span, {RTOL!r}, {ATOL!r}, {MOST_STEPS}, time, &step, state, {given}, "
        "2, sample_time, samples, &n_sampled, &run, work)",
        "tension": f"{tension.symbol}({', '.join((*tension.arguments, 'tension'))})",
        "measure": write_measure(fields, find_measured(parts.sensors, plant), DOUBLE),
    }


def _name_argument(name: str) -> str:
    return name if name in OF_STATE else f"with->{name}"


def _write_field(declarations: str, field: str, symbol: str) -> str:
    """Return the declaration of a function of the plant as a pointer of this name."""
    found = re.search(rf"int {re.escape(symbol)}\(([^;]*)\);", declarations)
    assert found is not None, symbol  # declarations have all functions of the manifest
    return f"int (*{field})({found[1].strip()})"
