"""Figures of the page of a study: pictures and film, errors, commands, tensions, estimates."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.report.control_studies import LOOP_NAMES, find_actuator_use
from tensegrity_codegen.report.pages.diagram import Diagram, Series
from tensegrity_codegen.report.pages.page import Figure, Section, diagram_figure
from tensegrity_codegen.report.pages.page_film import draw_film
from tensegrity_codegen.report.pages.page_table import Column, Table, number_cell, text_cell
from tensegrity_codegen.report.pages.picture import draw_picture
from tensegrity_codegen.report.pictures.motion_picture import draw_tensions
from tensegrity_codegen.runtime.control.loop.control_run import ControlRun
from tensegrity_codegen.runtime.control.study.control_study import ControlStudy
from tensegrity_codegen.runtime.control.study.run_measures import find_cables, find_displacement
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.structure.structure import Structure

__all__ = ["build_commands", "build_errors", "build_estimate", "build_motion", "build_tensions"]

FloatArray = NDArray[np.float64]

TIME = "time [s]"
SHAPES = 3  # pictures of the motion
FRAMES = 48  # of the film
FILM = 6.0  # [s], that the film takes at most; at least half
MOST_LINES = 6  # in a diagram
MOST_POINTS = 600  # of a line
COLORS = {"open": 1, "true_state": 0, "estimator": 2}


def build_motion(study: ControlStudy, model: CompiledModel, structure: Structure) -> Section:
    """Return the pictures and the film of the worst draw with feedback."""
    name, loop = list(study.loops.items())[-1]
    run = loop.run
    rows = np.unique(np.linspace(0, len(run.time) - 1, FRAMES).round().astype(int))
    position, planned = (
        np.array([place_nodes(model, q) for q in table[rows]])
        for table in (run.coordinate, run.coordinate - run.error)
    )
    more = structure.n_members - run.member_tension.shape[1]
    tension = np.pad(run.member_tension[rows], ((0, 0), (0, more)), constant_values=np.nan)
    figures = []
    for k in np.unique(np.linspace(0, len(rows) - 1, SHAPES).round().astype(int)).tolist():
        caption = f"At {run.time[rows[k]]:.3g} s."
        picture = draw_tensions(
            structure, position[k], tension[k], "member tension [N]", among=(position, tension)
        )
        data = {"time": float(run.time[rows[k]]), "node_position": position[k].tolist()}
        figures.append(Figure(draw_picture(picture, f"shape{k}"), caption, caption, data))
    span = float(run.time[-1])
    slow = float(np.clip(span, FILM / 2, FILM)) / max(span, 1e-9)
    film = draw_film(structure, run.time[rows], position, tension, planned, slow_down=slow)
    text = f"the worst draw with the {LOOP_NAMES[name]}; dotted: the motion as planned"
    figures.append(Figure(film, f"Film: {text}.", f"Film of {text}", {"time": run.time[rows].tolist()}))
    return Section("motion", "motion", "The motion", "plain", text, tuple(figures))


def build_errors(study: ControlStudy, model: CompiledModel) -> Section:
    """Return diagrams of the errors of all loops over time."""
    marks = _marks(study)
    away = {
        name: find_displacement(model, loop.run, study.motion).max(axis=1)
        for name, loop in study.loops.items()
    }
    series = [
        _line(LOOP_NAMES[name], loop.run, 1000 * away[name], COLORS[name])
        for name, loop in study.loops.items()
    ]
    caption = "Largest distance of a node from the motion."
    diagram = Diagram(TIME, "distance [mm]", series, log_y=_is_positive(series), vertical=marks)
    figures = [diagram_figure("distance", diagram, caption, caption)]
    angles = study.tuning.scales.is_angle
    if angles.any():
        series = [
            _line(
                LOOP_NAMES[name],
                loop.run,
                np.degrees(np.abs(loop.run.error[:, angles]).max(axis=1)),
                COLORS[name],
            )
            for name, loop in study.loops.items()
        ]
        caption = "Largest error of an angle."
        diagram = Diagram(TIME, "error [deg]", series, log_y=_is_positive(series), vertical=marks)
        figures.append(diagram_figure("angle", diagram, caption, caption))
    return Section("errors", "worst draw", "Errors", "plain", study.message, tuple(figures))


def build_commands(study: ControlStudy) -> Section:
    """Return diagrams of rest lengths and rates of the actuators, with their limits, and a table."""
    name, loop = list(study.loops.items())[-1]
    run, motion, bounds = loop.run, study.motion, study.bounds
    use = find_actuator_use(study)
    time = run.time[:-1]
    asked = np.array([motion.at(now + 0.5 * study.gains.sample).input[bounds.place] for now in time.tolist()])
    asked = asked.reshape(len(time), len(bounds.place))
    added = 1000 * (run.command - asked)
    order = sorted(np.argsort(-np.ptp(run.command, axis=0), kind="stable")[:MOST_LINES].tolist())
    rest = motion.rest_length[0] - motion.input[0, bounds.place]
    lines = [
        _series(bounds.names[k], time, 1000 * (rest[k] + run.command[:, k]), n) for n, k in enumerate(order)
    ]
    caption = f"Rest lengths of the {len(order)} actuators that move most, with the {LOOP_NAMES[name]}."
    figures = [
        diagram_figure(
            "rest", Diagram(TIME, "rest length [mm]", lines, vertical=_marks(study)), caption, caption
        )
    ]
    loud = sorted(np.argsort(-np.abs(added).max(axis=0, initial=0.0), kind="stable")[:MOST_LINES].tolist())
    lines = [_series(bounds.names[k], time, added[:, k], n) for n, k in enumerate(loud)]
    caption = "What feedback adds to the rest lengths of the motion."
    diagram = Diagram(TIME, "change by feedback [mm]", lines, vertical=_marks(study))
    figures.append(diagram_figure("feedback", diagram, caption, caption))
    rates = np.abs(np.diff(run.command, axis=0)) / study.gains.sample
    limits = np.unique(bounds.rate[np.isfinite(bounds.rate)])[:2]
    top = rates.max(axis=1, initial=0.0) if len(rates) else np.zeros(0)
    lines = [_series("largest of all actuators", time[1:], top, 0)]
    caption = "Rate of the commands, with the least rate that the actuators permit."
    marks = tuple((float(value), f"{value:g} m/s") for value in limits)
    diagram = Diagram(TIME, "rate [m/s]", lines, horizontal=marks, vertical=_marks(study))
    figures.append(diagram_figure("rates", diagram, caption, caption))
    columns = (
        Column("actuator", numeric=False), Column("least", "m"), Column("largest", "m"),
        Column("range", "m", numeric=False), Column("largest rate", "m/s"), Column("limit", "m/s"),
    )  # fmt: skip
    rows = tuple(
        (
            text_cell(who),
            *(number_cell(value, ".4f") for value in (item["rest_length"] or (None, None))),
            text_cell("" if item["range"] is None else f"{item['range'][0]:g} to {item['range'][1]:g}"),
            number_cell(item["peak_rate"], ".4f"), number_cell(item["rate"], "g"),
        )
        for who, item in use.items()
    )  # fmt: skip
    text = f"largest change by feedback {float(np.abs(added).max(initial=0.0)):.3g} mm"
    table = Table("Actuators: rest lengths and rates, with their limits", columns, rows)
    return Section("commands", "actuators", "Commands", "plain", text, (*figures, table))


def build_tensions(study: ControlStudy, model: CompiledModel) -> Iterator[Section]:
    """Return diagrams of the least and the largest tension of the cables; nothing without cables."""
    cables = find_cables(model)
    if not len(cables):
        return
    structure = model.structure
    assert structure is not None
    least = structure.limits.least_tension[cables]
    if study.distribution is not None:
        least = np.maximum(least, study.distribution.least_tension[cables])
    values = np.unique(least[np.isfinite(least)])[:2].tolist()
    figures = []
    for word, pick in (("least", np.min), ("largest", np.max)):
        series = [
            _line(LOOP_NAMES[name], loop.run, pick(loop.run.member_tension[:, cables], axis=1), COLORS[name])
            for name, loop in study.loops.items()
        ]
        bounds = values if word == "least" else []
        marks = tuple((float(value), f"least tension {value:g} N") for value in bounds)
        diagram = Diagram(TIME, f"{word} tension [N]", series, horizontal=marks, vertical=_marks(study))
        caption = f"The {word} tension of the cables."
        figures.append(diagram_figure(f"tension-{word}", diagram, caption, caption))
    ends = ", ".join(
        f"{LOOP_NAMES[name]} {float(np.min(loop.end_tension)):.4g} N" for name, loop in study.loops.items()
    )
    yield Section("tensions", "limits", "Tensions", "plain", f"least at the end: {ends}", tuple(figures))


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
    lines = [_series("largest of all coordinates", time, missed.max(axis=1), COLORS["estimator"])]
    diagram = Diagram(
        TIME, "error of the estimate [mm]", lines, log_y=_is_positive(lines), vertical=_marks(study)
    )
    caption = "Errors of the estimated coordinates, as displacements of nodes."
    figures = [diagram_figure("estimate", diagram, caption, caption)]
    if np.any(forces):
        pushed = forces / scales.lever
        order = sorted(np.argsort(-np.abs(pushed).max(axis=0), kind="stable")[:MOST_LINES].tolist())
        names = study.gains.state_name
        lines = [_series(names[k], time, pushed[:, k], c) for c, k in enumerate(order)]
        diagram = Diagram(TIME, "disturbance force [N]", lines, vertical=_marks(study), legend_columns=2)
        caption = "Estimated disturbance forces; those on angles over the lever of the angle."
        figures.append(diagram_figure("forces", diagram, caption, caption))
    last = missed[time >= time[-1] - study.last]
    text = f"largest error at the end {float(last.max()):.3g} mm"
    yield Section("estimate", "worst draw", "Estimate", "plain", text, tuple(figures))


def _marks(study: ControlStudy) -> tuple[tuple[float, str], ...]:
    """Return the times that a diagram marks: the end of the motion, the starts of gusts."""
    marks = [(study.motion.duration, "end of motion")] if np.any(study.motion.velocity) else []
    for gust in study.drawn[study.worst_draw].gusts[:2]:
        marks.append((gust.start, "gust"))
    return tuple((time, text) for time, text in marks if 0.0 < time < study.t_end)


def _line(name: str, run: ControlRun, values: FloatArray, color: int) -> Series:
    return _series(name, run.time, values, color)


def _series(name: str, time: FloatArray, values: FloatArray, color: int) -> Series:
    """Return a line of at most MOST_POINTS points: of the others the extremes stay."""
    if len(time) > MOST_POINTS:
        edges = np.linspace(0, len(time), MOST_POINTS // 2 + 1).round().astype(int)
        keep = {int(a + f(values[a:b])) for a, b in pairwise(edges.tolist()) for f in (np.argmin, np.argmax)}
        rows = sorted(keep)
        time, values = time[rows], values[rows]
    return Series(name, time, values, "line", color)


def _is_positive(series: list[Series]) -> bool:
    return all(bool(np.all(np.asarray(item.y) > 0)) for item in series)
