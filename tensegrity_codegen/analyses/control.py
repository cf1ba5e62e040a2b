"""The operation `control`: the closed loop of every case, with the controller of the unchanged scene."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.analyses.cases.nominal_controller import CaseLoop, NominalController
from tensegrity_codegen.analyses.cases.quantities import CaseArguments, Outcomes
from tensegrity_codegen.analyses.cases.record import CaseAnalysis, Option, Output
from tensegrity_codegen.analyses.cases.scene_case import SceneCase
from tensegrity_codegen.analyses.plans.held_motion import FeedbackDesign, FeedbackOptions, HeldMotion
from tensegrity_codegen.control.embedded.parts import (
    SIMULATED_LOOP_NAME,
    ControllerCode,
    collect_parts,
    find_model_and_request,
)
from tensegrity_codegen.control.embedded.write import write_files
from tensegrity_codegen.control.feedback.loop.sampled_plant import count_samples
from tensegrity_codegen.control.feedback.mpc import HORIZON
from tensegrity_codegen.control.feedback.study.control_study import (
    RunMeasures,
    find_time_constants,
    measure_run,
)
from tensegrity_codegen.control.feedback.study.stated_errors import (
    Draws,
    StatedErrors,
    check_errors,
    draw_all_errors,
    find_default_times,
    read_draws,
    read_start_errors,
    read_times,
)
from tensegrity_codegen.pipeline.analyses import Needs, find_needs
from tensegrity_codegen.pipeline.build_library import MANY_CALLS
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.model.arguments import INPUT
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    NonFiniteError,
    check_choice,
)
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.precision import find_precision
from tensegrity_codegen.tables.request import ModelRequest

# Results of the worst draw of each case: type, unit, sentence.
RESULTS = {
    "end_error": ("float64", "m", "Largest distance of a node from the motion at the end."),
    "peak_error": ("float64", "m", "Largest distance of a node from the motion at any time."),
    "least_tension": ("float64", "N", "Least tension of a cable at any time."),
    "end_tension": ("float64", "N", "Least tension of a cable at the end."),
    "worst_node": ("int64", "1", "Place of the node with the largest error at the end, from 0 on."),
    "end_angle": ("float64", "rad", "Largest error of an angle at the end; NAN without angles."),
    "end_rms": ("float64", "m", "Largest root mean square of a node's distance from the motion at the end."),
    "cut": ("float64", "1", "Part of the commands that were cut, or whose measurements were not used."),
}
DEFAULT_RESULTS = ("end_error", "peak_error", "least_tension", "end_tension", "worst_node")


@dataclass(frozen=True)
class SweptControl(CaseAnalysis):
    """Closed loops of many cases under the controller of the unchanged scene.

    It is no `SceneAnalysis`: the verb `control` designs the controller for the scene of the case itself.

    keep: names of RESULTS; by default DEFAULT_RESULTS.
    to, plan, duration, sample_time, effort, least_tension, mpc, horizon, disturbance, only_observable, t_end,
        last, start_error, draws: as of the verb `control`, with `sample_time` for `sample`; several targets
        of `to` are joined by semicolons.
    draw_seed: seed of start errors and noise.
    design: of the unchanged scene; `prepared` makes it.
    """

    name: ClassVar[str] = "control"
    success_phrase: ClassVar[str] = "ran to their end"
    needs_scene: ClassVar[bool] = True

    to: Annotated[str | None, Option("TARGET=VALUE of a plan; several joined by semicolons.")] = None
    plan: Annotated[str | None, Option("result file of the verb plan, in place of --to.")] = None
    duration: Annotated[float | None, Option("time of the motion [s].")] = None
    sample_time: Annotated[float, Option("time between two commands [s].")] = 0.005
    effort: Annotated[float | None, Option("change of a rest length that is accepted [m].")] = None
    least_tension: Annotated[
        str | None, Option("least tension of the controller [N], or scene: the limits of the scene.")
    ] = None
    mpc: Annotated[bool, Option("model-predictive control in place of gains.", ("mpc", True))] = False
    horizon: Annotated[int, Option("commands that --mpc plans ahead.")] = HORIZON
    disturbance: Annotated[
        float | None,
        Option("how fast the estimator lets disturbance forces change [N or N m in 1 s]; 0: none."),
    ] = None
    only_observable: Annotated[
        bool,
        Option("estimate disturbance forces only where sensors tell them apart.", ("only_observable", True)),
    ] = False
    t_end: Annotated[float | None, Option("simulated time [s].")] = None
    last: Annotated[float | None, Option("time before the end in which errors count [s].")] = None
    start_error: Annotated[
        float | str | None,
        Option("by how much coordinates are off at the start: 3mm, or an angle."),
    ] = None
    draws: Annotated[int, Option("number of draws of start errors and noise for each case.")] = 1
    draw_seed: Annotated[int, Option("seed of start errors and noise.")] = 0
    design: NominalController | None = None

    def __post_init__(self) -> None:
        if isinstance(self.start_error, str):  # in m, as a number means it, or an angle
            length, _ = read_start_errors((self.start_error,))
            object.__setattr__(self, "start_error", self.start_error if length is None else length)

    def describe(self) -> dict[str, Any]:
        """Return name and options, with the hash of the plan's file."""
        description = super().describe()
        if self.plan is not None and Path(self.plan).is_file():
            description["plan_sha256"] = hashlib.sha256(Path(self.plan).read_bytes()).hexdigest()
        return description

    def prepared(self, scene: str | Path | Mapping[str, Any] | Scene) -> "SweptControl":
        """Return the operation with the controller of the unchanged scene; raises what the design raises."""
        held, options = self._held_motion, self._feedback
        held.check(self.sample_time, self.t_end, self.last)
        options.check()
        # The motion of the unchanged scene, and feedback about it.
        case = SceneCase(*load_scene(scene))
        request = held.request_model(case)
        model = case.build_library(case.subject, request, MANY_CALLS).load()
        motion = held.find(case, model, self.t_end)
        built = FeedbackDesign(model, motion, options, {}).build()
        estimator, tuning = built["estimator"], built["tuning"]
        described, alone = find_model_and_request(model, motion)
        controller = collect_parts(
            described, motion, gains=built["gains"], estimator=estimator,
            distribution=built["distribution"],
            sample=self.sample_time, limits=None, code=ControllerCode(name=SIMULATED_LOOP_NAME),
        )  # fmt: skip
        # The disturbances of all cases, and the simulated time.
        draws = read_draws(Draws(self.draws, self.draw_seed))
        error = self.start_error
        length, angle = read_start_errors((error,)) if isinstance(error, str) else (error, None)
        stated = StatedErrors(length, angle, stiffness_error=0.0)
        check_errors(model, stated)
        drawn = draw_all_errors(model, motion, stated, tuning.scales, draws)
        default = find_default_times(motion, *find_time_constants(built["stored_gains"], estimator))[0]
        end, error_window = read_times(self.sample_time, default, self.t_end, self.last)
        count_samples(end, self.sample_time)
        design = NominalController(
            model,
            request,
            controller,
            write_files(controller, alone, find_precision("double")),
            drawn,
            end,
            error_window,
        )
        return replace(self, design=design)

    @property
    def _held_motion(self) -> HeldMotion:
        targets = tuple(target.strip() for target in (self.to or "").split(";") if target.strip())
        if self.to is not None and not targets:
            raise InvalidValueError(
                "no target",
                where="to",
                given=self.to,
                allowed="targets such as tilt=10, joined by semicolons",
            )
        return HeldMotion(targets, self.plan, duration=self.duration)

    @property
    def _feedback(self) -> FeedbackOptions:
        return FeedbackOptions(
            sample=self.sample_time,
            effort=self.effort,
            least_tension=self.least_tension,
            mpc=self.mpc,
            horizon=self.horizon,
            disturbance=self.disturbance,
            only_observable=self.only_observable,
        )

    def needs(self, structure: Subject, request: ModelRequest) -> Needs:
        """Return the needs of a simulated loop; parameters are those that the keys need."""
        for name in self.keep:
            check_choice(name, RESULTS, f"result of {self.name}", f"keep {name!r}")
        if len(set(self.keep)) < len(self.keep):
            raise DuplicateNameError("kept twice", where="keep", given=", ".join(self.keep))
        return replace(find_needs("control", structure, request), parameters={})

    def outputs(self, manifest: Manifest) -> tuple[Output, ...]:
        """Return descriptions of the results, one number of each case."""
        return tuple(Output(name, (), (), *RESULTS[name]) for name in self.keep or DEFAULT_RESULTS)

    def compute(
        self, model: CompiledModel, case_arguments: CaseArguments, outcomes: Outcomes, threads: int
    ) -> Mapping[str, NDArray[Any]]:
        """Simulate the loop of each case; the message names the worst node."""
        assert self.design is not None  # prepare_sweep calls `prepared`
        if INPUT in case_arguments.all:
            raise InvalidValueError(
                "inputs are those of the motion in a closed loop", where="over", given="a key of an input",
                allowed="numbers of the scene or of its structure",
            )  # fmt: skip
        plant = CaseLoop(model, self.design)
        arrays = {
            output.name: output.full_of_nan(case_arguments.count) for output in self.outputs(model.manifest)
        }
        for k in np.flatnonzero(outcomes.is_ok).tolist():
            arguments = case_arguments.select_case(k)
            loops = {name: rows[k] for name, rows in case_arguments.loops.items()}
            try:
                runs = [plant.run(arguments, loops, draw, self.draw_seed) for draw in range(self.draws)]
            except (InvalidValueError, NonFiniteError) as error:
                outcomes.mark(k, "bad_input", str(error))
                continue
            lost = next((run for run in runs if run.status != "ok"), None)
            if lost is not None:
                outcomes.mark(k, lost.status, lost.message)
                continue
            rows = [measure_run(model, run, self.design.error_window) for run in runs]
            worst = max(rows, key=lambda row: row.end_error)
            outcomes.mark(k, "ok", f"{1000 * worst.end_error:.3g} mm at {worst.end_node} at the end")
            results = _describe(model, rows, worst)
            for name, array in arrays.items():
                array[k] = results[name]
        return arrays


def _describe(model: CompiledModel, rows: Sequence[RunMeasures], worst: RunMeasures) -> dict[str, float]:
    """Return the results of a case from those of its draws."""
    cut = [1.0 - row.steps.get("ok", 0) / max(sum(row.steps.values()), 1) for row in rows]
    return {
        "end_error": worst.end_error,
        "peak_error": max(row.peak_error for row in rows),
        "least_tension": min(row.least_tension for row in rows),
        "end_tension": min(row.end_tension for row in rows),
        "worst_node": model.manifest.node_name.index(worst.end_node),
        "end_angle": max(row.end_angle for row in rows),
        "end_rms": max(max(row.end_rms.values()) for row in rows),
        "cut": max(cut),
    }


ANALYSIS = SweptControl
