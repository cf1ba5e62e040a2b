"""Computation of the motion of one scene for `simulate`, or of those from the starts of a file."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tensegrity_codegen.analyses.motions.motion_answer import BatchAnswer, MotionAnswer
from tensegrity_codegen.analyses.motions.motion_options import MotionAnalysis
from tensegrity_codegen.analyses.motions.schedule import read_schedule
from tensegrity_codegen.pipeline.analyses import balance_energy, find_needs
from tensegrity_codegen.pipeline.build_library import MANY_CALLS, BuiltLibrary
from tensegrity_codegen.pipeline.settle import has_statics, settle_structure
from tensegrity_codegen.runtime.integrate.raw_results import STOPPED_AT
from tensegrity_codegen.runtime.simulate.condition import find_quantities
from tensegrity_codegen.runtime.simulate.simulate import CONTACT_QUANTITIES, Until, simulate
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.scene.checks.plausible_start import warn_of_sampled_contacts
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.contact_estimates import require_ground
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import DuplicateNameError
from tensegrity_codegen.system.progress import work_pass
from tensegrity_codegen.tables.request import ModelRequest

if TYPE_CHECKING:
    from tensegrity_codegen.analyses.cases.scene_case import SceneCase

STIFFER = 4.0  # stiffness of the ground that a motion is compared with, over its own
LARGE_CHANGE = 0.01  # part of the structure's size above which the comparison is a warning


def solve_motion(analysis: MotionAnalysis, case: "SceneCase") -> MotionAnswer:
    """Return the motion of a scene, and with `ground_check` that on a stiffer ground beside it."""
    # Without a ground there is nothing to compare, which is said before anything is computed.
    ground = require_ground(case.subject, "--ground-check").ground if analysis.ground_check else None
    library, run_arguments = _prepare(analysis, case)
    if library.structure is not None:
        interval = analysis.t_end / max(analysis.samples - 1, 1)
        case.warn(*warn_of_sampled_contacts(library.structure, interval))
    motion = _simulate(analysis, library, run_arguments)
    facts = {
        "library": str(library.path),
        "t_asked": analysis.t_end,
        "t_stopped": motion.evidence.get(STOPPED_AT),
        "inputs": {name: value for name, value in run_arguments["arguments"].items() if name != "internal"},
    }
    if ground is None:
        return MotionAnswer(case, motion, facts)
    # The same motion on a stiffer ground.
    on_stiffer = replace(case, subject=replace(case.subject, ground=ground.stiffen(STIFFER)))
    stiffer = _simulate(analysis, *_prepare(analysis, on_stiffer))
    change = compare_motions(motion, stiffer)
    if change["change_over_size"] > LARGE_CHANGE:
        case.warn("the motion depends on the stiffness of the ground, see ground check")
    return MotionAnswer(case, motion, facts, stiffer, {"stiffness_factor": STIFFER, **change})


def solve_starts(analysis: MotionAnalysis, case: "SceneCase", starts: Path) -> BatchAnswer:
    """Return the motions from the starts of a file, as a batch if the method can."""
    from tensegrity_codegen.runtime.simulate.motion_input import read_starts
    from tensegrity_codegen.runtime.simulate.simulate_batch import simulate_batch

    options = analysis.run_options
    schedule = read_schedule(analysis.profile, analysis.profile_kind, analysis.t_end, case, case.inputs)
    needs = find_needs("simulate_batch", case.subject, case.request, method=options.method, rtol=options.rtol)
    library = case.build_library(case.subject, _keeping(analysis, needs.alone(case.request)), MANY_CALLS)
    model = library.load()
    starts_of_file = read_starts(starts, model.manifest)
    _check_given_once(case.inputs, starts_of_file["arguments"], starts)
    starts_of_file["arguments"] |= case.inputs
    with work_pass("simulating") as progress:
        batch = simulate_batch(
            model,
            t_end=analysis.t_end,
            samples=analysis.samples,
            threads=analysis.threads,
            schedule=schedule,
            progress=progress,
            **options.as_given(),
            **starts_of_file,
        )
    facts = {"control": options.control, "inputs": dict(case.inputs), "library": str(library.path)}
    return BatchAnswer(case, batch, facts)


def compare_motions(motion: Trajectory, other: Trajectory) -> dict[str, Any]:
    """Return how far nodes are elsewhere in another motion, at the samples that both have."""
    count = min(len(motion.time), len(other.time))
    distance = np.linalg.norm(motion.node_position[:count] - other.node_position[:count], axis=2)
    sample, node = np.unravel_index(int(distance.argmax()), distance.shape)
    return {
        "status": other.status,
        "largest_change": float(distance[sample, node]),
        "change_over_size": float(distance[sample, node] / np.ptp(motion.node_position[0], axis=0).max()),
        "node": motion.node_name[node],
        "time": float(motion.time[sample]),
        "change_at_end": float(distance[-1].max()),
    }


def _simulate(analysis: MotionAnalysis, library: BuiltLibrary, run_arguments: dict[str, Any]) -> Trajectory:
    """Return the motion."""
    is_contact, condition = analysis.event
    with work_pass("simulating") as progress:
        return simulate(
            library.load(),
            t_end=analysis.t_end,
            samples=analysis.samples,
            until=Until(condition, is_contact),
            progress=progress,
            **run_arguments,
            **analysis.run_options.as_given(),
        )


def _prepare(analysis: MotionAnalysis, case: "SceneCase") -> tuple[BuiltLibrary, dict[str, Any]]:
    """Return the library of a motion; its start (None: of the scene), inputs and schedule, by name."""
    structure = balance_energy(case.subject, case.request)
    run_arguments: dict[str, Any] = {"coordinate": None, "arguments": dict(case.inputs)}
    schedule = read_schedule(analysis.profile, analysis.profile_kind, analysis.t_end, case, case.inputs)
    run_arguments["schedule"] = schedule
    # The equilibrium that it starts from, with the first values of the schedule; in node positions if
    # the formulation has no statics.
    at_start = {name: float(values[0]) for name, values in schedule.values.items()} if schedule else {}
    inputs = {**case.inputs, **at_start}
    settles = analysis.settle
    if settles and isinstance(structure, Structure) and not has_statics(case.request):
        structure = settle_structure(
            structure,
            case.request,
            compiler=case.compiler,
            flags=case.flags,
            warn=case.warn,
            arguments=inputs,
        )
        settles = False
    request = _request_motion(analysis, structure, case.request, settles)
    library = case.build_library(structure, request, MANY_CALLS)
    if settles:
        from tensegrity_codegen.runtime.paths.find_equilibrium import find_equilibrium

        equilibrium = find_equilibrium(library.load(), arguments=inputs)
        case.warn(*equilibrium.warnings)
        run_arguments["coordinate"] = equilibrium.coordinate
        run_arguments["arguments"] |= equilibrium.internal_argument
    return library, run_arguments


def _request_motion(
    analysis: MotionAnalysis, structure: Subject, request: ModelRequest, settles: bool
) -> ModelRequest:
    """Return the request with all that a motion needs of a library."""
    is_contact, condition = analysis.event
    needs = find_needs("simulate", structure, request, method=analysis.method, rtol=analysis.rtol)
    contacts = CONTACT_QUANTITIES if is_contact else ()
    motion_request = replace(needs, quantities=(*needs.quantities, *contacts)).alone(request)
    if settles:
        motion_request = find_needs("equilibrium", structure, request).besides(motion_request)
    if is_contact and needs.integrators:  # SciPy's methods look at distances by themselves
        motion_request = request_event(motion_request, "contact")
    if condition is not None:
        motion_request = request_event(motion_request, "condition", condition)
    return _keeping(analysis, motion_request)


def _keeping(analysis: MotionAnalysis, request: ModelRequest) -> ModelRequest:
    """Return the request with integrators that conserve the quantity of `--keep`."""
    return replace(request, keep=(analysis.conserve,)) if analysis.conserve else request


def request_event(request: ModelRequest, kind: str, condition: str = "") -> ModelRequest:
    """Return the request with integrators that watch a kind of event, and the quantities of a condition."""
    quantities = find_quantities(condition) if condition else ()
    return replace(
        request, quantities=(*request.quantities, *quantities), events=(*(request.events or ()), kind)
    )


def _check_given_once(values: Any, arguments: dict[str, Any], starts: Path) -> None:
    """Raise DuplicateNameError for an input that both --input and the file of starts give."""
    twice = sorted(values.keys() & arguments.keys()) or (["input"] if values and "input" in arguments else [])
    if twice:
        raise DuplicateNameError(
            "an input is given twice",
            where="--input",
            given=", ".join(values),
            allowed=f"inputs that {starts} does not hold",
            hint=f"remove the option, or the array {twice[0]!r} from the file",
        )
