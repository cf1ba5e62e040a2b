"""A study of feedback as a page: outcome, film, errors, commands, tensions, estimate, draws."""

import math

import numpy as np

from tensegrity_codegen.control.feedback.study.control_study import (
    LOOP_NAMES,
    OPEN,
    ControlStudy,
    LoopResult,
    count_worse,
    find_cables,
)
from tensegrity_codegen.control.feedback.study.linear_loop import find_gain_range, find_phase
from tensegrity_codegen.control.pages.control_figures import (
    build_commands,
    build_errors,
    build_estimate,
    build_motion,
    build_tensions,
)
from tensegrity_codegen.control.pages.control_studies import (
    LIMIT_NAMES,
    STEP_NAMES,
    describe_facts,
    find_noise_errors,
    has_limits,
)
from tensegrity_codegen.report.number_text import format_short
from tensegrity_codegen.report.pages.page import (
    Block,
    Chapter,
    Page,
    Paragraph,
    Remark,
    Section,
    as_sentence,
    command_section,
    join_names,
)
from tensegrity_codegen.report.pages.page_table import (
    Cell,
    Column,
    Table,
    find_largest,
    number_cell,
    text_cell,
)
from tensegrity_codegen.runtime.linear.linearize import find_variations
from tensegrity_codegen.runtime.model.arguments import INPUT
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.summaries import describe_count
from tensegrity_codegen.system.version import VERSION
from tensegrity_codegen.tables.body_places import show_members

LOOPS = (
    "Open loop: without feedback. True state: feedback on the exact state, as if everything were measured "
    "without noise. Estimator: feedback on the state estimated from the sensors."
)
TOLERANCE_ROW = "tolerance: displacement of a node that is accepted for a moment"
LOWER_PART = 0.95  # of the smallest tension at the end: less before it is stated too


def build_control_page(study: ControlStudy, model: CompiledModel, structure: Structure, command: str) -> Page:
    """Return the page of a study."""
    bound, count = -np.inf, len(study.drawn)
    if model.structure is not None:
        bound = find_least_bound(model.structure.limits.least_tension[find_cables(model)])
    sections = (
        _outcome(study),
        build_errors(study, model),
        build_motion(study, model, structure),
        build_commands(study),
        *build_tensions(study, model),
        *build_estimate(study),
        _limits(study),
        _draws(study),
        _design(study),
        command_section(command),
    )
    return Page(
        subject=f"Feedback control of {structure.name}",
        title=describe_control_finding(study, bound),
        lead=f"The end is the last {study.last:.3g} of "
        f"{format_short(study.t_end)} s; errors are the largest of {count} draw{'s' * (count != 1)} of the "
        f"disturbances. Diagrams show the worst draw, number {study.worst_draw} (counted from 0).",
        chapters=(Chapter("control", structure.name, "", _count(study, model), sections),),
        facts=(f"tensegrity_codegen {VERSION}.", "Statuses: docs/control.md; equations: docs/gains.md."),
    )


def _count(study: ControlStudy, model: CompiledModel) -> str:
    run = study.loops["open"].run
    estimator = study.estimator
    measured = "no estimator: all states are fed back"
    if estimator is not None:
        measured = f"{len(estimator.sensing.names)} numbers measured"
    motion, n = study.motion, len(run.coordinate_name)
    start = {"coordinate": motion.coordinate[0], "velocity": motion.velocity[0], INPUT: motion.input[0]}
    free = find_variations(model, start) if model.manifest.rigid_bar else None
    bound = "" if free is None else f" ({free.along.shape[1]} independent)"
    n_members = len(show_members(run.member_name, model.manifest.body_places))
    return (
        f"{describe_count(n, 'coordinate')}{bound}, {describe_count(n_members, 'member')}, "
        f"{describe_count(len(run.actuators), 'actuator')}, {measured}."
    )


def _outcome(study: ControlStudy) -> Section:
    columns = (
        Column("loop", numeric=False), Column("error at the end", "mm"), Column("largest error", "mm"),
        Column("angle at the end", "deg"), Column("least tension at the end", "N"),
        Column("least tension, whole time", "N"), Column("commands cut", "%"),
    )  # fmt: skip
    rows = tuple(_outcome_row(name, loop) for name, loop in study.loops.items())
    note = f"Distances of nodes from the motion, and errors of angles; of all draws the worst. {LOOPS}"
    blocks: list[Block] = [Table("Loops", columns, rows, note)]
    blocks += [Remark("differs", as_sentence(sentence)) for sentence in study.warnings]
    blocks += [Paragraph(as_sentence(sentence)) for sentence in describe_facts(study)]
    return Section("outcome", "", "Outcome", "plain", "", tuple(blocks))


def _outcome_row(name: str, loop: LoopResult) -> tuple[Cell, ...]:
    steps = loop.steps
    cut = 100 * (1.0 - steps.get("ok", 0) / max(sum(steps.values()), 1))
    unstable = f", unstable in {loop.unstable}" if loop.unstable else ""
    return (
        text_cell(LOOP_NAMES[name] + unstable),
        number_cell(1000 * float(loop.end_error.max()), ".3g"),
        number_cell(1000 * float(loop.peak_error.max()), ".3g"),
        number_cell(float(np.degrees(loop.end_angle.max())), ".3g"),
        number_cell(float(np.min(loop.end_tension)), ".4g"),
        number_cell(float(np.min(loop.least_tension)), ".4g"),
        number_cell(cut, ".1f"),
    )


def _limits(study: ControlStudy) -> Section:
    columns = tuple(Column(title, numeric=False) for title in ("loop", "limit", "exceeded at the end"))
    rows = tuple(
        (text_cell(LOOP_NAMES[name]), text_cell(LIMIT_NAMES[limit]), text_cell(", ".join(who)))
        for name, loop in study.loops.items()
        for limit, who in loop.broken.items()
    )
    bad = [LOOP_NAMES[name] for name, loop in study.loops.items() if loop.broken]
    summary = f"exceeded at the end: {', '.join(bad)}" if bad else "none is exceeded at the end, in any loop"
    if not has_limits(study):
        summary = "the scene states no limits of tensions or clearance"
    blocks: list[Block] = [Table("Limits of the scene", columns, rows)] if rows else []
    heads = (
        Column("loop", numeric=False), Column("commands", numeric=False),
        Column("number"), Column("share", "%"),
    )  # fmt: skip
    counts = tuple(
        (
            text_cell(LOOP_NAMES[name]), text_cell(STEP_NAMES.get(status, status)),
            number_cell(float(count), ".0f"),
            number_cell(100 * count / max(sum(loop.steps.values()), 1), ".2f"),
        )
        for name, loop in study.loops.items()
        for status, count in loop.steps.items()
    )  # fmt: skip
    blocks.append(Table("Commands of all draws", heads, counts))
    return Section("limits", "", "Limits", "plain", summary, tuple(blocks))


def _draws(study: ControlStudy) -> Section:
    names = list(study.loops)
    columns = [Column("draw")]
    columns += [Column(LOOP_NAMES[name], "mm") for name in names]
    columns += [Column(f"tension, {LOOP_NAMES[name]}", "N") for name in names]
    rows = []
    for k in range(len(study.drawn)):
        cells = [number_cell(float(k), ".0f")]
        for name in names:
            row = study.loops[name].measures[k]
            cells.append(
                text_cell("unstable") if row.is_unstable else number_cell(1000 * row.end_error, ".3g")
            )
        cells += [number_cell(study.loops[name].measures[k].end_tension, ".4g") for name in names]
        rows.append(tuple(cells))
    note = "Largest distance of a node from the motion, and least tension of the cables, at the end."
    end_error = study.loops[names[-1]].end_error
    worst = find_largest(np.nan_to_num(end_error, nan=np.inf))
    table = Table("Draws", tuple(columns), tuple(rows), note, head=worst, head_note="the largest errors")
    return Section("draws", "", "Draws", "plain", f"{len(rows)} draws, seed {study.seed}", (table,))


def _design(study: ControlStudy) -> Section:
    gains, tuning = study.gains, study.tuning
    facts: list[tuple[str, float, str, str]] = [
        (TOLERANCE_ROW, 1000 * tuning.tolerance, "mm", ".4g"),
        ("response time", tuning.response_time, "s", ".4g"),
        ("lowest natural frequency", tuning.scales.frequency / (2 * np.pi), "Hz", ".4g"),
        ("time between two commands", gains.sample, "s", ".4g"),
        ("largest delay of an actuator", float(study.bounds.delay.max(initial=0.0)), "s", ".4g"),
        ("time in which the slowest error falls to 1/e", study.time_constant, "s", ".3g"),
        ("integrals of errors", float(len(gains.integral_name)), "", ".0f"),
        ("residual of the Riccati equation", gains.residual, "", ".1e"),
    ]
    if study.estimator is not None:
        facts.append(("states of the estimator", float(len(study.estimator.state_name)), "", ".0f"))
        facts.append(("residual of the estimator's equation", study.estimator.residual, "", ".1e"))
    rows = tuple(
        (text_cell(name), number_cell(value, spec), text_cell(unit)) for name, value, unit, spec in facts
    )
    columns = (Column("what", numeric=False), Column("value"), Column("unit", numeric=False))
    size = f"{gains.K.shape[1]} x {gains.K.shape[2]} gains at {len(gains.time)} times"
    return Section(
        "design", "", "Design", "plain", size,
        (Table("Regulator and estimator", columns, rows), _judge_loops(study)),
    )  # fmt: skip


def _judge_loops(study: ControlStudy) -> Table:
    """Return the table of the margins of linear loops, and of errors by noise; a column for each loop."""
    rows: dict[tuple[str, str, str], list[float]] = {}

    def add(what: str, unit: str, spec: str, value: float) -> None:
        rows.setdefault((what, unit, spec), []).append(value)

    for margins in study.margins.values():
        add("largest modulus of an eigenvalue, below 1 where stable", "", ".4f", margins.radius)
        add("further delay of all actuators that makes it unstable", "s", ".3g", margins.delay)
        add("factor of the effect of all actuators that makes it unstable", "", ".3g", margins.gain)
        add("error of all stiffnesses that makes it unstable", "%", ".3g", 100 * margins.stiffness)
        for who, disk in (
            ("any actuator alone", float(margins.actuator_disk.min())),
            ("each actuator differently", margins.disk),
        ):
            lower, upper = find_gain_range(disk)
            add(f"{who}: least factor of the effect that it stands", "", ".3g", lower)
            add(f"{who}: largest", "", ".3g", upper)
            add(f"{who}: phase", "deg", ".3g", float(np.degrees(find_phase(disk))))
    noise = find_noise_errors(study)
    if noise is not None:
        what = f"distance of {noise['node']} from the motion, root mean square"
        values = (noise["predicted_rms"], noise["simulated_rms"])
        for words, value in zip(("by noise, predicted", "at the end, simulated"), values, strict=True):
            rows[f"{what}: {words}", "mm", ".3g"] = [np.nan, np.nan if value is None else 1000 * value]
    names = [Column(LOOP_NAMES[name]) for name in study.margins]
    return Table(
        "Linear loops at the end of the motion",
        (Column("what", numeric=False), *names, Column("unit", numeric=False)),
        tuple(
            (
                text_cell(what),
                *(number_cell(value if np.isfinite(value) else None, spec) for value in values),
                text_cell(unit),
            )
            for (what, unit, spec), values in rows.items()
        ),
        "Judged before anything is simulated. A dash: more than ten samples of delay, a factor above 11, "
        "stiffnesses that are more than 10 % off, a factor without bound, or no noise. The simulated "
        "distance contains all errors.",
    )


# The result of a study of feedback, in one sentence of numbers: the headline of its page.


def describe_control_finding(study: ControlStudy, least_bound: float = -math.inf) -> str:
    """Return how far the structure ends from its motion with and without feedback, and the least tension."""
    closed = {name: loop for name, loop in study.loops.items() if name != OPEN}
    name, loop = list(closed.items())[-1]
    thing = "motion" if np.any(study.motion.velocity) else "equilibrium"
    if study.status in ("unstable", "not_solved"):
        counts = {key: getattr(closed_loop, study.status) for key, closed_loop in closed.items()}
        failing = [
            f"the {LOOP_NAMES[key]} in {n} of {len(study.drawn)} draws" for key, n in counts.items() if n
        ]
        status = study.status.replace("_", " ")
        return f"Feedback is {status} with {' and with '.join(failing)}; {_without(study)}"
    if study.status == "does_not_hold":
        return (
            f"Feedback does not keep the {thing}: {_error(study, loop)} from it at the end with the "
            f"{LOOP_NAMES[name]}, {_without(study)}"
        )
    sentence = (
        f"Feedback with the {LOOP_NAMES[name]} keeps the {thing} within {_error(study, loop)} at the end, "
        f"{_without(study)}"
    )
    worse = count_worse(study.loops, name)
    sentence += f", worse than that in {worse} of {len(study.drawn)} draws" if worse else ""
    return f"{sentence}{_describe_limits(loop, least_bound)}"


def find_least_bound(limits: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
    """Return the largest of the least tensions (n,) that are stated [N], -infinity if none is."""
    finite = limits[np.isfinite(limits)]
    return float(finite.max()) if len(finite) else -math.inf


def _without(study: ControlStudy) -> str:
    loop = study.loops[OPEN]
    if loop.unstable:
        return "unstable without feedback"
    return f"{_error(study, loop)} without feedback"


def _error(study: ControlStudy, loop: LoopResult) -> str:
    """Return the largest error at the end of all draws: an angle where all coordinates are angles."""
    if study.tuning.scales.is_angle.all():
        return f"{format_short(float(np.degrees(loop.end_angle.max())))} deg"
    return f"{format_short(1000 * float(loop.end_error.max()))} mm"


def _describe_limits(loop: LoopResult, least_bound: float) -> str:
    """Return the smallest tension at the end, and the limits that are not kept there."""
    broken = "".join(
        f"; {LIMIT_NAMES[limit]} not kept by {join_names(who)}" for limit, who in loop.broken.items()
    )
    smallest = float(np.min(loop.end_tension))
    if not math.isfinite(smallest):
        return broken
    way = float(np.min(loop.least_tension))
    on_the_way = f" at the end, {format_short(way)} N on the way" if way < LOWER_PART * smallest else ""
    bound = f", limit {format_short(least_bound)} N" if math.isfinite(least_bound) else ""
    return f"; smallest cable tension {format_short(smallest)} N{on_the_way}{bound}{broken}"
