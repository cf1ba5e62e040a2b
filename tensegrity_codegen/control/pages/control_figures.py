"""Figures of the page of a study: pictures and film, errors, commands, tensions, estimates."""

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Literal

import numpy as np

from tensegrity_codegen.control.feedback.loop.control_run import find_displacement
from tensegrity_codegen.control.feedback.study.control_study import LOOP_NAMES, ControlStudy, find_cables
from tensegrity_codegen.control.pages.control_studies import find_actuator_use
from tensegrity_codegen.report.number_text import format_short
from tensegrity_codegen.report.pages.diagram import Diagram, Series
from tensegrity_codegen.report.pages.page import (
    Figure,
    Look,
    Section,
    choose_looks,
    diagram_figure,
    joined_figure,
)
from tensegrity_codegen.report.pages.page_table import Column, Table, number_cell, text_cell
from tensegrity_codegen.report.pages.picture import draw_film, draw_picture, draw_tensions
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray

TIME = "time [s]"
SHAPES = 3  # pictures of the motion
FRAMES = 48  # of the film
FILM = 6.0  # [s], that the film takes at most; at least half
MAX_LINES = 6  # in a diagram
MAX_POINTS = 600  # of a line
# Colour and style of each loop, everywhere on the page, in the order in which they are drawn.
LOOKS: dict[str, tuple[int, Literal["line", "dashed"]]] = {
    "open": (1, "line"),
    "estimator": (2, "line"),
    "true_state": (0, "dashed"),
}


def build_motion(study: ControlStudy, model: CompiledModel, structure: Structure) -> Section:
    """Return the pictures and the film of the worst draw with feedback."""
    name, loop = list(study.loops.items())[-1]
    run = loop.run
    rows = np.unique(np.linspace(0, len(run.time) - 1, FRAMES).round().astype(int))
    position, planned = (
        np.array([place_nodes(model, q) for q in table[rows]])
        for table in (run.coordinate, run.coordinate - run.error)
    )
    n_undrawn = structure.n_members - run.member_tension.shape[1]
    tension = np.pad(run.member_tension[rows], ((0, 0), (0, n_undrawn)), constant_values=np.nan)
    figures = []
    for k in np.unique(np.linspace(0, len(rows) - 1, SHAPES).round().astype(int)).tolist():
        caption = f"At {run.time[rows[k]]:.3g} s, with the {LOOP_NAMES[name]}."
        picture = draw_tensions(
            structure, position[k], tension[k], "member tension [N]", among=(position, tension)
        )
        data = {"time": float(run.time[rows[k]]), "node_position": position[k].tolist()}
        figures.append(Figure(draw_picture(picture, f"shape{k}"), caption, caption, data))
    span = float(run.time[-1])
    slow = float(np.clip(span, FILM / 2, FILM)) / max(span, 1e-9)
    film = draw_film(structure, run.time[rows], position, tension, planned, slow_down=slow)
    summary = f"the worst draw with the {LOOP_NAMES[name]}; dotted: the motion as planned"
    figures.append(Figure(film, f"Film: {summary}.", f"Film of {summary}", {"time": run.time[rows].tolist()}))
    return Section("motion", "", "The motion", "plain", summary, tuple(figures))


def build_errors(study: ControlStudy, model: CompiledModel) -> Section:
    """Return diagrams of the errors of all loops over time."""
    marks = _marks(study)
    away = {name: find_displacement(model, loop.run).max(axis=1) for name, loop in study.loops.items()}
    series = _draw_loops(study, {name: 1000 * values for name, values in away.items()})
    caption = "Distance of the node that is farthest from the motion, in the worst draw."
    diagram = Diagram(TIME, "distance [mm]", series, log_y=_is_positive(series), vertical=marks)
    figures = [diagram_figure("distance", diagram, caption, caption)]
    angles = study.tuning.scales.is_angle
    if angles.any():
        largest = {name: np.abs(loop.run.error[:, angles]).max(axis=1) for name, loop in study.loops.items()}
        series = _draw_loops(study, {name: np.degrees(values) for name, values in largest.items()})
        caption = "Largest error of an angle, in the worst draw."
        diagram = Diagram(TIME, "error [deg]", series, log_y=_is_positive(series), vertical=marks)
        figures.append(diagram_figure("angle", diagram, caption, caption))
    if angles.all():
        figures.reverse()  # the first one is beside the heading, which states angles
    return Section("errors", "", "Errors", "plain", "", tuple(figures))


def build_commands(study: ControlStudy) -> Section:
    """Return diagrams of rest lengths and rates of the actuators, with their limits, and a table."""
    name, loop = list(study.loops.items())[-1]
    run, motion, bounds = loop.run, study.motion, study.bounds
    use = find_actuator_use(study)
    time = run.time[:-1]
    # Rest lengths, and their changes by feedback.
    planned = np.array(
        [motion.at(now + 0.5 * study.gains.sample).input[bounds.place] for now in time.tolist()]
    )
    planned = planned.reshape(len(time), len(bounds.place))
    added = 1000 * (run.command - planned)
    order = sorted(np.argsort(-np.ptp(run.command, axis=0), kind="stable")[:MAX_LINES].tolist())
    rest_length = motion.rest_length[0] - motion.input[0, bounds.place]
    loud = sorted(np.argsort(-np.abs(added).max(axis=0, initial=0.0), kind="stable")[:MAX_LINES].tolist())
    looks = choose_looks(bounds.names[k] for k in sorted({*order, *loud}))
    lines = [
        _series(bounds.names[k], time, 1000 * (rest_length[k] + run.command[:, k]), looks[bounds.names[k]])
        for k in order
    ]
    caption = f"Rest lengths of the {len(order)} actuators that move most, with the {LOOP_NAMES[name]}."
    diagram = Diagram(TIME, "rest length [mm]", lines, vertical=_marks(study))
    figures = [joined_figure("rest", diagram, caption, caption)]
    lines = [_series(bounds.names[k], time, added[:, k], looks[bounds.names[k]]) for k in loud]
    caption = f"What feedback adds to the rest lengths of the motion: the {len(loud)} largest."
    diagram = Diagram(TIME, "change by feedback [mm]", lines, vertical=_marks(study))
    figures.append(joined_figure("feedback", diagram, caption, caption))
    # Rates with their limits.
    rates = np.abs(np.diff(run.command, axis=0)) / study.gains.sample
    limits = np.unique(bounds.rate[np.isfinite(bounds.rate)])[:2]
    top = rates.max(axis=1, initial=0.0) if len(rates) else np.zeros(0)
    lines = [_series("", time[1:], top, LOOKS[name])]
    caption = "Largest rate of all commands" + (
        ", with the least rate that the actuators permit." if len(limits) else "."
    )
    marks = tuple((float(value), f"limit {value:g} m/s") for value in limits)
    diagram = Diagram(TIME, "rate [m/s]", lines, horizontal=marks, vertical=_marks(study))
    figures.append(diagram_figure("rates", diagram, caption, caption))
    # The table of all actuators.
    columns = (
        Column("actuator", numeric=False), Column("smallest rest length", "m"),
        Column("largest rest length", "m"), Column("allowed", "m", numeric=False),
        Column("largest rate", "m/s"), Column("limit of the rate", "m/s"),
    )  # fmt: skip
    rows = tuple(
        (
            text_cell(who),
            *(number_cell(value, ".4f") for value in (entry["rest_length"] or (None, None))),
            text_cell("" if entry["range"] is None else f"{entry['range'][0]:g} to {entry['range'][1]:g}"),
            number_cell(entry["peak_rate"], ".4f"), number_cell(entry["rate"], "g"),
        )
        for who, entry in use.items()
    )  # fmt: skip
    summary = f"largest change by feedback {format_short(float(np.abs(added).max(initial=0.0)))} mm"
    fast = sorted(range(len(rows)), key=lambda k: -float(rows[k][4].value or 0.0))[:8]
    caption = "Actuators: rest lengths and rates, with their limits"
    table = Table(caption, columns, rows, head=tuple(fast), head_note="the fastest")
    return Section("commands", "", "Commands", "plain", summary, (*figures, table))


def build_tensions(study: ControlStudy, model: CompiledModel) -> Iterator[Section]:
    """Return diagrams of the least and the largest tension of the cables; nothing without cables."""
    cables = find_cables(model)
    if not len(cables):
        return
    structure = model.structure
    assert structure is not None
    limit = structure.limits.least_tension[cables]
    stated = study.mpc or study.distribution
    if stated is not None:
        limit = np.maximum(limit, stated.least_tension[cables])
    most = structure.limits.most_tension[cables]
    stated_limits = (("least", limit), ("largest", most))
    bounds = {name: np.unique(values[np.isfinite(values)])[:2] for name, values in stated_limits}
    figures = []
    for extreme, pick in (("least", np.min), ("largest", np.max)):
        picked = {
            name: pick(loop.run.member_tension[:, cables], axis=1) for name, loop in study.loops.items()
        }
        series = _draw_loops(study, picked)
        marks = tuple((float(value), f"limit: {extreme} tension {value:g} N") for value in bounds[extreme])
        diagram = Diagram(TIME, f"{extreme} tension [N]", series, horizontal=marks, vertical=_marks(study))
        caption = f"The {extreme} tension of the cables."
        figures.append(diagram_figure(f"tension-{extreme}", diagram, caption, caption))
    yield Section("tensions", "", "Tensions", "plain", "", tuple(figures))


def build_estimate(study: ControlStudy) -> Iterator[Section]:
    """Return diagrams of the errors of the estimate and of the disturbance forces; nothing without one."""
    loop = study.loops.get("estimator")
    if loop is None or loop.run.estimate is None or loop.run.disturbance is None:
        return
    run, scales = loop.run, study.tuning.scales
    n = run.coordinate.shape[1]
    estimate, forces = loop.run.estimate, loop.run.disturbance
    missed = 1000 * np.abs((estimate[:, :n] - run.coordinate[: len(estimate)]) * scales.lever)
    time = run.time[: len(estimate)]
    lines = [_series("", time, missed.max(axis=1), LOOKS["estimator"])]
    diagram = Diagram(
        TIME, "error of the estimate [mm]", lines, log_y=_is_positive(lines), vertical=_marks(study)
    )
    caption = "Largest error of the estimated coordinates, as a displacement of nodes."
    figures = [diagram_figure("estimate", diagram, caption, caption)]
    if np.any(forces):
        pushed = forces / scales.lever
        order = sorted(np.argsort(-np.abs(pushed).max(axis=0), kind="stable")[:MAX_LINES].tolist())
        names = study.gains.state_name
        looks = choose_looks(names[k] for k in order)
        lines = [_series(names[k], time, pushed[:, k], looks[names[k]]) for k in order]
        diagram = Diagram(TIME, "disturbance force [N]", lines, vertical=_marks(study), legend_columns=2)
        caption = "Estimated disturbance forces; those on angles over the lever of the angle."
        figures.append(diagram_figure("forces", diagram, caption, caption))
    at_end = missed[time >= time[-1] - study.last]
    summary = f"largest error at the end {float(at_end.max()):.3g} mm"
    yield Section("estimate", "", "Estimate", "plain", summary, tuple(figures))


def _marks(study: ControlStudy) -> tuple[tuple[float, str], ...]:
    """Return the times that a diagram marks: the end of the motion, the starts of gusts."""
    marks = [(study.motion.duration, "end of motion")] if np.any(study.motion.velocity) else []
    for gust in study.drawn[study.worst_draw].gusts[:2]:
        marks.append((gust.start, "gust"))
    return tuple((time, label) for time, label in marks if 0.0 < time < study.t_end)


def _draw_loops(study: ControlStudy, values: Mapping[str, FloatArray]) -> list[Series]:
    """Return the line of each loop, the dashed one last: it lies over the others."""
    return [
        _series(LOOP_NAMES[name], study.loops[name].run.time, values[name], look)
        for name, look in LOOKS.items()
        if name in study.loops
    ]


def _series(name: str, time: FloatArray, values: FloatArray, look: Look) -> Series:
    """Return a line of at most MAX_POINTS points: of the others the extremes stay."""
    if len(time) > MAX_POINTS:
        edges = np.linspace(0, len(time), MAX_POINTS // 2 + 1).round().astype(int)
        keep = {int(a + f(values[a:b])) for a, b in pairwise(edges.tolist()) for f in (np.argmin, np.argmax)}
        rows = sorted(keep)
        time, values = time[rows], values[rows]
    color, style = look
    return Series(name, time, values, style, color)


def _is_positive(series: list[Series]) -> bool:
    return all(bool(np.all(np.asarray(line.y) > 0)) for line in series)
