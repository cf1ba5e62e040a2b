"""The motions of many cases, several in the lanes of a core, and the results that a sweep stores."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.analyses.cases.keep_text import EVERY, FIRST, KeptText, parse_kept
from tensegrity_codegen.analyses.cases.kept import Kept, bind_kept
from tensegrity_codegen.analyses.cases.quantities import (
    CaseArguments,
    Outcomes,
    compute_limit_use,
    compute_rows,
)
from tensegrity_codegen.analyses.cases.record import LIMIT_USE, LIMIT_USE_RESULT, Output
from tensegrity_codegen.analyses.motions.motion_options import MotionAnalysis
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.interface import require_double
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.condition_text import POSITION
from tensegrity_codegen.runtime.simulate.simulate_batch import simulate_batch
from tensegrity_codegen.runtime.trajectory.trajectory import BatchTrajectory
from tensegrity_codegen.tables.manifest import FunctionSpec, Manifest
from tensegrity_codegen.tables.quantities import QUANTITIES

RealArray = NDArray[Any]
# The sentence about a reduction.
SENTENCES = {
    "final": "at the end",
    "max": "largest over the samples",
    "min": "smallest over the samples",
    "mean": "mean over time",
    "rms": "root of the mean square over time",
}
DEFAULT_RESULTS = (
    "node_position.final",
    "member_tension.max",
    "member_tension.min",
    "energy_drift",
    LIMIT_USE,
)
MAX_BYTES = 2**26  # of the samples of a block of motions
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


def list_texts(keep: tuple[str, ...]) -> tuple[KeptText, ...]:
    """Return the parsed texts of `keep`, by default DEFAULT_RESULTS."""
    return parse_kept(keep or DEFAULT_RESULTS, tuple(RESULTS), over_time=True)


def select_sampled(texts: tuple[KeptText, ...]) -> tuple[KeptText, ...]:
    """Return the texts that are computed from samples."""
    return tuple(kept_text for kept_text in texts if kept_text.expression not in RESULTS)


def list_outputs(analysis: MotionAnalysis, manifest: Manifest) -> tuple[Output, ...]:
    """Return descriptions of the stored arrays."""
    bound = _bind(analysis, manifest)
    time = np.linspace(0.0, analysis.t_end, analysis.samples)
    return tuple(
        reduce_output(kept_text, bound[kept_text.name].output, time)
        if kept_text.name in bound
        else Output(
            kept_text.name, (), (), *RESULTS[kept_text.expression], expression=kept_text.text_beside_name
        )
        for kept_text in list_texts(analysis.keep)
    )


def compute_motions(
    analysis: MotionAnalysis,
    model: CompiledModel,
    case_arguments: CaseArguments,
    outcomes: Outcomes,
    threads: int,
) -> Mapping[str, NDArray[Any]]:
    """Return the results of the motions, integrated in blocks whose samples fit into little memory."""
    manifest = model.manifest
    require_double(manifest, "an integration from Python")
    bound = _bind(analysis, manifest)
    outputs = list_outputs(analysis, manifest)
    arrays = {output.name: output.full_of_nan(case_arguments.count) for output in outputs}
    # How many motions are integrated at a time: a whole number of lanes.
    nodes, members = len(manifest.node_name), len(manifest.member_name)
    numbers = 4 * len(manifest.coordinate_name) + 6 * nodes + members + 2
    numbers += sum(int(np.prod(kept_result.output.shape)) for kept_result in bound.values())
    width = max(manifest.batch_width, 1)
    size = width * max(1, MAX_BYTES // (8 * numbers * analysis.samples * width))
    for start in range(0, case_arguments.count, size):
        rows = slice(start, min(start + size, case_arguments.count))
        batch = _integrate(analysis, model, case_arguments, rows, threads)
        _keep(analysis, model, batch, case_arguments, rows, bound, arrays, threads)
        outcomes.mark_ok(batch.status, batch.message, start)
    return arrays


def _bind(analysis: MotionAnalysis, manifest: Manifest) -> dict[str, Kept]:
    kept_results = bind_kept(select_sampled(list_texts(analysis.keep)), _with_velocity(manifest))
    return {kept_result.kept_text.name: kept_result for kept_result in kept_results}


def _integrate(
    analysis: MotionAnalysis, model: CompiledModel, case_arguments: CaseArguments, rows: slice, threads: int
) -> BatchTrajectory:
    """Return the motions of a block of cases."""
    states = ("coordinate", "velocity")
    arguments = {name: array[rows] for name, array in case_arguments.rows.items()}
    start = {name: case_arguments.shared[name] for name in states if name in case_arguments.shared}
    start |= {name: arguments.pop(name) for name in states if name in arguments}
    if not (arguments or any(name in case_arguments.rows for name in start)):  # all motions are the same
        count = rows.stop - rows.start
        start["coordinate"] = np.tile(start.get("coordinate", model.nominal("coordinate")), (count, 1))
    shared = {name: array for name, array in case_arguments.shared.items() if name not in start}
    return simulate_batch(
        model,
        analysis.t_end,
        samples=analysis.samples,
        method=analysis.method,
        rtol=analysis.rtol,
        stepping=Stepping(analysis.step, analysis.atol, analysis.max_steps, control=analysis.control),
        coordinate=start.get("coordinate"),
        velocity=start.get("velocity"),
        arguments={**shared, **arguments},
        threads=threads,
    )


def _keep(
    analysis: MotionAnalysis,
    model: CompiledModel,
    batch: BatchTrajectory,
    case_arguments: CaseArguments,
    rows: slice,
    bound: Mapping[str, Kept],
    arrays: Mapping[str, NDArray[Any]],
    threads: int,
) -> None:
    """Write the results of a block of motions into its rows of the arrays."""
    names = dict.fromkeys(name for kept_result in bound.values() for name in kept_result.names)
    values = _sample(model, batch, case_arguments, rows, tuple(names), threads)
    shape = (len(batch), len(batch.time))
    values["time"] = np.broadcast_to(batch.time, shape)
    for kept_text in list_texts(analysis.keep):
        if kept_text.name in bound:
            samples = bound[kept_text.name].evaluate(values, shape)
            arrays[kept_text.name][rows] = reduce_values(kept_text, samples, batch.time)
        elif kept_text.expression == LIMIT_USE:
            length = model.manifest.strands.lengths(batch.node_position)
            arrays[kept_text.name][rows] = compute_limit_use(
                model, case_arguments, rows, batch.member_tension, length
            )
        else:
            arrays[kept_text.name][rows] = getattr(batch, kept_text.expression)


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
    computed_names = [name for name in names if name not in (POSITION, VELOCITY, *SAMPLED)]
    states: dict[str, NDArray[Any]] = {}
    if computed_names:
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
            sample_arguments = replace(case_arguments, count=shape[0] * shape[1], rows=states)
            computed, _ = compute_rows(model, name, sample_arguments, threads)
            values[name] = computed.reshape(*shape, *computed.shape[1:])
    return values


def _with_velocity(manifest: Manifest) -> Manifest:
    """Return the manifest with the velocities of nodes among its functions, which every motion has."""
    if any(spec.quantity == VELOCITY for spec in manifest.functions):
        return manifest
    row = QUANTITIES[VELOCITY]
    shape = (len(manifest.node_name), len(manifest.axes))
    spec = FunctionSpec(VELOCITY, "", ("velocity",), shape, row.unit, row.sentence, 0)
    return replace(manifest, functions=(*manifest.functions, spec))


def reduce_output(kept_text: KeptText, output: Output, time: RealArray) -> Output:
    """Return the array of a motion from that of one sample; time: of the samples, (n_t,) [s]."""
    if kept_text.reduction == FIRST:
        interpolation = "between samples on a straight line; NAN if never."
        sentence = f"First time at which {kept_text.expression} holds, {interpolation}"
        return replace(output, unit="s", sentence=sentence)
    if kept_text.reduction in SENTENCES:
        return replace(output, sentence=f"{output.sentence.rstrip('.')}: {SENTENCES[kept_text.reduction]}.")
    times = time[:: kept_text.step]
    dim = "time" if kept_text.step == 1 else f"time_{EVERY}_{kept_text.step}"
    return replace(
        output,
        dims=(dim, *output.dims),
        shape=(len(times), *output.shape),
        coordinates={**output.coordinates, dim: tuple(times.tolist())},
    )


def reduce_values(kept_text: KeptText, values: RealArray, time: RealArray) -> RealArray:
    """Return the reduction of values (count, n_t, ...) at times (n_t,) [s]."""
    if kept_text.reduction == FIRST:
        return find_first_time(values, time)
    if kept_text.reduction == "final":
        return values[:, -1]
    if kept_text.reduction == "max":
        return np.asarray(values.max(axis=1))
    if kept_text.reduction == "min":
        return np.asarray(values.min(axis=1))
    if kept_text.reduction in ("mean", "rms"):
        # Weights (n_t,) of the trapezoidal rule that add up to 1.
        span = np.zeros(len(time))
        span[1:] += np.diff(time) / 2
        span[:-1] += np.diff(time) / 2
        weight = np.asarray(span / span.sum()).reshape(-1, *(1,) * (values.ndim - 2))
        if kept_text.reduction == "mean":
            return np.asarray((weight * values).sum(axis=1))
        return np.asarray(np.sqrt((weight * values**2).sum(axis=1)))
    return values[:, :: kept_text.step]


def find_first_time(values: RealArray, time: RealArray) -> RealArray:
    """Return the first time at which values (count, n_t, ...) are positive, (count, ...) [s], NAN if never.

    Between the sample before and the one at which they are, they are taken as a straight line.
    """
    holds = values > 0
    k = holds.argmax(axis=1)
    before = np.maximum(k - 1, 0)
    low, high = (np.take_along_axis(values, index[:, None], axis=1)[:, 0] for index in (before, k))
    with np.errstate(all="ignore"):
        fraction = np.where(k > 0, -low / (high - low), 0.0)
    crossing: RealArray = time[before] + fraction * (time[k] - time[before])
    return np.asarray(np.where(holds.any(axis=1), crossing, np.nan))
