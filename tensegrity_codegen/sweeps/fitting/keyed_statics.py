"""Equilibria of a scene, and their natural frequencies, as functions of some of its numbers.

Derivatives are central differences of equilibria, found side by side from the equilibrium between them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.pipeline.analyses import want_analyses
from tensegrity_codegen.pipeline.build_library import MANY_CALLS, build_library
from tensegrity_codegen.pipeline.settle import with_statics
from tensegrity_codegen.runtime.linear.linearize import linearize
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.statics.batch.equilibria import Equilibria
from tensegrity_codegen.runtime.statics.batch.find_equilibria import find_equilibria
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.sweeps.fitting.keyed_scene import KeyedScene
from tensegrity_codegen.sweeps.fitting.measurements import FREQUENCY, Measurements
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import ConvergenceError, InvalidValueError

STEP = 1e-4  # of a number: half the distance of the differences of equilibria
TOLERANCE = 1e-11  # of the largest member force


class KeyedStatics(KeyedScene):
    """Equilibria of a scene in several states, as functions of some of its numbers.

    scene, keys: as of `KeyedScene`; data: what was measured, in states whose loads and inputs are among its
    conditions; compiler: c compiler.
    Raises UnknownKeyError, InvalidValueError: as of `KeyedScene`; FormulationError: a scene of bodies.
    """

    def __init__(
        self,
        scene: str | Path | Mapping[str, Any] | Scene,
        keys: Sequence[str],
        data: Measurements,
        compiler: str | None = None,
    ) -> None:
        super().__init__(scene, keys, tuple(data.conditions), data.source)
        self.shape: FloatArray | None = None  # the equilibria that were found last, (n_states, n_coordinates)
        has_frequencies = any(item.kind == FREQUENCY for item in data.channels)
        analyses = ("equilibria", "linearize") if has_frequencies else ("equilibria",)
        statics = with_statics(self.structure, replace(self.group.request, quantities=(), integrators=()))
        wanted = want_analyses(self.structure, statics, analyses)
        built = build_library(self.structure, wanted, compiler=compiler, calls=MANY_CALLS)
        self.model: CompiledModel = built.load()
        self.known = {item.name for item in self.model.manifest.arguments} - {"coordinate", "velocity"}

    def observe(self, values: FloatArray, data: Measurements, until: int) -> tuple[FloatArray, FloatArray]:
        """Return what is measured in the states before `until`, and its derivatives (..., n_keys).

        Raises ConvergenceError where there is no equilibrium.
        """
        conditions = np.array([data.conditions[key] for key in self.given]).reshape(-1, len(data.time)).T
        blocks = [self.vary(values, given, STEP) for given in conditions[:until]]
        rows = np.vstack([np.array(blocks)[:, 0], np.array(blocks)[:, 1:].reshape(-1, blocks[0].shape[1])])
        arguments = self.apply(rows)
        own = self._settle({name: value[:until] for name, value in arguments.items()}, self.shape)
        self.shape = own.coordinate
        if self.structure.ground is not None:
            self.shape = None  # friction depends on the way, which begins in the scene
        count = 2 * len(values)
        varied = {name: value[until:] for name, value in arguments.items()}
        near = None if self.shape is None else np.repeat(self.shape, count, axis=0)
        moved = self._settle(varied, near)
        found = self._read(own, {name: value[:until] for name, value in arguments.items()}, data)
        apart = self._read(moved, varied, data).reshape(until, 2, len(values), -1)
        over = np.array([np.diagonal(block[1 : len(values) + 1]) for block in blocks])
        over = over - np.array([np.diagonal(block[len(values) + 1 :]) for block in blocks])
        slopes = (apart[:, 0] - apart[:, 1]) / (over / self.size)[:, :, None]
        return found, np.moveaxis(slopes, 1, 2)

    def _settle(self, arguments: Mapping[str, FloatArray], start: FloatArray | None) -> Equilibria:
        """Return the equilibria under arguments (n, ...), from starts (n, n_coordinates)."""
        given = {name: value for name, value in arguments.items() if name in self.known}
        count = len(next(iter(arguments.values())))
        own = arguments.get("coordinate")
        if start is None or len(start) != count:
            nominal = np.tile(self.model.nominal("coordinate"), (count, 1))
            start = nominal if own is None else own
        found = find_equilibria(self.model, coordinate=start, arguments=given, tolerance=TOLERANCE)
        bad = [k for k, status in enumerate(found.status) if status != "converged"]
        if bad:
            raise ConvergenceError(
                f"{len(bad)} of {count} states have no equilibrium: {found.message[bad[0]]}",
                where=self.assembler.where,
                hint="values of the scene nearer to what was measured, or fewer states",
            )
        return found

    def _read(self, found: Equilibria, arguments: Mapping[str, FloatArray], data: Measurements) -> FloatArray:
        """Return the channels at equilibria, (n, n_channels)."""
        count = len(found.coordinate)
        highest = max((item.place[0] for item in data.channels if item.kind == FREQUENCY), default=-1)
        columns, frequency = [], np.zeros((count, highest + 1))
        for k in range(count if highest >= 0 else 0):
            own = {name: value[k] for name, value in arguments.items() if name in self.known}
            linear = linearize(self.model, coordinate=found.coordinate[k], velocity=None, arguments=own)
            if len(linear.natural_frequency) <= highest:
                raise InvalidValueError(
                    "the structure has fewer natural frequencies",
                    where=data.source,
                    given=f"frequency.{highest + 1}",
                    allowed=f"frequency.1 to frequency.{len(linear.natural_frequency)}",
                )
            frequency[k] = linear.natural_frequency[: highest + 1]
        for item in data.channels:
            values = frequency if item.kind == FREQUENCY else getattr(found, item.quantity)
            place: Any = (slice(None), *item.place)
            columns.append(values[place])
        return np.stack(columns, axis=1)
