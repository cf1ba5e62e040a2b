"""Studies of feedback as JSON-ready data, and in tables for the terminal."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.table import Table

from tensegrity_codegen.control.feedback.study.control_study import (
    LOOP_NAMES,
    ControlStudy,
    LoopResult,
    count_worse,
)
from tensegrity_codegen.control.feedback.study.linear_loop import (
    MAX_SAMPLES,
    Margins,
    find_gain_range,
    find_phase,
)
from tensegrity_codegen.report.long_table import LongTable, add_row, new_table, rank_rows

LIMIT_NAMES = {"least_tension": "least tension", "most_tension": "largest tension", "clearance": "clearance"}
STEP_NAMES = {
    "ok": "within all limits",
    "rate_limited": "cut to a rate",
    "range_limited": "cut to a range",
    "tension_limited": "least tensions prevent the forces",
    "least_tension": "a least tension yields",
    "not_solved": "not solved",
    "outlier": "measurements not used",
}


def describe_study(study: ControlStudy) -> dict[str, Any]:
    """Return a study as one JSON-ready object."""
    tuning, gains, mpc = study.tuning, study.gains, study.mpc
    return {
        "status": study.status,
        "message": study.message,
        "motion": {
            "duration": study.motion.duration,
            "shortest_duration": study.motion.shortest_duration,
            "is_rest": not np.any(study.motion.velocity),
            "largest_residual": float(study.motion.residual.max(initial=0.0)),
        },
        "t_end": study.t_end,
        "last": study.last,
        "sample": gains.sample,
        "draws": len(study.drawn),
        "seed": study.seed,
        "worst_draw": study.worst_draw,
        "weights": {
            "tolerance": tuning.tolerance,
            "effort": dict(zip(study.motion.actuators, tuning.effort.tolist(), strict=True)),
            "response_time": tuning.response_time,
            "integral": list(gains.integral_name),
            "lowest_frequency": tuning.scales.frequency / (2 * np.pi),
            "size": tuning.scales.size,
        },
        "gains": {
            "n_states": gains.K.shape[2],
            "residual": gains.residual,
            "spectral_radius": float(np.abs(gains.E).max(initial=0.0)),
            "time_constant": study.time_constant,
        },
        "margins": {
            name: _describe_margins(margins, study.gains.actuators) for name, margins in study.margins.items()
        },
        "noise": find_noise_errors(study),
        "estimator": _describe_estimator(study),
        "mpc": None
        if mpc is None
        else {"horizon": mpc.horizon, "blocks": list(mpc.blocks), "substeps": mpc.substeps},
        "least_tension": _describe_distribution(study),
        "errors": _describe_errors(study),
        "loops": {
            name: _describe_loop(loop) | {"worse": count_worse(study.loops, name)}
            for name, loop in study.loops.items()
        },
        "actuators": find_actuator_use(study),
        "warnings": study.warnings,
    }


def errors_table(study: ControlStudy, name: str) -> Table:
    """Return a table with a column for each loop: errors at the end and on the way, tensions, limits."""
    loops = study.loops
    count = len(study.drawn)
    title = f"{name}: {count} draw{'s' * (count > 1)}" + (", least to largest" if count > 1 else "")
    heads: dict[str, str] = {LOOP_NAMES[key]: "right" for key in loops}
    table = new_table(title, f"last {study.last:.3g} s", **heads)
    add_row(table, "error [mm]", *(_range(1000 * loop.end_error) for loop in loops.values()))
    if study.tuning.scales.is_angle.any():
        add_row(table, "error [deg]", *(_range(np.degrees(loop.end_angle)) for loop in loops.values()))
    if not all(np.isnan(loop.end_tension).all() for loop in loops.values()):
        tensions = (f"{np.nanmin(loop.end_tension):.4g}" for loop in loops.values())
        add_row(table, "least tension [N]", *tensions)
    add_row(table, "limits at the end", *(_describe_limits(study, loop) for loop in loops.values()))
    table.add_section()
    add_row(table, "whole time", *("" for _ in loops))
    add_row(table, "error [mm]", *(_range(1000 * loop.peak_error) for loop in loops.values()))
    if not all(np.isnan(loop.least_tension).all() for loop in loops.values()):
        tensions = (f"{np.nanmin(loop.least_tension):.4g}" for loop in loops.values())
        add_row(table, "least tension [N]", *tensions)
    cut = [1.0 - loop.steps.get("ok", 0) / max(sum(loop.steps.values()), 1) for loop in loops.values()]
    add_row(table, "commands cut", *(f"{fraction:.1%}" for fraction in cut))
    return table


def actuators_table(study: ControlStudy, name: str) -> LongTable:
    """Return a table of the actuators in the worst draw: rest lengths and rates, with their limits."""
    uses = list(find_actuator_use(study).items())

    def describe(k: int) -> tuple[str, ...]:
        actuator, use = uses[k]
        low, high = use["rest_length"]
        return (
            actuator, f"{low:.4f} to {high:.4f}",
            "" if use["range"] is None else f"{use['range'][0]:g} to {use['range'][1]:g}",
            f"{use['motion_rate']:.4f}", f"{use['peak_rate']:.4f}",
            "" if use["rate"] is None else f"{use['rate']:g}",
        )  # fmt: skip

    ratios = [-use["peak_rate"] / (use["rate"] or np.inf) for _, use in uses]
    heads = ("rest length\n[m]", "range\n[m]", "motion needs\n[m/s]", "commanded\n[m/s]", "rate\n[m/s]")
    return LongTable(
        f"{name}: actuators with feedback, draw {study.worst_draw}", ("actuator", *heads), "frrrrr",
        len(uses), describe, "actuators",
        (
            ("nearest to their rate", rank_rows(ratios)),
            ("fastest", rank_rows([-use["peak_rate"] for _, use in uses])),
        ),
    )  # fmt: skip


def describe_facts(study: ControlStudy) -> list[str]:
    """Return the assumptions of the study and the design, a line each."""
    tuning, gains = study.tuning, study.gains
    still = not np.any(study.motion.velocity)
    motion = "an equilibrium to be kept" if still else f"motion of {study.motion.duration:.6g} s"
    if not still and study.motion.shortest_duration:
        motion += f", shortest {study.motion.shortest_duration:.6g} s"
    lines = [f"{motion}; simulated {study.t_end:.6g} s, a command every {gains.sample:.6g} s"]
    low, high = 1000 * tuning.effort.min(), 1000 * tuning.effort.max()
    effort = f"{low:.4g} mm" if high - low < 1e-9 else f"{low:.4g} to {high:.4g} mm"
    lines.append(
        f"weights: displacement {1000 * tuning.tolerance:.4g} mm, effort {effort}, response time "
        f"{tuning.response_time:.4g} s; {len(gains.integral_name)} integrals of errors; slowest "
        f"error falls to 1/e in {study.time_constant:.3g} s"
    )
    lines.append(describe_delays(study))
    lines.append(f"disturbances: {_describe_words(study)}")
    if study.estimator is None:
        lines.append("no estimator: feedback acts on the true state")
    else:
        names = study.estimator.sensing.names
        forces = len(study.estimator.disturbed)
        lines.append(f"estimator: {len(names)} numbers measured, {forces} disturbance forces")
    if study.mpc is not None:
        bound = study.mpc.least_tension[study.mpc.cables.limited]
        above = f", least tensions from {bound.min():.4g} N" if len(bound) else ""
        lines.append(
            f"model-predictive control over {study.mpc.horizon} commands "
            f"({study.mpc.horizon * gains.sample:.4g} s) in {len(study.mpc.blocks)} blocks{above}"
        )
    if study.distribution is not None:
        bound = study.distribution.least_tension
        finite = bound[np.isfinite(bound)]
        lines.append(
            f"tensions distributed above {finite.min():.4g} N" if len(finite) else "tensions distributed"
        )
    return lines


def describe_delays(study: ControlStudy) -> str:
    """Return when commands act, and the further delay at which the linear loops become unstable."""
    delay, sample = study.bounds.delay, study.gains.sample
    late = float(delay.max(initial=0.0))
    sentence = "commands act at once"
    if late:
        prefix = "up to " if float(delay.min()) < late else ""
        sentence = f"commands act {prefix}{late:.3g} s ({_count_samples(late / sample)}) later"
        sentence += ", which the gains predict" if np.allclose(study.gains.delay, delay) else ""
    stood = []
    for name, margins in study.margins.items():
        is_known = np.isfinite(margins.delay)
        further = margins.delay if is_known else MAX_SAMPLES * sample
        size = f"{further:.3g} s ({_count_samples(further / sample)})"
        words = f"unstable with {size} more" if is_known else f"stands {size} more, not tried beyond"
        stood.append(f"{LOOP_NAMES[name]} {words if margins.is_stable else 'unstable at once'}")
    return f"{sentence}; linear loops: {', '.join(stood)}"


def _count_samples(count: float) -> str:
    return f"{count:.3g} sample{'s' * (abs(count - 1.0) > 1e-9)}"


def find_actuator_use(study: ControlStudy) -> dict[str, dict[str, Any]]:
    """Return of each actuator in the worst draw of the last loop: rest lengths, rates, their limits."""
    run = list(study.loops.values())[-1].run
    motion, bounds = study.motion, study.bounds
    uses = {}
    for k, name in enumerate(motion.actuators):
        base = float(motion.rest_length[0, k] - motion.input[0, int(bounds.place[k])])
        command = run.command[:, k]
        rate = np.abs(np.diff(command)) / study.gains.sample
        limits = (float(base + bounds.least[k]), float(base + bounds.most[k]))
        uses[name] = {
            "rest_length": [base + float(command.min()), base + float(command.max())]
            if len(command)
            else None,
            "range": list(limits) if np.isfinite(limits[1]) else None,
            "motion_rate": float(motion.peak_rate[k]),
            "peak_rate": float(rate.max(initial=0.0)),
            "rate": float(bounds.rate[k]) if np.isfinite(bounds.rate[k]) else None,
            "delay": float(bounds.delay[k]),
        }
    return uses


def _describe_loop(loop: LoopResult) -> dict[str, Any]:
    errors = {"end_error": loop.end_error, "peak_error": loop.peak_error, "end_angle": loop.end_angle}
    data = {
        key: {"least": float(np.min(values)), "largest": float(np.max(values)), "draws": values.tolist()}
        for key, values in errors.items()
    }
    return {
        **data,
        "end_node": [row.end_node for row in loop.measures],
        "least_tension": loop.least_tension.tolist(),
        "end_tension": loop.end_tension.tolist(),
        "steps": loop.steps,
        "broken": {name: list(who) for name, who in loop.broken.items()},
        "unstable": loop.unstable,
        "not_solved": loop.not_solved,
    }


def _describe_margins(margins: Margins, actuators: Sequence[str]) -> dict[str, Any]:
    worst = int(np.argmin(margins.actuator_disk))
    return {
        "is_stable": margins.is_stable,
        "delay": _finite(margins.delay),
        "gain": _finite(margins.gain),
        "stiffness": _finite(margins.stiffness),
        "spectral_radius": margins.radius,
        "all_actuators": _describe_disk(margins.disk),
        "one_actuator": {"name": actuators[worst], **_describe_disk(float(margins.actuator_disk[worst]))},
    }


def _describe_disk(disk: float) -> dict[str, Any]:
    lower, largest = find_gain_range(disk)
    return {"disk": disk, "gain": [lower, _finite(largest)], "phase": find_phase(disk)}


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def find_noise_errors(study: ControlStudy) -> dict[str, Any] | None:
    """Return errors by noise that the linear loop predicts beside simulated ones, None without an estimator.

    Root mean squares of the distance from the motion [m], of the node where the predicted one is largest; the
    simulated one is that of the end and contains all other errors.
    """
    if study.estimator is None:
        return None
    predicted, simulated = study.predicted["estimator"], study.loops["estimator"].end_rms
    node = max(predicted, key=lambda name: predicted[name])
    rms = {"predicted_rms": _finite(predicted[node]), "simulated_rms": _finite(simulated[node])}
    return {"node": node, **rms}


def _describe_estimator(study: ControlStudy) -> dict[str, Any] | None:
    estimator = study.estimator
    if estimator is None:
        return None
    return {
        "measured": list(estimator.sensing.names),
        "noise": estimator.sensing.noise.tolist(),
        "n_states": len(estimator.state_name),
        "disturbances": len(estimator.disturbed),
        "knots": len(estimator.time),
        "residual": estimator.residual,
    }


def _describe_distribution(study: ControlStudy) -> dict[str, float] | None:
    stated = study.mpc or study.distribution
    if stated is None:
        return None
    members = study.loops["open"].run.member_name
    bound = stated.least_tension
    return {name: float(value) for name, value in zip(members, bound, strict=True) if np.isfinite(value)}


def _describe_errors(study: ControlStudy) -> dict[str, Any]:
    stated = study.errors
    start = np.abs(study.drawn[0].coordinate)
    names = study.gains.state_name[: len(start)]
    return {
        "start": dict(zip(names, start.tolist(), strict=True)),
        "stiffness": stated.stiffness_error,
        "gusts": [[vars(gust) for gust in errors.gusts] for errors in study.drawn],
    }


def _describe_words(study: ControlStudy) -> str:
    start = np.abs(study.drawn[0].coordinate)
    angle = study.tuning.scales.is_angle
    clauses = []
    if angle.any() and start[angle].any():
        clauses.append(f"angles off by {_span(np.degrees(start[angle]))} deg at the start")
    if (~angle).any() and start[~angle].any():
        clauses.append(f"coordinates off by {_span(1000 * start[~angle])} mm at the start")
    if study.errors.stiffness_error:
        clauses.append(f"stiffness of cables off by {100 * study.errors.stiffness_error:.4g} %")
    for gust in study.drawn[0].gusts:
        size = float(np.linalg.norm(gust.force))
        clauses.append(f"{size:.4g} N on a node from {gust.start:g} to {gust.end:g} s")
    if study.estimator is not None:
        clauses.append("noise of the sensors")
    return ", ".join(clauses) or "none"


def has_limits(study: ControlStudy) -> bool:
    """Return whether the scene states limits by which loops are judged: tensions, clearance."""
    limits = study.limits
    of_members = np.isfinite([*limits.least_tension, *limits.most_tension])
    return bool(of_members.any()) or limits.clearance > -np.inf


def _describe_limits(study: ControlStudy, loop: LoopResult) -> str:
    """Return the limits that are exceeded at the end, in words."""
    if loop.unstable:
        return f"unstable in {loop.unstable} draws" if loop.unstable > 1 else "unstable in 1 draw"
    broken = [f"{LIMIT_NAMES[name]} not kept" for name in loop.broken]
    return ", ".join(broken) or ("kept" if has_limits(study) else "none stated")


def _range(values: Any) -> str:
    low, high = float(np.min(values)), float(np.max(values))
    return f"{low:.3g}" if len(values) == 1 else f"{low:.3g} to {high:.3g}"


def _span(values: Any) -> str:
    low, high = float(np.min(values)), float(np.max(values))
    return f"{low:.3g}" if high - low < 1e-6 * high else f"{low:.3g} to {high:.3g}"
