"""The controller of the unchanged scene of a sweep, and the simulated closed loop of each case with it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tensegrity_codegen.analyses.cases.quantities import GUST, GUST_TIME, build_no_gust
from tensegrity_codegen.control.embedded.closed_loop import CompiledLoop
from tensegrity_codegen.control.embedded.parts import ControllerParts
from tensegrity_codegen.control.embedded.write import ControllerFiles
from tensegrity_codegen.control.feedback.design.gains import Sensing
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorLimits, find_bounds
from tensegrity_codegen.control.feedback.loop.control_run import ControlRun
from tensegrity_codegen.control.feedback.loop.sampled_plant import (
    Disturbance,
    Gust,
    check_parts,
    count_samples,
    read_disturbance,
)
from tensegrity_codegen.control.feedback.study.stated_errors import DrawnErrors, check_gust_times
from tensegrity_codegen.pipeline.build_library import MANY_CALLS, build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.request import ModelRequest


@dataclass(frozen=True, eq=False)
class NominalController:
    """The controller of the unchanged scene, and its disturbances.

    model, request: of the unchanged scene; another process builds the model again. controller, files: the
    controller, and its text in C; drawn: errors at the start of each draw; t_end, error_window [s]: the
    simulated time, and the time before its end in which errors count.
    """

    model: CompiledModel
    request: ModelRequest
    controller: ControllerParts
    files: ControllerFiles
    drawn: tuple[DrawnErrors, ...]
    t_end: float
    error_window: float

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {
            "model": self.model.structure,
            "controller": _with_model(self.controller, None),
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        model = build_library(state["model"], state["request"], calls=MANY_CALLS).load()
        self.__dict__.update(state | {"model": model, "controller": _with_model(state["controller"], model)})


def _with_model(parts: ControllerParts, model: Any) -> ControllerParts:
    """Return the parts with another model, or none, that estimator and distribution know."""
    estimator, distribution = parts.estimator, parts.distribution
    if estimator is not None:
        estimator = replace(estimator, sensing=replace(estimator.sensing, model=model))
    if distribution is not None:
        distribution = replace(distribution, model=model)
    return replace(parts, estimator=estimator, distribution=distribution)


class CaseLoop:
    """The model of some cases under the controller of the unchanged scene, in one loop in C."""

    def __init__(self, model: CompiledModel, design: NominalController) -> None:
        self.model, self.design = model, design
        self.count = count_samples(design.t_end, design.controller.sample)
        self.loops: dict[bytes, CompiledLoop] = {}

    def run(
        self, case_arguments: Mapping[str, Any], loop_values: Mapping[str, FloatArray], draw: int, seed: int
    ) -> ControlRun:
        """Return the run of a draw; raises InvalidValueError for a structure with other coordinates.

        case_arguments: of the model; the start is that of the motion, with the changes of the case added.
        loop_values: delays and rates of actuators, noise of sensors, and gusts, if they vary between cases.
        """
        design, controller = self.design, self.design.controller
        gains = controller.gains if controller.mpc is None else controller.mpc.gains
        check_parts(self.model.manifest, controller.motion, gains, controller.estimator, None)
        arguments = {
            name: value for name, value in case_arguments.items() if name not in ("coordinate", "velocity")
        }
        state = Disturbance(
            coordinate_error=design.drawn[draw].coordinate + self._find_change(case_arguments, "coordinate"),
            velocity_error=self._find_change(case_arguments, "velocity"),
            arguments=arguments,
            gust=self._find_gusts(loop_values),
            seed=int(np.random.SeedSequence([seed, draw]).generate_state(1)[0]),
        )
        start = read_disturbance(self.model, controller.motion, state)
        structure = self.model.structure
        assert structure is not None  # libraries of a sweep have theirs
        noise = loop_values.get("sensor_noise", np.array([sensor.noise for sensor in structure.sensors]))
        sensing = None if controller.estimator is None else self._find_sensing(noise)
        names = [actuator.name for actuator in structure.actuators]
        rows = [names.index(name) for name in controller.bounds.names]
        delay = loop_values.get(
            "actuator_delay", np.array([actuator.delay for actuator in structure.actuators])
        )
        rate = loop_values.get("actuator_rate", np.array([actuator.rate for actuator in structure.actuators]))
        limits = ActuatorLimits(delay=delay[rows], rate=rate[rows])
        bounds = find_bounds(self.design.model, controller.motion, limits, may_lag=True)
        return self._find_loop(sensing).run(start, self.count, bounds)

    def _find_gusts(self, loop_values: Mapping[str, FloatArray]) -> list[Gust]:
        """Return the gusts of a case; raises InvalidValueError for one after the simulated time."""
        assert self.model.structure is not None
        manifest, no_gust = self.model.manifest, build_no_gust(self.model.structure)
        force, time = no_gust[GUST], loop_values.get(GUST_TIME, no_gust[GUST_TIME])
        force[:, list(manifest.axes)] = loop_values.get(GUST, 0.0)
        rows = [(manifest.node_name[k], *force[k].tolist()) for k in np.flatnonzero(force.any(axis=1))]
        gusts = [Gust(name, (x, y, z), *time.tolist()) for name, x, y, z in rows]
        check_gust_times(gusts, self.design.t_end)
        return gusts

    def _find_change(self, case_arguments: Mapping[str, Any], name: str) -> FloatArray:
        """Return by how much the start of the case differs from that of the unchanged scene."""
        before = np.asarray(self.design.model.nominal(name), dtype=np.float64)
        return np.asarray(case_arguments.get(name, self.model.nominal(name)), dtype=np.float64) - before

    def _find_sensing(self, noise: FloatArray) -> Sensing:
        """Return the sensing of the case; noise: of each sensor of the scene."""
        estimator = self.design.controller.estimator
        assert estimator is not None
        sensing = estimator.sensing
        # Each sensor measures one number for each member, or for each axis of a node.
        axes = len(self.model.manifest.axes)
        sizes = [
            len(sensor.targets) * (1 if sensor.kind.startswith("member_") else axes)
            for sensor in sensing.sensors
        ]
        return replace(sensing, model=self.model, noise=np.repeat(noise, sizes))

    def _find_loop(self, sensing: Sensing | None) -> CompiledLoop:
        """Return the loop in C with the noise of the sensors."""
        controller = self.design.controller
        key = b"" if sensing is None else sensing.noise.tobytes()
        if key not in self.loops:
            if controller.estimator is not None and sensing is not None:
                controller = replace(controller, estimator=replace(controller.estimator, sensing=sensing))
            self.loops[key] = CompiledLoop(self.model, controller, self.design.files, None)
        return self.loops[key]
