"""Motions as functions with derivatives: forward by columns beside them, backward by the adjoint in C."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.learning.derivatives.differentiable import Arrays, Differentiable, Rows, Shape
from tensegrity_codegen.runtime.integrate.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.integrate.adjoint import directed_shapes
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.model.arguments import check_parameter_values
from tensegrity_codegen.runtime.model.interface import require_quantities
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.simulate.gradient import (
    INPUT_SIZE,
    OBSERVED,
    START,
    motion_gradient,
)
from tensegrity_codegen.runtime.simulate.motion_input import find_start, read_motion
from tensegrity_codegen.runtime.trajectory.evaluate import evaluate_trajectory
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.sweeps.fitting.keyed_motion import MEANINGLESS, MotionSlopes
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance, check_names
from tensegrity_codegen.system.errors import ConvergenceError, InvalidValueError, check_choice
from tensegrity_codegen.tables.quantities import OF_MOTIONS_BOTH_WAYS

# Of the largest results and derivatives so far, weighed: a difference of both ways that is rounding.
ROUNDING = 1e-10


class MotionFunction(Differentiable):
    """Quantities at the samples of a motion, (n_t, ...), of its start, run-time parameters and inputs.

    t_end, samples, method, rtol, schedule: as of `simulate`; what a schedule names is an argument, of the
    shape of its knots. outputs: of START and OBSERVED. Raises FormulationError for a library without
    derivatives of motions, UnknownNameError for a method that it lacks, ConvergenceError where a motion
    fails, or its derivative along all numbers is another backward than forward.
    """

    def __init__(
        self,
        model: CompiledModel,
        t_end: float,
        *,
        samples: int | ArrayLike = 2,
        outputs: Sequence[str] = START[:2],
        method: str = "rk853",
        rtol: float = 1e-8,
        schedule: Profile | None = None,
        threads: int = 1,
        on_error: str = "raise",
    ) -> None:
        super().__init__(model, threads, on_error)
        call = 'compile_scene(..., for_="motion_derivatives")'
        require_quantities(model, OF_MOTIONS_BOTH_WAYS, f"derivatives of motions need: {call}")
        check_instance(schedule, (Profile, type(None)), "schedule", "a Profile, or None")
        methods = [spec.name for spec in model.manifest.integrators if spec.adjoint_work]
        check_choice(method, methods, f"method of this library ({call[:-1]}, method=...))", "method")
        self.schedule, self.stepping = schedule, Stepping(control="steps").with_method(method, rtol)
        times = read_motion(model, self.stepping, t_end, samples, None, schedule, None, None).sample_time
        self.options: dict[str, Any] = {"t_end": t_end, "samples": times, "method": method, "rtol": rtol}
        manifest, self.knots = model.manifest, {} if schedule is None else dict(schedule.values)
        self.known = {argument.name: argument.shape for argument in manifest.arguments}
        self.directed = tuple(directed_shapes(manifest))
        self.inputs = {
            name: self.known[name] for name in (*START, *self.directed) if np.prod(self.known.get(name, (0,)))
        }
        if set(self.knots) & set(manifest.input_name):
            self.inputs.pop("input", None)
        self.inputs |= {name: value.shape for name, value in self.knots.items()}
        sizes = (*[(len(manifest.coordinate_name),)] * 2, (len(manifest.internal_name),))
        shapes: dict[str, Shape] = dict(zip(START, sizes, strict=True))
        shapes |= dict.fromkeys(OBSERVED[:2], (len(manifest.node_name), 3))
        shapes |= dict.fromkeys(OBSERVED[2:], (len(manifest.member_name),))
        for name in check_names(outputs, "outputs"):
            check_choice(name, shapes, "quantity of a motion", "outputs")
            self.outputs[name] = (len(times), *shapes[name])

    def _evaluate(self, values: Rows, count: int) -> Rows:
        def run(values: Arrays) -> dict[str, FloatArray]:
            return self._observe(*self._integrate(values, {}))

        return self._run_each(run, [values], count, self.outputs)

    def _push(self, values: Rows, tangents: Rows, count: int) -> Rows:
        def run(values: Arrays, tangents: Arrays) -> dict[str, FloatArray]:
            raw, motion = self._integrate(values, tangents)
            trajectory = evaluate_trajectory(self.model, raw, motion.arguments, motion.schedule)
            return self._differentiate(trajectory, values, tangents)

        return self._run_each(run, [values, tangents], count, self.outputs)

    def _pull(self, values: Rows, weights: Rows, count: int) -> Rows:
        shapes = {name: self.inputs[name] for name in values}
        return self._run_each(self._go_back, [values, weights], count, shapes)

    def _run_each(
        self, run: Callable[..., Arrays], groups: list[Rows], count: int, shapes: Mapping[str, Shape]
    ) -> Rows:
        """Return rows (count, *shape) by name of what `run` makes of each row of groups, on threads."""

        def run_one(k: int) -> Arrays:
            rows = [{name: rows[k % len(rows)] for name, rows in group.items()} for group in groups]
            try:
                check_parameter_values(self.model.manifest, rows[0])
                return run(*rows)
            except (ConvergenceError, InvalidValueError):
                if self.on_error == "raise":
                    raise
                return {}

        with ThreadPoolExecutor(self.threads) as pool:  # the calls into C hold no lock of Python's
            results = list((map if self.threads == 1 else pool.map)(run_one, range(count)))
        return {
            name: np.stack([row.get(name, np.full(shape, np.nan)) for row in results])
            for name, shape in shapes.items()
        }

    def _give(self, values: Arrays, tangents: Arrays) -> dict[str, Any]:
        """Return start, arguments and schedule of `simulate`, with the column along tangents."""
        arguments: dict[str, Any] = dict(values)
        start = {name: arguments.pop(name, None) for name in START[:2]}
        columns = {}
        for name, rows in (("column", START), ("direction", self.directed)):
            if tangents and name in self.known:  # otherwise zero, as in the library
                columns[name] = _stack(tangents, rows, self.known)
        schedule = self.schedule
        if schedule is not None:
            courses = {name: arguments.pop(name, value) for name, value in self.knots.items()}
            if "direction" in columns:
                names = self.model.manifest.input_name
                constant = np.ravel(columns.pop("direction"))
                courses["direction"] = np.tile(constant, (len(schedule.time), 1))[..., None]
                for k in range(len(schedule.time)):
                    at_knot = {name: tangents[name][k] for name in self.knots if name in tangents}
                    at_knot["input"] = np.array([at_knot.get(name, 0.0) for name in names])
                    courses["direction"][k] += _stack(at_knot, self.directed, self.known)
            schedule = Profile(schedule.time, courses, schedule.kind)
        return {**start, "arguments": arguments | columns, "schedule": schedule}

    def _integrate(self, values: Arrays, tangents: Arrays) -> tuple[RawTrajectory, Motion]:
        """Return the samples of a motion with a column along tangents, and the motion."""
        inputs = self._give(values, tangents)
        start, arguments = (inputs["coordinate"], inputs["velocity"]), inputs["arguments"]
        times, schedule = self.options["samples"], inputs["schedule"]
        if schedule is None:
            motion = Motion(self.model, find_start(self.model, *start, arguments), times, arguments)
        else:
            t_end = self.options["t_end"]
            motion = read_motion(self.model, self.stepping, t_end, times, arguments, schedule, *start)
        raw = integrate_adaptive(motion, self.stepping)  # the steps of gradients
        if raw.status != "ok":
            raise ConvergenceError(f"the motion fails: {raw.message}", where=self.where)
        return raw, motion

    def _observe(self, raw: RawTrajectory, motion: Motion) -> dict[str, FloatArray]:
        n = raw.state.shape[1] // 2
        states = dict(zip(START, (raw.state[:, :n], raw.state[:, n:], raw.internal), strict=True))
        further = [name for name in self.outputs if name not in states]
        if further:  # which take longer than the motion
            trajectory = evaluate_trajectory(self.model, raw, motion.arguments, motion.schedule)
            run = MotionSlopes(self.model, trajectory, {}, None, {})
            states |= {name: run.find(name) for name in further}
        return {name: np.asarray(states[name]) for name in self.outputs}

    def _differentiate(self, motion: Trajectory, values: Arrays, tangents: Arrays) -> dict[str, FloatArray]:
        """Return the derivatives of the outputs along the column of a motion."""
        inputs = self._give(values, tangents)
        arguments, schedule = inputs["arguments"], inputs["schedule"]
        moved = {name: tangents[name][..., None] for name in ("anchor_position",) if name in tangents}
        direction = schedule if schedule is not None and "direction" in schedule.values else None
        slopes = MotionSlopes(self.model, motion, arguments, direction, moved)
        n = len(self.model.manifest.coordinate_name)
        states = dict(zip(START, np.split(slopes.columns, [n, 2 * n], axis=1), strict=True))
        results = {name: states[name] if name in states else getattr(slopes, name) for name in self.outputs}
        return {name: array[..., 0] for name, array in results.items()}

    def _go_back(self, values: Arrays, weights: Arrays) -> dict[str, FloatArray]:
        """Return the gradient of weighed outputs, compared with that of the column along all numbers."""
        draw, way = np.random.default_rng(0), {}
        weights = {name: weight for name, weight in weights.items() if weight.size}  # of internal states
        for name, value in values.items():
            sizes = np.full(value.shape, np.abs(value).max(initial=0.0) or INPUT_SIZE)
            if name not in (*START, "input", *self.knots):  # numbers of one kind may have different sizes
                sizes = np.where(value == 0.0, sizes, np.abs(value))
            way[name] = sizes * draw.choice([-1.0, 1.0], value.shape)
        inputs = self._give(values, way)
        results = motion_gradient(
            self.model, lambda motion: (0.0, weights), **self.options, **inputs, check=False
        )
        by = {name: results.knots[name] if name in self.knots else results.by[name] for name in values}
        # Both ways give the same, or steps are too long for derivatives.
        column = self._differentiate(results.motion, values, way)
        forward = sum(float((weights[name] * column[name]).sum()) for name in weights)
        products = {name: by[name].reshape(value.shape) * way[name] for name, value in values.items()}
        backward, size = (
            sum(float(f(product).sum()) for product in products.values()) for f in (np.asarray, np.abs)
        )
        rounding, run = 0.0, MotionSlopes(self.model, results.motion, {}, None, {})
        for name, weight in weights.items():
            flat = [np.abs(x).reshape(len(x), -1) for x in (weight, column[name], run.find(name))]
            largest = np.maximum.accumulate(flat[1].max(axis=1) + flat[2].max(axis=1))
            rounding += ROUNDING * float(flat[0].sum(axis=1) @ largest)
        if not abs(forward - backward) - rounding <= MEANINGLESS * size:
            raise ConvergenceError(
                "the derivative of the motion means nothing: backward it is another than forward",
                where=self.where,
                evidence={"along a change of all numbers": f"{backward:.3g} and {forward:.3g}"},
                hint="a smaller rtol, or a shorter motion",
            )
        return by


def _stack(values: Arrays, names: tuple[str, ...], shapes: Mapping[str, Shape]) -> FloatArray:
    """Return values of these arguments, zero where there are none, as one column (n, 1)."""
    products = [np.ravel(values.get(name, np.zeros(shapes[name]))) for name in names if name in shapes]
    return np.concatenate([np.zeros(0), *products])[:, None]
