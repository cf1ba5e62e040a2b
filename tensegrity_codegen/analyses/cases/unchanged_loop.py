"""The controller of the unchanged scene of a sweep, and simulated loops of cases under it."""

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
class UnchangedLoop:
    """The controller of the unchanged scene, and what disturbs it.

    model, request: of the unchanged scene, which another process builds again; parts, files: the controller,
    and its text in C; drawn: errors at the start of each draw; t_end, last [s]: simulated time, and that
    before its end in which errors count.
    """

    model: CompiledModel
    request: ModelRequest
    parts: ControllerParts
    files: ControllerFiles
    drawn: tuple[DrawnErrors, ...]
    t_end: float
    last: float

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"model": self.model.structure, "parts": _with_model(self.parts, None)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        model = build_library(state["model"], state["request"], calls=MANY_CALLS).load()
        self.__dict__.update(state | {"model": model, "parts": _with_model(state["parts"], model)})


def _with_model(parts: ControllerParts, model: Any) -> ControllerParts:
    """Return the parts with another model, or none, that estimator and distribution know."""
    senses, spread = parts.estimator, parts.distribution
    if senses is not None:
        senses = replace(senses, sensing=replace(senses.sensing, model=model))
    if spread is not None:
        spread = replace(spread, model=model)
    return replace(parts, estimator=senses, distribution=spread)


class SweptPlant:
    """The model of some cases under the controller of the unchanged scene, in one loop in C."""

    def __init__(self, model: CompiledModel, design: UnchangedLoop) -> None:
        self.model, self.design = model, design
        self.count = count_samples(design.t_end, design.parts.sample)
        self.loops: dict[bytes, CompiledLoop] = {}

    def run(
        self, own: Mapping[str, Any], loops: Mapping[str, FloatArray], draw: int, seed: int
    ) -> ControlRun:
        """Return the run of a draw; raises InvalidValueError for a structure with other coordinates.

        own: arguments of the model; its start is that of the motion, with what the case adds to it.
        loops: delays and rates of the actuators and noise of the sensors of the scene, and gusts, where they
        vary between cases.
        """
        design, parts = self.design, self.design.parts
        known = parts.gains if parts.mpc is None else parts.mpc.gains
        check_parts(self.model.manifest, parts.motion, known, parts.estimator, None)
        given = {name: value for name, value in own.items() if name not in ("coordinate", "velocity")}
        state = Disturbance(
            coordinate_error=design.drawn[draw].coordinate + self._find_change(own, "coordinate"),
            velocity_error=self._find_change(own, "velocity"),
            arguments=given,
            gust=self._find_gusts(loops),
            seed=int(np.random.SeedSequence([seed, draw]).generate_state(1)[0]),
        )
        start = read_disturbance(self.model, parts.motion, state)
        structure = self.model.structure
        assert structure is not None  # libraries of a sweep have theirs
        noise = loops.get("sensor_noise", np.array([item.noise for item in structure.sensors]))
        sensing = None if parts.estimator is None else self._find_sensing(noise)
        names = [item.name for item in structure.actuators]
        places = [names.index(name) for name in parts.bounds.names]
        delay = loops.get("actuator_delay", np.array([item.delay for item in structure.actuators]))
        rate = loops.get("actuator_rate", np.array([item.rate for item in structure.actuators]))
        limits = ActuatorLimits(delay=delay[places], rate=rate[places])
        bounds = find_bounds(self.design.model, parts.motion, limits, may_lag=True)
        return self._find_loop(sensing).run(start, self.count, bounds)

    def _find_gusts(self, loops: Mapping[str, FloatArray]) -> list[Gust]:
        """Return the gusts of a case; raises InvalidValueError for one after the simulated time."""
        assert self.model.structure is not None
        manifest, none = self.model.manifest, build_no_gust(self.model.structure)
        force, time = none[GUST], loops.get(GUST_TIME, none[GUST_TIME])
        force[:, list(manifest.axes)] = loops.get(GUST, 0.0)
        rows = [(manifest.node_name[k], *force[k].tolist()) for k in np.flatnonzero(force.any(axis=1))]
        found = [Gust(name, (x, y, z), *time.tolist()) for name, x, y, z in rows]
        check_gust_times(found, self.design.t_end)
        return found

    def _find_change(self, own: Mapping[str, Any], name: str) -> FloatArray:
        """Return by how much the start of the case differs from that of the unchanged scene."""
        before = np.asarray(self.design.model.nominal(name), dtype=np.float64)
        return np.asarray(own.get(name, self.model.nominal(name)), dtype=np.float64) - before

    def _find_sensing(self, noise: FloatArray) -> Sensing:
        """Return what the sensors of the case measure; noise: of each sensor of the scene."""
        estimator = self.design.parts.estimator
        assert estimator is not None
        known = estimator.sensing
        # Each sensor measures one number for each member, or for each axis of a node.
        axes = len(self.model.manifest.axes)
        sizes = [
            len(item.targets) * (1 if item.kind.startswith("member_") else axes) for item in known.sensors
        ]
        return replace(known, model=self.model, noise=np.repeat(noise, sizes))

    def _find_loop(self, sensing: Sensing | None) -> CompiledLoop:
        """Return the loop in C with the noise of the sensors."""
        parts = self.design.parts
        key = b"" if sensing is None else sensing.noise.tobytes()
        if key not in self.loops:
            if parts.estimator is not None and sensing is not None:
                parts = replace(parts, estimator=replace(parts.estimator, sensing=sensing))
            self.loops[key] = CompiledLoop(self.model, parts, self.design.files, None)
        return self.loops[key]
