"""From the samples of a motion to nodes, tensions, energies, and a verdict."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.integrate.motion import Schedule
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.model.arguments import apply_loads
from tensegrity_codegen.runtime.model.charts import judge_charts
from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.runtime.model.named_inputs import INPUT
from tensegrity_codegen.runtime.model.own_tension import put_own_tensions
from tensegrity_codegen.runtime.model.placement import place_motion
from tensegrity_codegen.runtime.trajectory.balance import balance_energy, find_energy_flow
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import NonFiniteError


def evaluate_trajectory(
    model: Model, raw: RawTrajectory, arguments: Mapping[str, Any], schedule: Schedule | None = None
) -> Trajectory:
    """Return the trajectory with tensions and energies, its status corrected by the energy balance.

    schedule: arguments that change with time; these do work, so the energy balance says nothing then.
    """
    raw, columns = _evaluate_samples(model, raw, arguments, schedule)
    n = raw.state.shape[1] // 2
    q, v = raw.state[:, :n], raw.state[:, n:]
    drift, status, message = None, raw.status, raw.message
    if schedule is None:
        drift, status, message = _judge_energy(
            model, raw, columns["kinetic_energy"], columns["total_energy"], arguments
        )
    if model.has("chart_margin"):
        status, message = judge_charts(model, raw.time, q, status, message)
    manifest = model.manifest
    position, rate = place_motion(model, q, v, arguments)
    return Trajectory(
        time=raw.time,
        coordinate=q,
        velocity=v,
        node_position=position,
        node_velocity=rate,
        member_tension=columns["member_tension"],
        kinetic_energy=columns["kinetic_energy"],
        total_energy=columns["total_energy"],
        energy_drift=drift,
        status=status,
        message=message,
        method=raw.method,
        n_steps=raw.n_steps,
        n_evaluations=raw.n_evaluations,
        step=raw.step,
        error_estimate=raw.error_estimate,
        log=raw.log,
        evidence=raw.evidence,
        why_method=raw.why,
        input=_evaluate_inputs(model, raw.time, arguments, schedule),
        input_name=manifest.input_name,
        node_name=manifest.node_name,
        member_name=manifest.member_name,
        structure=getattr(model, "structure", None),
        node_load=apply_loads(
            model, *({**arguments, **(schedule(float(t)) if schedule else {})} for t in raw.time)
        ),
    )


def _evaluate_inputs(
    model: Model, time: FloatArray, arguments: Mapping[str, Any], schedule: Schedule | None
) -> FloatArray | None:
    """Return the inputs (n_t, n_inputs) at the samples; None where the model takes none."""
    if not any(item.name == INPUT for item in model.manifest.arguments):
        return None
    constant = np.asarray(arguments.get(INPUT, model.nominal(INPUT)), dtype=np.float64).reshape(-1)
    if schedule is None:
        return np.tile(constant, (len(time), 1))
    return np.array([np.reshape(schedule(float(t)).get(INPUT, constant), -1) for t in time], dtype=np.float64)


def _evaluate_samples(
    model: Model, raw: RawTrajectory, arguments: Mapping[str, Any], schedule: Schedule | None
) -> tuple[RawTrajectory, dict[str, FloatArray]]:
    """Return the samples with finite tensions and energies, and these; raises NonFiniteError if none has.

    A run that blows up overflows in the square of its velocities before it does in the velocities.
    """
    names = ("member_tension", "kinetic_energy", "total_energy")
    n = raw.state.shape[1] // 2
    rows: list[list[Any]] = []
    for time, state in zip(raw.time, raw.state, strict=True):
        given = {"coordinate": state[:n], "velocity": state[n:], **arguments}
        given |= schedule(float(time)) if schedule else {}
        try:
            row = [model.compute(name, **given) for name in names]
        except NonFiniteError:
            if not rows:
                raise
            raw = replace(raw, time=raw.time[: len(rows)], state=raw.state[: len(rows)])
            if raw.status == "ok":
                message = f"the energy is not finite after t = {raw.time[-1]:.6g} s: take a smaller step"
                raw = replace(raw, status="unstable", message=message)
            break
        rows.append(row)
    found = dict(zip(names, (np.array(column) for column in zip(*rows, strict=True)), strict=True))
    if raw.tension is not None:
        given = {**arguments, **(schedule(0.0) if schedule else {})}  # their laws do not change with time
        found = put_own_tensions(model, raw.state, raw.tension, raw.tension_member, found, given)
    return raw, found


def _judge_energy(
    model: Model,
    raw: RawTrajectory,
    kinetic: FloatArray,
    total: FloatArray,
    arguments: Mapping[str, Any],
) -> tuple[float | None, str, str]:
    """Return the drift and the status: energy must not grow, and without damping must not shrink.

    Torques and turning forces may bring energy in; then neither is asked.
    """
    n = raw.state.shape[1] // 2
    balance = balance_energy(kinetic, total, raw.state[:, :n])

    def power() -> FloatArray:
        rows = ({"coordinate": state[:n], "velocity": state[n:], **arguments} for state in raw.state)
        return np.array([model.compute("energy_rate", **row) for row in rows])

    conservative, is_driven = map(bool, find_energy_flow(model.manifest, power))
    drift = float(balance.drift) if conservative else None
    if raw.status != "ok":
        return drift, raw.status, raw.message
    return drift, *balance.judge((), raw.time, conservative, is_driven, raw.message)
