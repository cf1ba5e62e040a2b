"""Simulated closed loops in C: one motion and controller, many draws of errors."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

from tensegrity_codegen.control.embedded.closed_loop import CompiledLoop
from tensegrity_codegen.control.embedded.parts import (
    MOVED_TO_CODE,
    SIMULATED_LOOP_NAME,
    ControllerCode,
    collect_parts,
    find_model_and_request,
    read_code,
)
from tensegrity_codegen.control.embedded.write import write_files
from tensegrity_codegen.control.feedback.closed_loop import simulate_control
from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
from tensegrity_codegen.control.feedback.design.linear_samples import build_rest
from tensegrity_codegen.control.feedback.loop.actuator_bounds import MOVED_TO_LIMITS, ActuatorLimits
from tensegrity_codegen.control.feedback.loop.control_run import ControlRun, compare_with_open_loop
from tensegrity_codegen.control.feedback.loop.sampled_plant import (
    Disturbance,
    count_samples,
    describe_unknown_delays,
    read_disturbance,
)
from tensegrity_codegen.control.feedback.loop.tension_distribution import TensionDistribution
from tensegrity_codegen.control.feedback.mpc import Mpc
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.require import require_double, require_model, require_quantities
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.system.checks import (
    check_instance,
    check_positive,
    check_switch,
    check_whole,
    with_moved,
)
from tensegrity_codegen.tables.precision import find_precision


@with_moved(**MOVED_TO_CODE, **MOVED_TO_LIMITS)
def simulate_control_batch(
    model: CompiledModel,
    motion: Motion | Equilibrium,
    gains: Gains | Mpc | None = None,
    *,
    draws: Sequence[Disturbance],
    estimator: Estimator | None = None,
    distribution: TensionDistribution | None = None,
    t_end: float | None = None,
    sample: float | None = None,
    limits: ActuatorLimits | None = None,
    threads: int | None = None,
    code: ControllerCode | None = None,
    compare: bool = True,
) -> tuple[ControlRun, ...]:
    """Simulate a motion with sampled feedback many times, controller and model in one loop in C.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"control"``, see compile_scene, with its structure.
    motion : Motion or Equilibrium
        The motion to hold, as of `simulate_control`.
    gains : Gains or Mpc, optional
        Feedback, or model-predictive control of `design_mpc`; without it the inputs of the motion alone
        act (open loop).
    draws : sequence of Disturbance
        One for each run.
    estimator : Estimator, optional
        Estimates the state from noisy measurements; without it feedback acts on the true state.
    distribution : TensionDistribution, optional
        Keeps tensions above the least ones.
    t_end : float, optional [s]
        End of the simulation; by default the end of the motion.
    sample : float, optional [s]
        Time between two commands; by default that of the gains, 0.005 s without.
    limits : ActuatorLimits, optional
        Rates, ranges and delays of the actuators, by default those of the scene.
    threads : int, optional
        Number of runs at the same time; by default the number of processors.
    code : ControllerCode, optional
        Stored gains, solver and compiler, as of `build_controller`; name and precision are not used.
    compare : bool
        As of `simulate_control`, which simulates the open loops.

    Returns
    -------
    tuple of ControlRun
        One for each draw.

    Raises
    ------
    InvalidValueError, NonFiniteError, UnknownNameError, FormulationError
        As `simulate_control`.
    LibraryError
        The model was loaded without its structure.
    MissingSourceError
        The C text of DAQP is not to be found, for a distribution.
    CompilerMissingError, CompileError
        No C compiler was found, or it failed.

    Notes
    -----
    The controller is that of `build_controller`. The model is integrated as by `simulate_control` (rk853,
    relative tolerance 1e-9), by the same library, and noise follows from the seed in the same order: with
    ``gains.at_knots(knots)`` both give the same numbers up to rounding. A measured length of 0 or less has
    the status ``"invalid_length"`` here, and the last command is kept.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tensegrity_codegen import Disturbance, compile_scene, design_lqr, find_equilibrium
    >>> from tensegrity_codegen import simulate_control_batch
    >>> winch = '[[actuators]]\\nname = "winch"\\nmembers = "cord"\\n'
    >>> _ = Path("lift.toml").write_text('axes = "z"\\n' + Path("two_nodes.toml").read_text() + winch)
    >>> model = compile_scene("lift.toml", for_=("equilibrium", "control"))
    >>> found = find_equilibrium(model)
    >>> gains = design_lqr(model, found, [100.0, 1.0], [1.0], sample=0.02)
    >>> draws = [Disturbance(coordinate_error=[error]) for error in (-0.01, 0.01)]
    >>> runs = simulate_control_batch(model, found, gains, draws=draws, t_end=1.0)
    >>> [run.status for run in runs], max(run.worst_error(last=0.2) for run in runs) < 1e-4
    (['ok', 'ok'], True)
    """
    require_model(model)
    require_double(model.manifest, "a simulated closed loop")
    require_quantities(model, ("member_tension",), "a simulated closed loop needs")
    check_switch(compare, "compare")
    check_instance(draws, Sequence, "draws", "a list of Disturbance")
    written = replace(read_code(code), name=SIMULATED_LOOP_NAME, precision="double")
    held = 1.0 if t_end is None else check_positive(t_end, "t_end", "[s]")
    workers = (os.cpu_count() or 1) if threads is None else check_whole(threads, "threads", 1)
    # The controller, with the checks of all controllers.
    described, request = find_model_and_request(model, motion)
    reference = motion if isinstance(motion, Motion) else build_rest(model, motion, held)
    parts = collect_parts(
        described, reference, gains=gains, estimator=estimator, distribution=distribution, sample=sample,
        limits=limits, code=written,
    )  # fmt: skip
    # The draws, all of them checked before the first one is simulated.
    count = count_samples(reference.duration if t_end is None else t_end, parts.sample)
    for k, draw in enumerate(draws):
        check_instance(draw, Disturbance, f"draws[{k}]", "a Disturbance")
    ready = [read_disturbance(model, parts.motion, draw, f"draws[{k}]") for k, draw in enumerate(draws)]
    if not ready:
        return ()
    # Controller and plant in one library; the draws in several threads.
    loop = CompiledLoop(model, parts, write_files(parts, request, find_precision("double")), written.compiler)
    with ThreadPoolExecutor(workers) as pool:
        runs = list(pool.map(lambda draw: loop.run(draw, count), ready))
    late = describe_unknown_delays(None if isinstance(gains, Mpc) else gains, parts.bounds)
    runs = [replace(run, warnings=((late,) if late else ()) + run.warnings) for run in runs]
    # The open loop of a motion that is too fast for its actuators is no comparison.
    lags = bool((reference.peak_rate > parts.bounds.rate).any())
    if gains is None or not compare or lags:
        return tuple(runs)
    open_loop = partial(
        simulate_control, model, reference, t_end=count * parts.sample, sample=parts.sample, limits=limits
    )
    return tuple(
        compare_with_open_loop(model, reference, run, partial(open_loop, disturbance=draw))
        for run, draw in zip(runs, draws, strict=True)
    )
