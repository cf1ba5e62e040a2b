"""Motions of a scene as functions of some of its numbers, with derivatives from the same integration.

The numbers are keys of sweeps. What a library takes follows from them by assembling the scene, whose
derivatives are central differences; those of the motion are columns along these directions, so that a number
which many members share costs one column.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.pipeline.analyses import find_needs
from tensegrity_codegen.pipeline.build_library import MANY_CALLS, build_library
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.simulation_quantities import CONTACT_QUANTITIES
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.sweeps.apply.array_keys import INPUT, ArrayKey
from tensegrity_codegen.sweeps.apply.assembler import CaseAssembler, build_assembler, expand_document
from tensegrity_codegen.sweeps.apply.group_cases import find_groups
from tensegrity_codegen.sweeps.apply.mapper import CaseGroup
from tensegrity_codegen.sweeps.cases.cases import Cases
from tensegrity_codegen.sweeps.cases.table import Table
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError
from tensegrity_codegen.tables.quantities import DIRECTED

METHOD = "rk853"
STEP = 1e-5  # of a number: half the distance of the differences by which scenes are differentiated


@dataclass(frozen=True)
class RunSettings:
    """How motions are integrated: method, relative tolerance of its steps, inputs over time."""

    method: str = METHOD
    rtol: float = 1e-8
    schedule: Profile | None = None


class KeyedMotion:
    """The motion of a scene over given sample times, as a function of some of its numbers.

    Parameters
    ----------
    scene : str, Path, mapping or Scene
        As for `read_scene`.
    keys : sequence of str
        Numbers of the scene, or of the assembled structure, as for sweeps.
    settings : RunSettings
        Method, tolerance, inputs over time.
    compiler : str, optional
        C compiler.

    Raises
    ------
    UnknownKeyError, InvalidValueError
        A key that is no number of the scene, or that has no value there; keys that change the code.
    FormulationError
        The scene's motions have no derivatives.
    """

    def __init__(
        self,
        scene: str | Path | Mapping[str, Any] | Scene,
        keys: Sequence[str],
        settings: RunSettings,
        compiler: str | None = None,
    ) -> None:
        self.keys, self.settings = tuple(keys), settings
        self.assembler = build_assembler(scene, self.keys)
        self.start = np.array([_read_start(self.assembler, k) for k in range(len(self.keys))])
        self.size = np.where(self.start != 0.0, np.abs(self.start), 1.0)
        self.group = self._find_group()
        structure, request = self.group.structure, self.group.request
        if not isinstance(structure, Structure):
            raise FormulationError(
                "motions of bodies have no derivatives",
                where=self.assembler.where,
                allowed="a scene of nodes, bars and cables",
            )
        self.structure: Structure = structure
        wanted = find_needs("simulate", structure, request, method=settings.method).alone(request)
        wanted = replace(wanted, directions=self.keys, batch_width=0, keep=(), interfaces=(), flags="native")
        # Forces of contacts are not measured, and take longer than the motion.
        needed = [name for name in wanted.quantities if name not in CONTACT_QUANTITIES]
        wanted = replace(wanted, quantities=(*needed, "tension_column"))
        self.model: CompiledModel = build_library(
            structure, wanted, compiler=compiler, calls=MANY_CALLS
        ).load()

    def apply(self, values: FloatArray) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
        """Return the arguments of the library for values (n_keys,), and their derivatives (..., n_keys).

        The derivatives are to each value over its size at the start.
        Raises InvalidValueError for values that make no scene.
        """
        count, steps = len(values), STEP * self.size
        shifted = values + np.vstack([np.zeros(count), np.diag(steps), -np.diag(steps)])
        shifted[count + 1 :] = self._keep_in_bounds(shifted[count + 1 :], values)
        found = self.group.arguments(shifted)
        if not found.good.all():
            raise InvalidValueError(
                "these values make no scene",
                where=self.assembler.where,
                given=", ".join(f"{key} = {value:g}" for key, value in zip(self.keys, values, strict=True)),
                allowed="numbers that the scene's keys allow, on both sides of these",
                hint=next(text for text in found.messages if text),
            )
        ahead, behind = np.diagonal(shifted[1 : count + 1]), np.diagonal(shifted[count + 1 :])
        over = (ahead - behind) / self.size
        slopes = {
            name: np.moveaxis(rows[1 : count + 1] - rows[count + 1 :], 0, -1) / over
            for name, rows in found.arguments.items()
        }
        return {name: rows[0] for name, rows in found.arguments.items()}, slopes

    def run(self, values: FloatArray, times: FloatArray) -> "MotionSlopes":
        """Return the motion at sample times (n_t,), the first 0, with values (n_keys,) of the keys."""
        arguments, slopes = self.apply(values)
        coordinate, velocity = (arguments.pop(name, None) for name in ("coordinate", "velocity"))
        manifest, count = self.model.manifest, len(values)
        shapes = {item.name: item.shape for item in manifest.arguments}
        along = {name: slopes[name].reshape(-1, count) for name in slopes}

        def stack(names: Sequence[str]) -> FloatArray:
            rows = [
                along.get(name, np.zeros((int(np.prod(shapes[name])), count)))
                for name in names
                if name in shapes
            ]
            return np.vstack([np.zeros((0, count)), *rows])

        column = stack(("coordinate", "velocity"))
        column = np.vstack([column, np.zeros((len(manifest.internal_name), count))])
        columns = {"column": column, "direction": stack(DIRECTED)}
        columns = {name: value for name, value in columns.items() if name in shapes}
        motion = simulate(
            self.model,
            float(times[-1]),
            samples=times,
            method=self.settings.method,
            rtol=self.settings.rtol,
            arguments={**arguments, **columns},
            schedule=self.settings.schedule,
            coordinate=coordinate,
            velocity=velocity,
            stepping=Stepping(control="steps"),
        )
        return MotionSlopes(self.model, motion, arguments, columns.get("direction"), slopes)

    def write(self, values: FloatArray) -> dict[str, Any]:
        """Return the scene with these values (n_keys,).

        Raises InvalidValueError for keys of the assembled structure, which no scene has.
        """
        for key in self.assembler.keys:
            if isinstance(key, ArrayKey):
                raise InvalidValueError(
                    "this number is of the assembled structure, and no scene states it",
                    where=self.assembler.where,
                    given=key.text,
                    allowed="numbers of the scene, as members.NAME.rest_length",
                )
        return dict(self.assembler.write(values))

    def _keep_in_bounds(self, shifted: FloatArray, values: FloatArray) -> FloatArray:
        """Return rows (n_keys, n_keys) whose own value stays where its key allows it."""
        outside = ~self.assembler.in_bounds(shifted)
        shifted[outside] = values
        return shifted

    def _find_group(self) -> CaseGroup:
        """Return the cases near the start; raises InvalidValueError for keys that change the code."""
        steps = np.diag(STEP * self.size)
        rows = self.start + np.vstack([np.zeros(len(self.start)), steps])
        groups = find_groups(self.assembler, Cases((), Table(self.keys, rows)), yes=True)
        first = next(group for group in groups if 0 in group.rows)
        others = [k for k in range(1, len(rows)) if k not in first.rows]
        if others:
            raise InvalidValueError(
                "these numbers are constants of the code, and no derivative is to them",
                where=self.assembler.where,
                given=", ".join(self.keys[k - 1] for k in others),
                allowed="stiffnesses, rest lengths, damping, masses and loads of nodes, gravity, positions "
                "and velocities of nodes at the start, inputs, and numbers of the ground",
                hint="masses of bars are constants: identify those of their nodes",
            )
        return first


def _read_start(assembler: CaseAssembler, place: int) -> float:
    """Return the value of a key in the scene; raises InvalidValueError where there is none."""
    key, where = assembler.keys[place], assembler.where
    value: float | None
    if isinstance(key, ArrayKey):
        if key.array == INPUT:
            return 0.0
        from tensegrity_codegen.pipeline.compile_scene import load_scene

        subject, _ = load_scene(assembler.document)
        found = np.asarray(getattr(subject, key.array))[list(key.rows)]
        found = found if key.axis < 0 else found[:, key.axis]
        if np.ptp(found) > 0.0:
            raise InvalidValueError(
                "the entries of this key differ in the scene, and it would give them all one value",
                where=where,
                given=key.text,
                allowed="a key whose entries are equal at the start",
                hint="one key for each, or a number of the scene that they follow from",
            )
        return float(found[0])
    document = expand_document(assembler.document, where) if key.is_from_shape else assembler.document
    value = key.path.read(document)
    if value is None:
        raise InvalidValueError(
            "the scene does not state this number, so that there is no value to start from",
            where=where,
            given=key.text,
            allowed="numbers that the scene states",
            hint=f"write {key.text} into the scene",
        )
    return float(value)


@dataclass(frozen=True)
class MotionSlopes:
    """A motion, and the derivatives of what can be measured along it, to each value over its size.

    arguments: of the motion, without what follows a profile; direction: (n_directed, n_keys); slopes:
    derivatives of the arguments.
    """

    model: CompiledModel
    motion: Trajectory
    arguments: Mapping[str, FloatArray]
    direction: FloatArray | None
    slopes: Mapping[str, FloatArray]

    @property
    def columns(self) -> FloatArray:
        """Derivatives of the states, (n_t, n_states, n_keys)."""
        assert self.motion.columns is not None
        return self.motion.columns

    @cached_property
    def node_position(self) -> FloatArray:
        """Derivatives of all positions, (n_t, n_nodes, 3, n_keys) [m]."""
        manifest = self.model.manifest
        found = self._place(0)
        moved = self.slopes.get("anchor_position")
        if moved is not None:
            anchors = manifest.argument("anchor_position").over
            axes = list(manifest.axes)
            for row, name in enumerate(anchors):
                node = manifest.node_name.index(name)
                held = [axis for axis in axes if (node, axis) not in manifest.coordinate_node_axis]
                for axis in held:
                    found[:, node, axis] = moved[row, axes.index(axis)]
        return found

    @cached_property
    def node_velocity(self) -> FloatArray:
        """Derivatives of all velocities, (n_t, n_nodes, 3, n_keys) [m/s]."""
        return self._place(len(self.model.manifest.coordinate_name))

    @cached_property
    def member_length(self) -> FloatArray:
        """Derivatives of all member lengths, (n_t, n_members, n_keys) [m]."""
        ends = np.array(self.model.manifest.connectivity, dtype=np.int64).reshape(-1, 2)
        position = self.motion.node_position
        apart = position[:, ends[:, 1]] - position[:, ends[:, 0]]
        along = apart / np.linalg.norm(apart, axis=-1, keepdims=True)
        change = self.node_position[:, ends[:, 1]] - self.node_position[:, ends[:, 0]]
        return np.asarray(np.einsum("tma,tmak->tmk", along, change))

    @cached_property
    def member_tension(self) -> FloatArray:
        """Derivatives of all member tensions, (n_t, n_members, n_keys) [N]."""
        spec = next(item for item in self.model.manifest.functions if item.quantity == "tension_column")
        motion, given = self.motion, {**self.arguments}
        if self.direction is not None:
            given["direction"] = self.direction
        found = np.empty((len(motion.time), len(motion.member_name), self.columns.shape[2]))
        for k in range(len(motion.time)):
            given |= {"coordinate": motion.coordinate[k], "velocity": motion.velocity[k]}
            given["column"] = self.columns[k]
            if motion.input is not None:
                given["input"] = motion.input[k]
            found[k] = self.model.compute(
                "tension_column", **{name: given[name] for name in spec.arguments if name in given}
            )
        return found

    def _place(self, first: int) -> FloatArray:
        """Return rows of coordinates from `first` on by nodes and axes, (n_t, n_nodes, 3, n_keys)."""
        manifest = self.model.manifest
        node, axis = np.array(manifest.coordinate_node_axis, dtype=np.int64).reshape(-1, 2).T
        found = np.zeros((len(self.motion.time), len(manifest.node_name), 3, self.columns.shape[2]))
        found[:, node, axis] = self.columns[:, first : first + len(node)]
        return found
