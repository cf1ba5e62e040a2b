"""Export of model-predictive control to acados: dynamics in C, a script that makes the solver, the motion."""

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.print.instructions import read_instructions
from tensegrity_codegen.codegen.print.operations import print_operation
from tensegrity_codegen.codegen.print.printer import print_number
from tensegrity_codegen.codegen.print.render import BANNER, render, wrap_lines
from tensegrity_codegen.control.embedded.parts import (
    ControllerCode,
    ControllerParts,
    collect_parts,
    find_model_and_request,
    find_motion,
)
from tensegrity_codegen.control.embedded.prediction import tabulate_derivatives
from tensegrity_codegen.control.embedded.tables import TablePrinter
from tensegrity_codegen.control.embedded.write import write_calls
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorLimits
from tensegrity_codegen.control.feedback.mpc import Mpc
from tensegrity_codegen.export.exporter import Exported, Exporter
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.system.checks import check_instance, check_path, check_switch
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.system.output_folder import check_folder, write_folder
from tensegrity_codegen.tables.precision import PRECISIONS
from tensegrity_codegen.tables.request import ModelRequest

DOUBLE = PRECISIONS["double"]
QUANTITIES = ("acceleration", "state_jacobian", "input_jacobian")
HUGE = 1e10  # infinity of acados
FUNCTION = re.compile(r"\b([a-z]\w*)\(")


def export_acados(
    scene: str | Path | CompiledModel,
    motion: Motion | Equilibrium,
    mpc: Mpc,
    *,
    out: str | Path,
    limits: ActuatorLimits | None = None,
    arguments: Mapping[str, Any] | None = None,
    overwrite: bool = False,
) -> Exported:
    """Write the problem of model-predictive control for acados into a folder: all of its files, or none.

    Parameters
    ----------
    scene, motion, limits, arguments
        As of `build_controller`.
    mpc : Mpc
        The design, as of `design_mpc`.
    out : str or Path
        Folder, made if it does not exist.
    overwrite : bool
        Whether files may be replaced that are not as SHA256SUMS in the folder says.

    Returns
    -------
    Exported
        Facts, notes, and the files by name.

    Raises
    ------
    InvalidValueError, FormulationError, LibraryError
        As `build_controller`; or an actuator has a delay, or lengths need an operation that CasADi has under
        no name in Python.
    OutputError
        The folder cannot be written, or holds files that may not be replaced.

    Notes
    -----
    ``python make_solver.py`` in the folder needs acados and its package `acados_template`; it makes the
    solver and runs one step. The problem is that of `build_controller` with an `Mpc`: one real-time iteration
    from the same plan gives the same plan.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tensegrity_codegen import compile_scene, design_mpc, export_acados, find_equilibrium
    >>> winch = '[[actuators]]\\nname = "winch"\\nmembers = "cord"\\n'
    >>> _ = Path("lift.toml").write_text('axes = "z"\\n' + Path("two_nodes.toml").read_text() + winch)
    >>> model = compile_scene("lift.toml", for_=("equilibrium", "control"))
    >>> found = find_equilibrium(model)
    >>> mpc = design_mpc(model, found, [100.0, 1.0], [1.0], sample=0.02)
    >>> sorted(export_acados(model, found, mpc, out="lift_acados").files)
    ['README.md', 'dynamics.c', 'make_solver.py', 'no_functions.c', 'problem.json']
    """
    check_path(out, "out")
    check_switch(overwrite, "overwrite")
    check_folder(out)
    exported = _export(scene, motion, mpc, limits, arguments)
    protected = [Path(scene)] if isinstance(scene, str | Path) else []
    write_folder(out, exported.files, inputs=protected, overwrite=overwrite, listed=True)
    return exported


def _export(
    scene: str | Path | CompiledModel,
    motion: Motion | Equilibrium,
    mpc: Mpc,
    limits: ActuatorLimits | None = None,
    arguments: Mapping[str, Any] | None = None,
) -> Exported:
    check_instance(mpc, Mpc, "mpc", "an Mpc of design_mpc")
    described, request = find_model_and_request(scene, motion)
    reference = find_motion(described, motion, arguments)
    loop = collect_parts(
        described, reference, gains=mpc, estimator=None, distribution=None, sample=None, limits=limits,
        code=ControllerCode(),
    )  # fmt: skip
    late = np.flatnonzero(loop.bounds.delay > 0.0)
    if late.size:
        raise FormulationError(
            "the problem for acados has no delays of actuators",
            where=f"actuators.{loop.bounds.names[int(late[0])]}.delay",
            given=f"{loop.bounds.delay[late[0]]:g} s",
            allowed="0 s",
            hint="build_controller predicts delays (control --mpc --build); limits=ActuatorLimits(delay=0.0) "
            "leaves them out",
        )
    request = replace(request, precision="double")
    texts = {
        "dynamics.c": _write_dynamics(loop, mpc, request),
        "no_functions.c": f"/* {BANNER} */\n/* Those of every phase are in dynamics.c. */\n",
        "make_solver.py": render("acados/make_solver.py", {"limits": _print_limits(loop, mpc, request)}),
        "problem.json": json.dumps(_list_numbers(loop, mpc), indent=1, allow_nan=False) + "\n",
        "README.md": render("acados/README.md", {"banner": BANNER, "parts": loop, "mpc": mpc}),
    }
    return Exported(
        {"n_states": len(mpc.Q), "n_actuators": len(mpc.R), "blocks": list(mpc.blocks)},
        ("sensors and an estimator are not in the project: a step takes the state",),
        {name: content.encode("utf-8") for name, content in texts.items()},
    )


def _write_dynamics(parts: ControllerParts, mpc: Mpc, request: ModelRequest) -> str:
    """Return the C of the model and of a sample of its dynamics, one file."""
    name = parts.model_name
    source = emit(replace(parts.subject, name=name), replace(request, quantities=QUANTITIES))
    model = source.files[f"{name}.c"].replace(f'#include "{name}.h"\n', source.files[f"{name}.h"], 1)
    functions = {spec.quantity: spec for spec in source.manifest.functions}
    printer, n = TablePrinter(DOUBLE), len(mpc.coordinate_range)
    context = {
        "name": parts.name, "real": "double", "suffix": "", "settings": {}, "model": model,
        "sizes": {
            "N_Q": n, "N_X": 2 * n, "N_Z": len(parts.integral_action), "N_U": len(mpc.R),
            "N_IN": len(parts.motion.input_name), "MPC_SUBSTEPS": mpc.substeps,
            "SIZE_CALL": max(int(np.prod(spec.shape)) for spec in source.manifest.functions),
        },
        "sample": print_number(parts.sample, DOUBLE), "calls": write_calls(source.manifest, (), DOUBLE),
        "tables": [
            printer.whole("ACTUATOR_PLACE", parts.bounds.place, "input of each actuator"),
            printer.real("SUM_OUTPUT", parts.integral_action, "what is summed of errors"),
            *tabulate_derivatives(printer, functions, parts.bounds.place, n),
        ],
    }  # fmt: skip
    return wrap_lines(render("acados/dynamics.c", context))


def _print_limits(parts: ControllerParts, mpc: Mpc, request: ModelRequest) -> list[str]:
    """Return lines of Python that set t0, t1, ...; in the last one the longest rest lengths, of x.

    These are slope length - shift: where a linear spring has its least tension.
    """
    chosen = mpc.cables.limited
    symbolic = build_model(parts.subject, replace(request, quantities=("member_length",)))
    coordinate = symbolic.arguments["coordinate"].symbol
    axial, tension = mpc.cables.axial_stiffness[chosen], mpc.least_tension[chosen]
    with np.errstate(all="ignore"):
        slope = np.where(axial > 0.0, axial / (axial + tension), 1.0)
        shift = np.where(axial > 0.0, 0.0, tension / mpc.cables.spring_constant[chosen])
    length = ca.SX(symbolic.expression("member_length"))[chosen.tolist()]
    function = ca.Function("limits", [coordinate], [ca.densify(ca.cse(slope * length - shift))])
    texts: list[str] = []
    lines, results = [], ["0"] * len(chosen)
    for k, step in enumerate(read_instructions(function)):
        operands = [texts[j] for j in step.operands]
        texts.append(f"x[{step.place[1]}]" if step.operation == ca.OP_INPUT else f"({step.value!r})")
        if step.operation == ca.OP_OUTPUT:
            results[step.place[1]] = operands[0]
        elif step.is_operation:
            texts[k], line = f"t{k}", print_operation(step.operation, operands, DOUBLE)
            if any(not hasattr(ca, call) for call in FUNCTION.findall(line)) or set(line) & set("?&|!"):
                raise FormulationError(
                    "the lengths of members need an operation that the script for acados has not",
                    where=parts.name, given=line, allowed="what CasADi has by a name in Python",
                    hint="design_mpc(..., least_tension=-inf) needs no lengths",
                )  # fmt: skip
            lines.append(FUNCTION.sub(r"ca.\1(", f"t{k} = {line}"))
    return [*lines, f"return ca.vertcat({', '.join(results)})"]


def _list_numbers(parts: ControllerParts, mpc: Mpc) -> dict[str, Any]:
    """Return the problem, JSON-ready."""
    bounds, cables, motion, sample = parts.bounds, mpc.cables, parts.motion, parts.sample
    chosen, bounded = cables.limited, np.flatnonzero(np.isfinite(mpc.coordinate_range).any(axis=1))
    ranges = mpc.coordinate_range[bounded]
    times = sample * np.arange(int(np.ceil(motion.duration / sample)) + 2)  # the last one after the end
    points = [motion.at(t) for t in times.tolist()]
    inputs = np.array([motion.at(t).input for t in (times + 0.5 * sample).tolist()])
    length = cables.base + inputs @ cables.other_incidence.T + inputs[:, bounds.place] @ cables.incidence.T
    numbers = {
        "Q": mpc.Q, "R": mpc.R, "last_weight": mpc.gains.S[-1], "sum_output": parts.integral_action,
        "reach": bounds.rate * sample, "least": bounds.least, "most": bounds.most,
        "pull": cables.incidence[chosen],
        "soft_least": np.concatenate([np.full(len(chosen), -np.inf), ranges[:, 0]]),
        "soft_most": np.concatenate([np.zeros(len(chosen)), ranges[:, 1]]),
        "start": motion.at(0.0).input[bounds.place],
        "motion_state": [np.concatenate([point.coordinate, point.velocity]) for point in points],
        "motion_input": inputs, "motion_rest": length[:, chosen],
    }  # fmt: skip
    return {
        "name": parts.name, "sample": sample, "blocks": list(mpc.blocks), "actuators": list(bounds.names),
        "place": bounds.place.tolist(), "bounded": bounded.tolist(), "soft_weight": mpc.excess_weight,
        "numbers": {key: np.clip(value, -HUGE, HUGE).tolist() for key, value in numbers.items()},
    }  # fmt: skip


EXPORTER = Exporter(
    name="acados",
    title="a folder with the problem of `control --mpc` for acados (C and Python)",
    endings=(".py",),
    write=lambda source, path, *, design, compiler=None: _export(*design),
    options=("design", "compiler"),
    order=80,
    is_folder=True,
)
