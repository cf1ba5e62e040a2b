"""The operation `simulate`: a motion of every case, several in the lanes of a core; what is kept of it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.analyses.cases.keep_text import EVERY, FIRST, KeptText, parse_kept
from tensegrity_codegen.analyses.cases.kept import Kept, bind_kept, find_kept_quantities
from tensegrity_codegen.analyses.cases.quantities import (
    CaseArguments,
    Outcomes,
    compute_limit_use,
    compute_rows,
)
from tensegrity_codegen.analyses.cases.record import (
    LIMIT_USE,
    LIMIT_USE_RESULT,
    CaseAnalysis,
    Option,
    Output,
)
from tensegrity_codegen.pipeline.analyses import BATCH_METHOD, Needs, find_needs
from tensegrity_codegen.runtime.integrate.options import Stepping, check_options, complete_run_options
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.require import require_double
from tensegrity_codegen.runtime.simulate.condition_text import POSITION
from tensegrity_codegen.runtime.simulate.simulate_batch import simulate_batch
from tensegrity_codegen.runtime.trajectory.batch_trajectory import BatchTrajectory
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.tables.manifest import FunctionSpec, Manifest
from tensegrity_codegen.tables.quantities import QUANTITIES
from tensegrity_codegen.tables.request import ModelRequest

DEFAULT_RESULTS = (
    "node_position.final",
    "member_tension.max",
    "member_tension.min",
    "energy_drift",
    LIMIT_USE,
)
MOST_BYTES = 2**26  # of the samples of a block of motions
VELOCITY = "node_velocity"
# Quantities that every motion has at its samples.
SAMPLED = ("member_tension", "kinetic_energy", "total_energy")
# Results of each motion besides its samples: type, unit, sentence.
RESULTS = {
    "energy_drift": (
        "float64",
        "1",
        "Largest change of total energy over the largest kinetic energy; NAN if driven.",
    ),
    "error_estimate": (
        "float64",
        "1",
        "Estimated error over the tolerance; NAN where the method makes none.",
    ),
    "n_steps": ("int64", "1", "Number of steps."),
    LIMIT_USE: LIMIT_USE_RESULT,
}
RealArray = NDArray[Any]
WORDS = {
    "final": "at the end",
    "max": "largest over the samples",
    "min": "smallest over the samples",
    "mean": "mean over time",
    "rms": "root of the mean square over time",
}


@dataclass(frozen=True)
class Simulate(CaseAnalysis):
    """Motions from time 0 on.

    keep: expressions with a reduction over time (sweep/tasks/keep_text.py), names of RESULTS; by default
        DEFAULT_RESULTS.
    t_end: end time [s].
    samples: number of equally spaced sample times.
    method, step, rtol, atol, max_steps, control: as of `simulate_batch`.
    """

    name: ClassVar[str] = "simulate"
    success_phrase: ClassVar[str] = "ran to their end"

    t_end: Annotated[float, Option("simulated time [s].")] = 1.0
    samples: Annotated[int, Option("number of equally spaced samples.")] = 101
    method: Annotated[str, Option("method, as in the verb of this name.")] = BATCH_METHOD
    step: Annotated[float | None, Option("step of fixed-step methods [s].")] = None
    rtol: Annotated[float, Option("relative tolerance.")] = 1e-6
    atol: Annotated[float | None, Option("absolute tolerance, m and m/s.")] = None
    max_steps: Annotated[int | None, Option("most steps of a motion.")] = None
    control: Annotated[
        str | None,
        Option(
            "what the tolerance limits: steps, the default as for simulate --batch, or samples, "
            "as for one motion of simulate, which takes longer.",
            verb_default="steps",
        ),
    ] = None

    def needs(self, structure: Subject, request: ModelRequest) -> Needs:
        """Return what a batch of motions needs, and the quantities that are kept."""
        options = complete_run_options(
            self.method, self.rtol, self.atol, self.step, self.max_steps, "", self.control
        )
        check_options(options, self.t_end, self.samples)
        needs = find_needs("simulate_batch", structure, request, method=self.method, rtol=self.rtol)
        wanted = find_kept_quantities(self._of_samples(self._texts()), request)
        own = () if needs.quantities.count(VELOCITY) else (VELOCITY,)  # placed by coordinates
        added = tuple(name for name in wanted if name not in (*needs.quantities, *own))
        return replace(needs, quantities=(*needs.quantities, *added))

    def outputs(self, manifest: Manifest) -> tuple[Output, ...]:
        """Return one array for each thing that is kept."""
        bound = self._bind(manifest)
        time = np.linspace(0.0, self.t_end, self.samples)
        return tuple(
            reduce_output(text, bound[text.name].output, time)
            if text.name in bound
            else Output(text.name, (), (), *RESULTS[text.expression], expression=text.text_beside_name)
            for text in self._texts()
        )

    def _texts(self) -> tuple[KeptText, ...]:
        return parse_kept(self.keep or DEFAULT_RESULTS, tuple(RESULTS), over_time=True)

    @staticmethod
    def _of_samples(texts: tuple[KeptText, ...]) -> tuple[KeptText, ...]:
        return tuple(text for text in texts if text.expression not in RESULTS)

    def _bind(self, manifest: Manifest) -> dict[str, Kept]:
        kept = bind_kept(self._of_samples(self._texts()), _with_velocity(manifest))
        return {item.text.name: item for item in kept}

    def compute(
        self, model: CompiledModel, case_arguments: CaseArguments, outcomes: Outcomes, threads: int
    ) -> Mapping[str, NDArray[Any]]:
        """Integrate the motions, in blocks whose samples fit into little memory."""
        require_double(model.manifest, "an integration from Python")
        bound = self._bind(model.manifest)
        arrays = {item.name: item.full_of_nan(case_arguments.count) for item in self.outputs(model.manifest)}
        # How many motions are integrated at a time: a whole number of lanes.
        manifest = model.manifest
        nodes, members = len(manifest.node_name), len(manifest.member_name)
        numbers = 4 * len(manifest.coordinate_name) + 6 * nodes + members + 2
        numbers += sum(int(np.prod(item.output.shape)) for item in bound.values())
        width = max(manifest.batch_width, 1)
        size = width * max(1, MOST_BYTES // (8 * numbers * self.samples * width))
        for first in range(0, case_arguments.count, size):
            rows = slice(first, min(first + size, case_arguments.count))
            batch = self._integrate(model, case_arguments, rows, threads)
            self._keep(model, batch, case_arguments, rows, bound, arrays, threads)
            outcomes.mark_ok(batch.status, batch.message, first)
        return arrays

    def _integrate(
        self, model: CompiledModel, case_arguments: CaseArguments, rows: slice, threads: int
    ) -> BatchTrajectory:
        own = {name: array[rows] for name, array in case_arguments.rows.items()}
        start = {
            name: case_arguments.shared[name]
            for name in ("coordinate", "velocity")
            if name in case_arguments.shared
        }
        start |= {name: own.pop(name) for name in ("coordinate", "velocity") if name in own}
        if not (own or any(name in case_arguments.rows for name in start)):  # all motions are the same
            start["coordinate"] = np.tile(
                start.get("coordinate", model.nominal("coordinate")), (rows.stop - rows.start, 1)
            )
        shared = {name: array for name, array in case_arguments.shared.items() if name not in start}
        return simulate_batch(
            model,
            self.t_end,
            samples=self.samples,
            method=self.method,
            rtol=self.rtol,
            stepping=Stepping(self.step, self.atol, self.max_steps, control=self.control),
            coordinate=start.get("coordinate"),
            velocity=start.get("velocity"),
            arguments={**shared, **own},
            threads=threads,
        )

    def _keep(
        self,
        model: CompiledModel,
        batch: BatchTrajectory,
        case_arguments: CaseArguments,
        rows: slice,
        bound: Mapping[str, Kept],
        arrays: Mapping[str, NDArray[Any]],
        threads: int,
    ) -> None:
        """Write what is kept of a block of motions into its rows of the arrays."""
        names = dict.fromkeys(name for item in bound.values() for name in item.names)
        values = _sample(model, batch, case_arguments, rows, tuple(names), threads)
        shape = (len(batch), len(batch.time))
        values["time"] = np.broadcast_to(batch.time, shape)
        for text in self._texts():
            if text.name in bound:
                found = bound[text.name].evaluate(values, shape)
                arrays[text.name][rows] = reduce_values(text, found, batch.time)
            elif text.expression == LIMIT_USE:
                length = model.manifest.strands.lengths(batch.node_position)
                arrays[text.name][rows] = compute_limit_use(
                    model, case_arguments, rows, batch.member_tension, length
                )
            else:
                arrays[text.name][rows] = getattr(batch, text.expression)


def _sample(
    model: CompiledModel,
    batch: BatchTrajectory,
    case_arguments: CaseArguments,
    rows: slice,
    names: tuple[str, ...],
    threads: int,
) -> dict[str, NDArray[Any]]:
    """Return quantities at all samples of a block of motions, (count, n_t, ...)."""
    shape = (len(batch), len(batch.time))
    values: dict[str, NDArray[Any]] = {}
    others = [name for name in names if name not in (POSITION, VELOCITY, *SAMPLED)]
    states: dict[str, NDArray[Any]] = {}
    if others:
        states = {
            name: np.repeat(array[rows], shape[1], axis=0) for name, array in case_arguments.rows.items()
        }
        for name in ("coordinate", "velocity"):
            states[name] = np.ascontiguousarray(getattr(batch, name).reshape(shape[0] * shape[1], -1))
    for name in names:
        if name == VELOCITY:
            values[name] = batch.node_velocity[..., list(model.manifest.axes)]
        elif name in (POSITION, *SAMPLED):
            values[name] = getattr(batch, name)
        else:
            given = replace(case_arguments, count=shape[0] * shape[1], rows=states)
            found, _ = compute_rows(model, name, given, threads)
            values[name] = found.reshape(*shape, *found.shape[1:])
    return values


def _with_velocity(manifest: Manifest) -> Manifest:
    """Return the manifest with the velocities of nodes among its functions, which every motion has."""
    if any(spec.quantity == VELOCITY for spec in manifest.functions):
        return manifest
    row = QUANTITIES[VELOCITY]
    shape = (len(manifest.node_name), len(manifest.axes))
    spec = FunctionSpec(VELOCITY, "", ("velocity",), shape, row.unit, row.sentence, 0)
    return replace(manifest, functions=(*manifest.functions, spec))


def reduce_output(text: KeptText, output: Output, time: RealArray) -> Output:
    """Return the array of a motion from that of one sample; time: of the samples, (n_t,) [s]."""
    if text.reduction == FIRST:
        sentence = (
            f"First time at which {text.expression} holds, between samples on a straight line; NAN if never."
        )
        return replace(output, unit="s", sentence=sentence)
    if text.reduction in WORDS:
        return replace(output, sentence=f"{output.sentence.rstrip('.')}: {WORDS[text.reduction]}.")
    kept = time[:: text.step]
    dim = "time" if text.step == 1 else f"time_{EVERY}_{text.step}"
    return replace(
        output,
        dims=(dim, *output.dims),
        shape=(len(kept), *output.shape),
        coordinates={**output.coordinates, dim: tuple(kept.tolist())},
    )


def reduce_values(text: KeptText, values: RealArray, time: RealArray) -> RealArray:
    """Return what is kept of values (count, n_t, ...) at times (n_t,) [s]."""
    if text.reduction == FIRST:
        return find_first_time(values, time)
    if text.reduction == "final":
        return values[:, -1]
    if text.reduction == "max":
        return np.asarray(values.max(axis=1))
    if text.reduction == "min":
        return np.asarray(values.min(axis=1))
    if text.reduction in ("mean", "rms"):
        # Weights (n_t,) of the trapezoidal rule that add up to 1.
        part = np.zeros(len(time))
        part[1:] += np.diff(time) / 2
        part[:-1] += np.diff(time) / 2
        weight = np.asarray(part / part.sum()).reshape(-1, *(1,) * (values.ndim - 2))
        if text.reduction == "mean":
            return np.asarray((weight * values).sum(axis=1))
        return np.asarray(np.sqrt((weight * values**2).sum(axis=1)))
    return values[:, :: text.step]


def find_first_time(values: RealArray, time: RealArray) -> RealArray:
    """Return the first time at which values (count, n_t, ...) are positive, (count, ...) [s], NAN if never.

    Between the sample before and the one at which they are, they are taken as a straight line.
    """
    holds = values > 0
    k = holds.argmax(axis=1)
    before = np.maximum(k - 1, 0)
    low, high = (np.take_along_axis(values, place[:, None], axis=1)[:, 0] for place in (before, k))
    with np.errstate(all="ignore"):
        part = np.where(k > 0, -low / (high - low), 0.0)
    first: RealArray = time[before] + part * (time[k] - time[before])
    return np.asarray(np.where(holds.any(axis=1), first, np.nan))


ANALYSIS = Simulate
