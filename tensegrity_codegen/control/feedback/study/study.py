"""The study of a controller: open loop, true state, estimator, over many draws of disturbances."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.control.feedback.closed_loop import simulate_control
from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
from tensegrity_codegen.control.feedback.design.linear_samples import find_reference
from tensegrity_codegen.control.feedback.loop.actuator_bounds import find_bounds
from tensegrity_codegen.control.feedback.loop.control_run import ControlRun
from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance
from tensegrity_codegen.control.feedback.loop.tension_distribution import TensionDistribution
from tensegrity_codegen.control.feedback.lqr import design_lqr
from tensegrity_codegen.control.feedback.mpc import Mpc
from tensegrity_codegen.control.feedback.study.control_study import (
    LOOPS,
    OPEN,
    ControlStudy,
    LoopResult,
    RunMeasures,
    find_margin_warnings,
    find_time_constants,
    judge_study,
    measure_run,
)
from tensegrity_codegen.control.feedback.study.linear_loop import (
    build_linear_loop,
    design_slow_estimator,
    find_margins,
    predict_errors,
)
from tensegrity_codegen.control.feedback.study.stated_errors import (
    DrawnErrors,
    Draws,
    StatedErrors,
    check_errors,
    check_gust_times,
    check_times,
    draw_all_errors,
    find_default_times,
    read_draws,
    read_times,
)
from tensegrity_codegen.control.feedback.study.tuning import HELD_TIME, Tuning, choose_weights
from tensegrity_codegen.runtime.model.arguments import merge_inputs
from tensegrity_codegen.runtime.model.interface import require_model
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.system.checks import check_callback, check_instance, check_positive, with_moved
from tensegrity_codegen.system.errors import InvalidValueError, check_choice

SENSORS = "sensors"
CHUNK = 32  # draws that are simulated at once


@with_moved(**{name: f"draws=Draws({name}=...)" for name in ("seed", "last", "batch")})
def study_control(
    model: CompiledModel,
    motion: Motion | Equilibrium,
    *,
    tuning: Tuning | None = None,
    gains: Gains | Mpc | None = None,
    estimator: Estimator | str | None = SENSORS,
    distribution: TensionDistribution | None = None,
    errors: StatedErrors | None = None,
    sample: float = 0.005,
    t_end: float | None = None,
    draws: int | Draws = 5,
    arguments: Mapping[str, Any] | None = None,
    progress: Callable[[float], None] | None = None,
) -> ControlStudy:
    """Simulate a motion under disturbances: without feedback, with the true state, with an estimator.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"control"``, see compile_scene.
    motion : Motion or Equilibrium
        The motion, or the equilibrium to hold for 2 s.
    tuning : Tuning, optional
        Weights of the gains; by default those of `choose_weights`.
    gains : Gains or Mpc, optional
        Feedback; by default of `design_lqr` with the weights. An Mpc is simulated in C, by
        ``draws=Draws(batch=simulate_control_batch)``; gains of its weights stand for its linear loop.
    estimator : Estimator, "sensors" or None
        ``"sensors"``: of `design_kalman` for the sensors of the scene, none without sensors; its disturbance
        forces are smaller where noise then disturbs the loop less. None: no loop with an estimator.
    distribution : TensionDistribution, optional
        Keeps tensions above the least ones, in the loops with feedback.
    errors : StatedErrors, optional
        Disturbances; by default every coordinate off at the start and stiffnesses off by 5 %.
    sample : float [s]
        Time between two commands, if no gains are given.
    t_end : float, optional [s]
        Simulated time; by default three times the motion, longer where the slowest error needs it.
    draws : int or Draws
        Number of draws of the disturbances; a `Draws` also with their seed, the time in which errors are
        compared, and many at once in C.
    arguments : mapping, optional
        Inputs and run-time parameters if they differ from the scene, known to the controller.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    ControlStudy
        Status, errors, tensions and limits of every loop and draw, and the runs of the worst draw.

    Raises
    ------
    InvalidValueError, NonFiniteError, UnknownNameError
        A value out of range, an unknown node, a motion that an actuator is too slow for.
    FormulationError
        Coordinates depend on each other, the actuators cannot stabilise the motion, or the sensors do not
        show the state.

    Notes
    -----
    docs/control.md has the statuses, docs/margins.md the equations.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tensegrity_codegen import compile_scene, find_equilibrium, study_control
    >>> winch = '[[actuators]]\\nname = "winch"\\nmembers = "cord"\\n'
    >>> _ = Path("lift.toml").write_text('axes = "z"\\n' + Path("two_nodes.toml").read_text() + winch)
    >>> model = compile_scene("lift.toml", for_=("equilibrium", "control"))
    >>> study = study_control(model, find_equilibrium(model), sample=0.02, draws=2)
    >>> study.status, list(study.loops)
    ('holds', ['open', 'true_state'])
    """
    require_model(model)
    requested = read_draws(draws)
    check_times(t_end=t_end, last=requested.last)
    check_positive(sample, "sample", "[s]")
    check_instance(tuning, (Tuning, type(None)), "tuning", "a Tuning of choose_weights, or None")
    check_instance(errors, (StatedErrors, type(None)), "errors", "StatedErrors, or None")
    check_instance(gains, (Gains, Mpc, type(None)), "gains", "Gains of design_lqr, an Mpc, or None")
    mpc, gains = (gains, None) if isinstance(gains, Mpc) else (None, gains)
    if mpc is not None and requested.batch is None:
        raise InvalidValueError(
            "model-predictive control runs in C only", where="draws.batch", given="None",
            allowed="Draws(..., batch=simulate_control_batch)",
        )  # fmt: skip
    check_callback(progress, "progress")
    held = HELD_TIME if t_end is None else t_end
    reference = find_reference(model, motion, held, arguments)
    parameters = merge_inputs(model.manifest, arguments)
    chosen = tuning or choose_weights(model, reference, sample=sample, arguments=arguments)
    stated = errors or StatedErrors()
    check_errors(model, stated)
    if gains is None:
        source = chosen if mpc is None else mpc
        of = chosen if mpc is None else mpc.gains
        gains = design_lqr(
            model, reference, source.Q, source.R, sample=of.sample, integral_action=of.integral_action,
            arguments=arguments,
        )  # fmt: skip
    senses, note = _find_estimator(model, reference, estimator, gains, chosen, arguments)
    default = find_default_times(reference, *find_time_constants(gains, senses))[0]
    end, window = read_times(gains.sample, default, t_end, requested.last)
    check_gust_times(stated.gusts, end)
    notes = () if note is None else (note,)
    work = _Work(
        model,
        reference,
        gains,
        mpc,
        senses,
        distribution,
        chosen,
        stated,
        parameters,
        end,
        window,
        requested,
        notes,
    )
    return work.study(progress)


@dataclass(frozen=True, eq=False)
class _Work:
    """All parts of a study."""

    model: CompiledModel
    motion: Motion
    gains: Gains
    mpc: Mpc | None
    estimator: Estimator | None
    distribution: TensionDistribution | None
    tuning: Tuning
    stated: StatedErrors
    given: Mapping[str, Any]
    t_end: float
    last: float
    draws: Draws
    notes: tuple[str, ...]

    def study(self, progress: Callable[[float], None] | None) -> ControlStudy:
        """Judge the linear loops, simulate all draws; of the worst one the runs are kept."""
        # The margins of the linear loops, and the errors that noise will cause in them.
        names = [name for name in LOOPS if name != LOOPS[2] or self.estimator is not None]
        structure, bounds = self.model.structure, find_bounds(self.model, self.motion)
        assert structure is not None  # find_bounds refuses models without
        linear = {
            name: build_linear_loop(
                self.model, self.motion, self.gains, bounds.delay,
                self.estimator if name == LOOPS[2] else None, self.given,
            )
            for name in names[1:]
        }  # fmt: skip
        margins = {name: find_margins(loop) for name, loop in linear.items()}
        if self.draws.warn is not None:
            for warning in find_margin_warnings(margins, bounds, self.gains.sample):
                self.draws.warn(warning)
        end = self.motion.coordinate[-1]
        predicted = {name: predict_errors(loop, self.model, end) for name, loop in linear.items()}
        # All loops over all draws, some of them at once; the runs of the worst draw are kept.
        rows: dict[str, list[RunMeasures]] = {name: [] for name in names}
        worst, worst_runs, number = -np.inf, {}, 0
        draws = self.draws.number
        drawn = draw_all_errors(self.model, self.motion, self.stated, self.tuning.scales, self.draws)
        size = 1 if self.draws.batch is None else CHUNK
        for start in range(0, draws, size):
            some = range(start, min(start + size, draws))
            runs = {}
            for k, name in enumerate(names):
                runs[name] = self.run(name, [drawn[draw] for draw in some], start)
                rows[name] += [measure_run(self.model, run, self.last) for run in runs[name]]
                if progress is not None:
                    progress((start + len(some) * (k + 1) / len(names)) / draws)
            for draw in some:
                # The error at the end, above all where a run stopped.
                row = rows[names[-1]][draw]
                rank = np.finfo(float).max if row.is_unstable else row.end_error
                if rank > worst:
                    worst, number = rank, draw
                    worst_runs = {name: runs[name][draw - start] for name in names}
        # The results of the loops.
        loops = {name: LoopResult(name, tuple(rows[name]), worst_runs[name]) for name in names}
        status, message = judge_study(loops, self.tuning.tolerance)
        return ControlStudy(
            status=status,
            message=message,
            motion=self.motion,
            tuning=self.tuning,
            gains=self.gains,
            mpc=self.mpc,
            estimator=self.estimator,
            distribution=self.distribution,
            errors=self.stated,
            bounds=bounds,
            drawn=drawn,
            loops=loops,
            margins=margins,
            predicted=predicted,
            limits=structure.limits,
            notes=self.notes,
            worst_draw=number,
            t_end=self.t_end,
            last=self.last,
            seed=self.draws.seed,
        )

    def run(self, name: str, drawn: Sequence[DrawnErrors], start: int) -> Sequence[ControlRun]:
        """Simulate one loop for some draws, the first of this number."""
        is_open = name == OPEN
        feedback = None if is_open else self.mpc or self.gains
        spread = None if is_open else self.distribution
        options: dict[str, Any] = {"t_end": self.t_end, "sample": self.gains.sample, "compare": False}
        options["estimator"] = self.estimator if name == LOOPS[2] else None
        states = [
            Disturbance(
                coordinate_error=errors.coordinate,
                arguments={**self.given, **errors.arguments},
                gust=errors.gusts or None,
                seed=int(np.random.SeedSequence([self.draws.seed, start + k]).generate_state(1)[0]),
            )
            for k, errors in enumerate(drawn)
        ]
        if self.draws.batch is not None and spread is None:
            return self.draws.batch(self.model, self.motion, feedback, draws=states, **options)
        gains = feedback if isinstance(feedback, Gains) else None
        return [
            simulate_control(
                self.model, self.motion, gains, distribution=spread, disturbance=state, **options
            )
            for state in states
        ]


def _find_estimator(
    model: CompiledModel,
    motion: Motion,
    estimator: Estimator | str | None,
    gains: Gains,
    tuning: Tuning,
    arguments: Mapping[str, Any] | None,
) -> tuple[Estimator | None, str | None]:
    """Return the estimator, and a warning of its design."""
    if not isinstance(estimator, str):
        check_instance(estimator, (Estimator, type(None)), "estimator", 'an Estimator, "sensors" or None')
        return estimator, None
    check_choice(estimator, (SENSORS,), "estimator", "estimator")
    if model.structure is None or not model.structure.sensors:
        return None, None
    return design_slow_estimator(model, motion, gains, tuning.scales, arguments=arguments)
