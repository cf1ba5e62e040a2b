"""From the samples of motions to nodes, tensions and energies, and a verdict on each motion.

One motion is a batch of one, whose samples are computed one after the other.

Tensions that an integrator found as unknowns of their own stand in place of those that follow from lengths: a
stiff member's extension is next to rounding beside its length, and mu (l - rho) multiplies that rounding, and
the error of the positions, by mu. The strain energy follows from them, (t - c l')^2 / (2 mu), none in a rigid
member.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.integrate.motion import Schedule
from tensegrity_codegen.runtime.integrate.raw_results import RawBatch, RawTrajectory
from tensegrity_codegen.runtime.model.arguments import INPUT, apply_ground, apply_loads
from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import judge_charts, place_nodes, place_velocities
from tensegrity_codegen.runtime.trajectory.simulation_quantities import CONTACT_QUANTITIES
from tensegrity_codegen.runtime.trajectory.trajectory import (
    BatchTrajectory,
    ContactSamples,
    MotionEvent,
    Trajectory,
)
from tensegrity_codegen.structure.ground import ENERGY_STATES
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.manifest import VISCOUS_WORK, Manifest

# Energy may change by this fraction of the largest kinetic energy before a run is called wrong.
ENERGY_TOLERANCE = 0.1
# Change of coordinates over the largest of them, below which nothing moves: a hundredth of the default
# absolute tolerance. Multipliers of rigid bars make that of rounding: 1e-13 in a tenth of a second.
MIN_RELATIVE_MOTION = 1e-11
COLUMNS = ("member_tension", "kinetic_energy", "total_energy")
# Change of a rigid member's tension over that of the elastic members beside it, at most.
MAX_AMPLIFICATION = 10.0


@dataclass(frozen=True)
class EnergyBalance:
    """The balance of energy of each motion."""

    drift: FloatArray  # (...), largest change of the total energy over the largest kinetic energy
    has_grown: NDArray[np.bool_]  # (..., n_t), too much energy by each sample
    has_lost: NDArray[np.bool_]  # (...), too little at some sample

    def judge(
        self, place: int | tuple[()], time: FloatArray, conservative: bool, is_driven: bool, message: str
    ) -> tuple[str, str]:
        """Return status and message of the motion at `place`, whose own message is `message`."""
        grown = self.has_grown[place]
        if grown.any() and not is_driven:
            when = time[int(np.argmax(grown))]
            return "unstable", f"the total energy has grown by t = {when:.6g} s: take a smaller step"
        if conservative and self.has_lost[place]:
            return "inaccurate", "energy is lost that nothing takes: take a smaller step"
        return "ok", message


def balance_energy(kinetic: FloatArray, total: FloatArray, coordinate: FloatArray) -> EnergyBalance:
    """Return the balance of energies (..., n_t) [J]; none if coordinates move by rounding alone."""
    change = total - total[..., :1]
    # Below this the change is rounding of the potential energy, not motion.
    floor = 1e-9 * np.fmax.reduce(np.abs(total - kinetic), axis=-1)
    scale = np.fmax(np.fmax.reduce(kinetic, axis=-1), floor)
    scale = np.where(scale == 0.0, 1.0, scale)
    # Motions that keep their coordinates up to rounding.
    axes = (-2, -1)
    moved = np.fmax.reduce(np.abs(coordinate - coordinate[..., :1, :]), axis=axes, initial=0.0)
    size = np.fmax.reduce(np.abs(coordinate), axis=axes, initial=0.0)
    scale = np.where(moved <= MIN_RELATIVE_MOTION * size, np.inf, scale)
    return EnergyBalance(
        drift=np.asarray(np.fmax.reduce(np.abs(change), axis=-1) / scale),
        has_grown=change > ENERGY_TOLERANCE * scale[..., None],
        has_lost=np.asarray(np.fmax.reduce(-change, axis=-1) > ENERGY_TOLERANCE * scale),
    )


def find_energy_flow(
    manifest: Manifest, power: Callable[[], FloatArray]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return whether each motion keeps its energy (...), and whether something drives it (...).

    power: energy_rate (..., n_t) [W] at the samples, called only where it depends on something. A model
    without `energy_rate` keeps its energy if its accelerations depend on no velocity. Of contacts
    samples tell nothing: they lose energy in short impacts, and a moving belt brings some in.
    """
    needed = {spec.quantity: spec.arguments for spec in manifest.functions}
    if manifest.motor_name:  # which bring energy in
        return np.array(False), np.array(True)
    if manifest.has_contacts and needed.get("energy_rate", ("velocity",)):
        return np.array(False), np.array(True)
    if "energy_rate" not in needed:
        return np.array("velocity" not in needed["acceleration"]), np.array(False)
    if not needed["energy_rate"]:
        return np.array(True), np.array(False)
    rates = power()
    return ~np.any(rates, axis=-1), np.max(rates, axis=-1) > 0.0


def evaluate_trajectory(
    model: CompiledModel,
    raw: RawTrajectory,
    arguments: Mapping[str, Any],
    schedule: Schedule | None = None,
    events: tuple[MotionEvent, ...] = (),
) -> Trajectory:
    """Return the trajectory with tensions and energies, its status corrected by the energy balance."""
    # The motion as a batch of one.
    batch = RawBatch(
        time=raw.time,
        state=raw.state[None],
        n_reached=np.array([len(raw.time)]),
        status=(raw.status,),
        message=(raw.message,),
        method=raw.method,
        n_steps=np.array([raw.n_steps]),
        n_rejected=np.array([-1]),
        n_evaluations=np.array([raw.n_evaluations]),
        step=raw.step,
        internal=None if raw.internal is None else raw.internal[None],
    )
    samples = _Samples(model, batch, {name: (value, False) for name, value in arguments.items()}, schedule)
    motions = samples.evaluate(raw)
    count = int(motions.n_reached[0])
    if not count:
        for name in COLUMNS:
            model.compute(name, **samples.sample(0, 0))
    # Arguments at the samples.
    times = motions.time[:count]
    values = [{**arguments, **(schedule(float(time)) if schedule else {})} for time in times]
    inputs = None
    if any(argument.name == INPUT for argument in model.manifest.arguments):
        rows = [np.reshape(sample_values.get(INPUT, model.nominal(INPUT)), -1) for sample_values in values]
        inputs = np.array(rows, dtype=np.float64)
    return motions.motion(
        0,
        error_estimate=raw.error_estimate,
        log=raw.log,
        evidence=raw.evidence,
        why_method=raw.why,
        events=events,
        input=inputs,
        input_name=model.manifest.input_name,
        node_load=apply_loads(model, *values),
        contacts=_find_contacts(samples, motions, values),
        columns=None if raw.columns is None else raw.columns[:count],
        column_name=() if raw.columns is None else model.manifest.column_name,
    )


def _find_contacts(
    samples: "_Samples", motions: BatchTrajectory, values: Sequence[Mapping[str, Any]]
) -> ContactSamples | None:
    """Return the contacts at the samples of a motion, given its arguments; None if nothing tells."""
    manifest = samples.model.manifest
    if not manifest.contact_name or not all(samples.model.has(name) for name in CONTACT_QUANTITIES):
        return None
    count = int(motions.n_reached[0])
    force, depth = (samples.compute(name)[0, :count] for name in CONTACT_QUANTITIES)
    forces = np.zeros((*force.shape[:2], 3))
    forces[..., list(manifest.axes)] = force
    nodes = [manifest.node_name.index(name) for name in manifest.contact_name]
    grounds = [apply_ground(samples.model, sample_values) for sample_values in values]
    return ContactSamples(
        motions.time[:count],
        manifest.contact_name,
        motions.node_position[0, :count, nodes].swapaxes(0, 1),
        forces,
        depth.reshape(count, -1),
        np.array([0.0 if ground is None else ground.friction for ground in grounds]),
    )


def evaluate_batch(
    model: CompiledModel, raw: RawBatch, arguments: Mapping[str, tuple[FloatArray, bool]], threads: int
) -> BatchTrajectory:
    """Return the motions with tensions and energies, each status corrected by its energy balance."""
    return _Samples(model, raw, arguments, threads=threads).evaluate()


def select_motion(arguments: Mapping[str, tuple[Any, bool]], k: int) -> dict[str, Any]:
    """Return the arguments of motion k; each is given with whether it has one row a motion."""
    return {name: array[k] if is_batched else array for name, (array, is_batched) in arguments.items()}


class _Samples:
    """All samples of motions as one batch of states, NAN if not reached; threads: 0 for single calls."""

    def __init__(
        self,
        model: Any,
        raw: RawBatch,
        arguments: Mapping[str, tuple[Any, bool]],
        schedule: Schedule | None = None,
        threads: int = 0,
    ) -> None:
        n_batch, n_t, _ = raw.state.shape
        self.model, self.raw, self.arguments, self.schedule = model, raw, arguments, schedule
        self.threads, self.shape = threads, (n_batch, n_t)
        self.is_there = np.arange(n_t) < raw.n_reached[:, None]
        self.coordinate, self.velocity = np.split(raw.state, 2, axis=2)

    def evaluate(self, run: RawTrajectory | None = None) -> BatchTrajectory:
        """Return the motions; run: of the only one, with tensions that were unknowns of their own."""
        # Tensions and energies, up to the last finite sample.
        columns = {name: self.compute(name) for name in COLUMNS}
        self._drop_overflown(columns)
        columns = {name: self._mask(values) for name, values in columns.items()}
        if run is not None and run.tension is not None:
            self._put_own_tensions(run, run.tension, columns)
        kinetic, total = columns["kinetic_energy"], columns["total_energy"]
        drift, ends = self._judge(kinetic, total)
        raw, manifest = self.raw, self.model.manifest
        return BatchTrajectory(
            time=raw.time,
            coordinate=self.coordinate,
            velocity=self.velocity,
            node_position=self._place("node_position", manifest.stated_position),
            node_velocity=self._place("node_velocity", np.zeros((len(manifest.node_name), 3))),
            **columns,
            energy_drift=drift,
            error_estimate=np.full(len(ends), np.nan) if raw.error_estimate is None else raw.error_estimate,
            status=tuple(status for status, _ in ends),
            message=tuple(message for _, message in ends),
            n_reached=raw.n_reached,
            n_steps=raw.n_steps,
            n_rejected=raw.n_rejected,
            n_evaluations=raw.n_evaluations,
            method=raw.method,
            step=raw.step,
            node_name=manifest.node_name,
            member_name=manifest.member_name,
            structure=getattr(self.model, "structure", None),
            internal=raw.internal,
            internal_name=manifest.internal_name,
            bodies=manifest.body_places,
        )

    def compute(self, quantity: str) -> FloatArray:
        """Return a quantity at all samples, (n_batch, n_t, ...), NAN if it is not finite."""
        if not self.threads:
            rows, count = self._rows, int(self.raw.n_reached[0])
            found = self.model.compute_rows(quantity, rows, select_motion(self.arguments, 0), count)
            found = found.reshape(1, count, *self.model.function(quantity).spec.shape)
            missing = np.full((1, self.shape[1] - count, *found.shape[2:]), np.nan)
            return np.concatenate([found, missing], axis=1) if missing.size else found
        spec = next(function for function in self.model.manifest.functions if function.quantity == quantity)
        batched = {name for name, (_, is_batched) in self.arguments.items() if is_batched}
        if batched.union(("coordinate", "velocity")).isdisjoint(spec.arguments):  # the same for all samples
            shared = {name: array for name, (array, _) in self.arguments.items() if name not in batched}
            return self._mask(np.broadcast_to(self.model.compute(quantity, **shared), self.shape))
        batch = {
            name: np.repeat(array, self.shape[1], axis=0) if is_batched else array
            for name, (array, is_batched) in self.arguments.items()
        }
        states = {"coordinate": self.coordinate, "velocity": self.velocity}
        if self.raw.internal is not None:
            states["internal"] = self.raw.internal
        for name, array in states.items():
            batch[name] = np.ascontiguousarray(array.reshape(-1, array.shape[2]))
        values, _ = self.model.compute_batch(quantity, threads=self.threads, on_error="status", **batch)
        return self._mask(values.reshape(*self.shape, *spec.shape))

    @property
    def _rows(self) -> dict[str, FloatArray]:
        """What changes from sample to sample of the only motion, (n_reached, ...) each."""
        reached = slice(0, int(self.raw.n_reached[0]))
        rows = {"coordinate": self.coordinate[0, reached], "velocity": self.velocity[0, reached]}
        if self.raw.internal is not None:
            rows["internal"] = self.raw.internal[0, reached]
        if self.schedule:
            changed = [self.schedule(float(time)) for time in self.raw.time[reached]]
            rows |= {
                name: np.array([values[name] for values in changed], dtype=np.float64) for name in changed[0]
            }
        return rows

    def sample(self, k: int, row: int) -> dict[str, Any]:
        """Return the arguments of a function at one sample of motion k."""
        n, state = self.coordinate.shape[2], self.raw.state[k, row]
        changed = self.schedule(float(self.raw.time[row])) if self.schedule else {}
        values = {
            **select_motion(self.arguments, k),
            "coordinate": state[:n],
            "velocity": state[n:],
            **changed,
        }
        return values if self.raw.internal is None else {**values, "internal": self.raw.internal[k, row]}

    def _mask(self, values: FloatArray) -> FloatArray:
        """Return values (n_batch, n_t, ...) with NAN if there is no sample."""
        if self.is_there.all():
            return values
        rows = self.is_there.reshape(*self.shape, *(1,) * (values.ndim - 2))
        return np.where(rows, values, np.nan)

    def _drop_overflown(self, columns: Mapping[str, FloatArray]) -> None:
        """End runs before the first sample whose tensions or energies overflow and are not finite."""
        if self.is_there.all() and all(np.isfinite(values).all() for values in columns.values()):
            return
        raw, n_t = self.raw, self.shape[1]
        is_good = np.all(
            [np.isfinite(v).reshape(*self.shape, -1).all(axis=2) for v in columns.values()], axis=0
        )
        n_good = np.where(is_good | ~self.is_there, n_t, np.arange(n_t)).min(axis=1)
        status, message = list(raw.status), list(raw.message)
        for k in np.flatnonzero(n_good < raw.n_reached):
            if status[k] == "ok":
                after = raw.time[max(n_good[k] - 1, 0)]
                status[k] = "unstable"
                message[k] = f"the energy is not finite after t = {after:.6g} s: take a smaller step"
        n_reached = np.minimum(raw.n_reached, n_good)
        self.raw = replace(raw, n_reached=n_reached, status=tuple(status), message=tuple(message))
        self.is_there = np.arange(n_t) < n_reached[:, None]
        self.coordinate, self.velocity = self._mask(self.coordinate), self._mask(self.velocity)

    def _put_own_tensions(
        self, run: RawTrajectory, tension: FloatArray, columns: Mapping[str, FloatArray]
    ) -> None:
        """Put the tensions that the integrator found into the columns of the only motion, in place."""
        reached = slice(0, int(self.raw.n_reached[0]))
        arguments = {name: value for name, (value, _) in self.arguments.items()}
        arguments |= self.schedule(0.0) if self.schedule else {}  # their laws do not change with time
        rows = {name: array[0, reached] for name, array in columns.items()}
        corrected = put_own_tensions(
            self.model, self.raw.state[0, reached], tension, run.tension_member, rows, arguments
        )
        for name, array in corrected.items():
            columns[name][0, reached] = array

    def _place(self, quantity: str, stated: FloatArray) -> FloatArray:
        """Return positions or velocities of all nodes, (n_batch, n_t, n_nodes, 3); `stated` of held ones."""
        manifest = self.model.manifest
        result = np.tile(stated, (*self.shape, 1, 1))
        axes, node_axis = list(manifest.axes), manifest.coordinate_place
        if not manifest.coordinate_node_axis:
            result[..., axes] = self.compute(quantity)
            return self._mask(result)
        anchors = self.arguments.get("anchor_position")
        changeable = manifest.find_argument("anchor_position")
        if quantity == "node_position" and anchors is not None and changeable is not None:
            rows = np.array([manifest.node_name.index(name) for name in changeable.over])
            array, is_batched = anchors
            array = array[:, None] if is_batched else np.reshape(array, changeable.shape)
            result[:, :, rows[:, None], axes] = array
        free = self.coordinate if quantity == "node_position" else self.velocity
        result[:, :, node_axis[:, 0], node_axis[:, 1]] = free
        for body in manifest.body_places:
            body.attach(result)
        return self._mask(result)

    def _find_work(self) -> FloatArray | None:
        """Return the work that changed the energy by each sample, (n_batch, n_t) [J]; None if unknown."""
        if self.raw.internal is None:
            return None
        is_energy = np.isin(self.model.manifest.internal_name, ENERGY_STATES)
        if not is_energy.any():
            return None
        work: FloatArray = self.raw.internal[..., is_energy].sum(axis=-1)
        return self._mask(work - work[:, :1])

    def _find_power(self) -> FloatArray:
        """Return the power that changes the energy, without that of members, (n_batch, n_t) [W]."""
        power = self.compute("energy_rate")
        for name in ("plastic_power", "viscous_power"):
            power = power - self.compute(name) if self.model.has(name) else power
        return np.nan_to_num(power)

    def _judge(self, kinetic: FloatArray, total: FloatArray) -> tuple[FloatArray, list[tuple[str, str]]]:
        """Return energy drift, and status and message, of every motion.

        Energy must not grow, and without damping must not shrink. Torques and turning forces may bring energy
        in; then neither is asked, as under a schedule. Work that a motion integrates is taken off.
        """
        raw, model = self.raw, self.model
        ends = list(zip(raw.status, raw.message, strict=True))
        drift = np.full(len(ends), np.nan)
        if self.schedule is None:
            work = self._find_work()
            total = total if work is None else total - work
            if model.has("plastic_work"):  # known from the internal states
                total = total - self.compute("plastic_work")
            if raw.internal is not None and VISCOUS_WORK in model.manifest.internal_name:
                viscous_work = raw.internal[..., model.manifest.internal_name.index(VISCOUS_WORK)]
                total = total - self._mask(viscous_work)
            flow = find_energy_flow(model.manifest, self._find_power)
            flow = flow if work is None else (np.array(True), np.array(False))
            conservative, is_driven = (np.broadcast_to(flag, len(ends)) for flag in flow)
            balance = balance_energy(kinetic, total, self.coordinate)
            drift = np.where(conservative, balance.drift, np.nan)
            for k, (status, message) in enumerate(ends):
                if status == "ok":
                    ends[k] = balance.judge(k, raw.time, bool(conservative[k]), bool(is_driven[k]), message)
        if model.has("chart_margin"):
            for k in np.flatnonzero(raw.n_reached).tolist():
                reached = slice(0, int(raw.n_reached[k]))
                ends[k] = judge_charts(model, raw.time[reached], self.coordinate[k, reached], *ends[k])
        return drift, ends


def put_own_tensions(
    model: Model,
    state: FloatArray,
    tension: FloatArray,
    members: Sequence[int],
    columns: Mapping[str, FloatArray],
    arguments: Mapping[str, Any],
) -> dict[str, FloatArray]:
    """Return member_tension and total_energy (n_t, ...) with these tensions (n_t, len(members)) [N]."""
    chosen = list(members)
    law = model.compute("member_law", **arguments)[chosen]
    mu, damping, rest_length = law[:, 1], law[:, 2], law[:, 0]
    if not mu.any():
        return dict(columns)
    member_tension, total_energy = columns["member_tension"].copy(), columns["total_energy"].copy()
    for row, (x, tensions) in enumerate(zip(state, tension[: len(state)], strict=True)):
        length, rate = _lengths(model, x, chosen, arguments)
        elastic = np.divide(tensions - damping * rate, mu, out=np.zeros_like(mu), where=mu > 0)
        by_length = length - rest_length
        total_energy[row] += float(0.5 * np.sum(mu * (elastic * elastic - by_length * by_length)))
        member_tension[row, chosen] = _choose(tensions, member_tension[row, chosen], mu)
    return {**columns, "member_tension": member_tension, "total_energy": total_energy}


def _choose(own: FloatArray, by_state: FloatArray, mu: FloatArray) -> FloatArray:
    """Return the more exact tensions (n_members,) [N]; those that follow from states only of rigid members.

    They carry the rounding of lengths of stiff members, which shows as the difference of their two tensions.
    A difference of a rigid member's that is far larger is an error of the method's own.
    """
    difference = np.abs(own - by_state)
    rounding = float(difference[mu > 0].sum())
    return np.where((mu == 0) & (difference > MAX_AMPLIFICATION * rounding), by_state, own)


def _lengths(
    model: Model, x: FloatArray, members: Sequence[int], arguments: Mapping[str, Any]
) -> tuple[FloatArray, FloatArray]:
    """Return lengths [m] and their rates [m/s] of some members at the state x."""
    n = len(x) // 2
    ends = np.array(model.manifest.connectivity)[list(members)]
    position = place_nodes(model, x[:n], arguments.get("anchor_position"), arguments=arguments)
    velocity = place_velocities(model, x[:n], x[n:], arguments=arguments)
    vector = position[ends[:, 0]] - position[ends[:, 1]]
    length = np.sqrt(np.sum(vector * vector, axis=1))
    along = np.sum(vector * (velocity[ends[:, 0]] - velocity[ends[:, 1]]), axis=1)
    return length, along / length
