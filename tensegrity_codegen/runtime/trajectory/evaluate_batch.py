"""From the samples of a batch to its motions: nodes, tensions, energies, and a verdict on each."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.integrate.raw_results import RawBatch
from tensegrity_codegen.runtime.model.charts import judge_charts
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.trajectory.balance import balance_energy, find_energy_flow
from tensegrity_codegen.runtime.trajectory.batch_trajectory import BatchTrajectory
from tensegrity_codegen.system.arrays import FloatArray


def evaluate_batch(
    model: CompiledModel, raw: RawBatch, arguments: Mapping[str, tuple[FloatArray, bool]], threads: int
) -> BatchTrajectory:
    """Return the motions with tensions and energies, each status corrected by its energy balance.

    arguments: run-time arguments, each with whether it has one row a motion.
    """
    samples = _Samples(model, raw, arguments, threads)
    raw, kinetic, total = samples.drop_overflown(raw)
    manifest, n = model.manifest, raw.state.shape[2] // 2
    drift, ends = _judge(model, raw, samples, kinetic, total)
    return BatchTrajectory(
        time=raw.time,
        coordinate=raw.state[:, :, :n],
        velocity=raw.state[:, :, n:],
        node_position=samples.place("node_position", manifest.stated_position),
        node_velocity=samples.place("node_velocity", np.zeros((len(manifest.node_name), 3))),
        member_tension=samples.compute("member_tension"),
        kinetic_energy=kinetic,
        total_energy=total,
        energy_drift=drift,
        error_estimate=np.full(len(ends), np.nan) if raw.error_estimate is None else raw.error_estimate,
        status=tuple(word for word, _ in ends),
        message=tuple(message for _, message in ends),
        n_reached=raw.n_reached,
        n_steps=raw.n_steps,
        n_rejected=raw.n_rejected,
        n_evaluations=raw.n_evaluations,
        method=raw.method,
        step=raw.step,
        node_name=manifest.node_name,
        member_name=manifest.member_name,
        structure=model.structure,
    )


class _Samples:
    """All samples of a batch as one long batch of states, those that were not reached being NAN."""

    def __init__(
        self,
        model: CompiledModel,
        raw: RawBatch,
        arguments: Mapping[str, tuple[FloatArray, bool]],
        threads: int,
    ) -> None:
        n_batch, n_t, n_states = raw.state.shape
        self.model, self.threads, self.shape = model, threads, (n_batch, n_t)
        self.arguments = arguments
        self.is_there = np.arange(n_t) < raw.n_reached[:, None]
        flat = raw.state.reshape(-1, n_states)
        self.given: dict[str, Any] = {
            name: np.repeat(array, n_t, axis=0) if is_batched else array
            for name, (array, is_batched) in arguments.items()
        }
        self.given["coordinate"] = np.ascontiguousarray(flat[:, : n_states // 2])
        self.given["velocity"] = np.ascontiguousarray(flat[:, n_states // 2 :])

    def compute(self, quantity: str) -> FloatArray:
        """Return a quantity at all samples, (n_batch, n_t, ...), NAN where it is not finite."""
        function = self.model.function(quantity)
        if any(name in ("coordinate", "velocity") or self._is_batched(name) for name in function.arguments):
            found, _ = self.model.compute_batch(
                quantity, threads=self.threads, on_error="status", **self.given
            )
        else:
            found = np.broadcast_to(self.model.compute(quantity, **self.given), self.shape).ravel()
        return self._mask(found.reshape(*self.shape, *function.spec.shape))

    def _mask(self, values: FloatArray) -> FloatArray:
        """Return values (n_batch, n_t, ...) with NAN where there is no sample."""
        rows = self.is_there.reshape(*self.shape, *(1,) * (values.ndim - 2))
        return np.where(rows, values, np.nan)

    def _is_batched(self, name: str) -> bool:
        return name in self.arguments and self.arguments[name][1]

    def drop_overflown(self, raw: RawBatch) -> tuple[RawBatch, FloatArray, FloatArray]:
        """Return the batch and its energies, runs ending before the first sample whose energy is not finite.

        A run that blows up overflows in the square of its velocities before it does in the velocities.
        """
        kinetic, total = self.compute("kinetic_energy"), self.compute("total_energy")
        is_good = np.isfinite(kinetic) & np.isfinite(total)
        n_good = np.where(is_good | ~self.is_there, self.shape[1], np.arange(self.shape[1])).min(axis=1)
        status, message = list(raw.status), list(raw.message)
        for k in np.flatnonzero(n_good < raw.n_reached):
            if status[k] == "ok":
                after = raw.time[max(n_good[k] - 1, 0)]
                status[k] = "unstable"
                message[k] = f"the energy is not finite after t = {after:.6g} s: take a smaller step"
        n_reached = np.minimum(raw.n_reached, n_good)
        self.is_there = np.arange(self.shape[1]) < n_reached[:, None]
        changed = replace(
            raw,
            state=self._mask(raw.state),
            n_reached=n_reached,
            status=tuple(status),
            message=tuple(message),
        )
        return changed, self._mask(kinetic), self._mask(total)

    def place(self, quantity: str, stated: FloatArray) -> FloatArray:
        """Return positions or velocities of all nodes, (n_batch, n_t, n_nodes, 3); `stated` of held ones."""
        manifest = self.model.manifest
        result = np.tile(stated, (*self.shape, 1, 1))
        axes, places = list(manifest.axes), manifest.coordinate_place
        if not manifest.coordinate_node_axis:
            result[..., axes] = self.compute(quantity)
            return self._mask(result)
        anchors = self.arguments.get("anchor_position")
        changeable = next((item for item in manifest.arguments if item.name == "anchor_position"), None)
        if quantity == "node_position" and anchors is not None and changeable is not None:
            rows = [manifest.node_name.index(name) for name in changeable.over]
            array, is_batched = anchors
            result[:, :, np.array(rows)[:, None], axes] = array[:, None] if is_batched else array
        name = "coordinate" if quantity == "node_position" else "velocity"
        result[:, :, places[:, 0], places[:, 1]] = self.given[name].reshape(*self.shape, -1)
        return self._mask(result)


def _judge(
    model: CompiledModel, raw: RawBatch, samples: _Samples, kinetic: FloatArray, total: FloatArray
) -> tuple[FloatArray, list[tuple[str, str]]]:
    """Return energy drift, and status and message, of every motion."""
    flow = find_energy_flow(model.manifest, lambda: np.nan_to_num(samples.compute("energy_rate")))
    conservative, is_driven = (np.broadcast_to(word, samples.shape[0]) for word in flow)
    n = raw.state.shape[2] // 2
    balance = balance_energy(kinetic, total, raw.state[:, :, :n])
    ends = list(zip(raw.status, raw.message, strict=True))
    for k, (status, message) in enumerate(ends):
        if status == "ok":
            ends[k] = balance.judge(k, raw.time, bool(conservative[k]), bool(is_driven[k]), message)
        if model.has("chart_margin") and raw.n_reached[k]:
            ends[k] = judge_charts(model, raw.time, raw.state[k, : raw.n_reached[k], :n], *ends[k])
    return np.where(conservative, balance.drift, np.nan), ends
