"""A compiled model under a proportional load, as a problem whose load path can be followed.

The arguments that grow, loads on nodes or gravity, are a_0 + lambda a: a_0 the base, a the pattern.

With rigid bars a path is the zeros of one function of all coordinates. With p the nearest configuration to q
that keeps the lengths, P = Z Z^T the projector on the directions there,

    g(q, lambda) = P f(p, lambda) - sigma (q - p) = 0

has the equilibria for its zeros, whatever sigma > 0 [N/m] is, and at them -dg/dq = P A P + sigma (1 - P)
with A the Hessian of the Lagrangian: symmetric, with the eigenvalues of the structure and sigma.
"""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import scipy
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.contacts.rest_memory import find_rest_memory
from tensegrity_codegen.runtime.model.arguments import read_arguments
from tensegrity_codegen.runtime.model.arrays import to_doubles
from tensegrity_codegen.runtime.model.interface import (
    Model,
    require_double,
    require_model,
    require_quantities,
)
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.runtime.paths.load_path import NeutralMotions
from tensegrity_codegen.runtime.statics.constrained_problems import BarProblem
from tensegrity_codegen.runtime.statics.static_problem import build_rigid_motions, find_neutral_motions
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, NonFiniteError, check_choice

# What a load path needs of a model in node coordinates; events need member_extension and bar_distance too.
LOAD_PATH_QUANTITIES = ("node_residual", "tangent_stiffness")

Pattern = ArrayLike | Mapping[str, ArrayLike]

GROWING = ("node_load", "gravity")  # arguments that the forces are linear in
PURPOSE = "a load path needs"
FORCES = ("node_residual", "coordinate_force")  # what formulations call g
# sigma as a multiple of the largest stiffness, so that the eigenvalues told are the structure's.
SIGMA_STIFFNESS_RATIO = 10.0


class ModelPath:
    """Equilibria of a model with loads base + load factor times pattern.

    Parameters
    ----------
    model : CompiledModel
        With ``LOAD_PATH_QUANTITIES`` and the increasing loads as run-time arguments.
    pattern : array_like, shape (n_loaded, n_axes) [N], or mapping
        Loads at load factor 1, rows as in the argument node_load; or patterns by argument, of ``"node_load"``
        and ``"gravity"`` (n_axes,) [m/s2].
    arguments : mapping, optional
        Inputs and parameters by name; those of the increasing loads are their base.

    Raises
    ------
    FormulationError
        The model lacks a function, or has rigid bars (use BarPath).
    InvalidValueError
        A wrong pattern.

    Notes
    -----
    g(q, lambda) = -dU/dq (docs/statics.md, Load paths).
    """

    has_rigid_bars: ClassVar[bool] = False

    def __init__(self, model: Model, pattern: Pattern, arguments: Mapping[str, Any] | None = None) -> None:
        require_model(model)
        require_double(model.manifest, "a load path")
        self.model = model
        if bool(model.manifest.rigid_bar) != self.has_rigid_bars:
            raise FormulationError(
                "rigid bars need the class BarPath",
                where=model.manifest.name,
                given=f"{len(model.manifest.rigid_bar)} rigid bars",
                allowed="BarPath with rigid bars, ModelPath without",
                hint="call build_path(model, pattern)",
            )
        self._force = next((name for name in FORCES if model.has(name)), "")
        if not self._force or not model.has("tangent_stiffness"):
            require_quantities(model, LOAD_PATH_QUANTITIES, PURPOSE)
        # Base and pattern of each growing argument.
        inputs = read_arguments(arguments)
        patterns = dict(pattern) if isinstance(pattern, Mapping) else {"node_load": pattern}
        _check_growing(model, patterns)
        shapes = {name: f"numbers of shape {model.nominal(name).shape}" for name in patterns}
        self.bases = {
            name: to_doubles(inputs.pop(name, model.nominal(name)), name, shapes[name]).copy()
            for name in patterns
        }
        self.patterns = {
            name: to_doubles(value, "pattern", shapes[name]).copy() for name, value in patterns.items()
        }
        _check_patterns(self.patterns, self.bases)
        # All other arguments, and the constant load vector if there is one.
        self.size = len(model.manifest.coordinate_name)
        self.arguments = {**inputs, "velocity": np.zeros(self.size)}
        self.memory = find_rest_memory(model, inputs)
        self._has_node_coordinates = bool(model.manifest.coordinate_node_axis)
        self._load = self._constant_load() if self._has_node_coordinates else None
        if not self._has_node_coordinates:
            require_quantities(model, ("node_jacobian",), PURPOSE)

    @property
    def base(self) -> FloatArray:
        """Node loads at load factor 0, (n_loaded, n_axes) [N]."""
        return self.bases["node_load"]

    @property
    def pattern(self) -> FloatArray:
        """Growing node loads, (n_loaded, n_axes) [N]."""
        return self.patterns["node_load"]

    def loads(self, load_factor: float) -> dict[str, FloatArray]:
        """Return the values of the growing arguments at a load factor, by name."""
        return {name: base + load_factor * self.patterns[name] for name, base in self.bases.items()}

    def static_arguments(self, load_factor: float) -> dict[str, Any]:
        """Return all arguments of an equilibrium at a load factor, by name."""
        inputs = {**self.arguments, **self.loads(load_factor)}
        del inputs["velocity"]
        return inputs

    def offers(self, quantity: str) -> bool:
        """Return whether `compute` gives the quantity."""
        return self.model.has(quantity)

    def compute(self, quantity: str, coordinate: FloatArray, load_factor: float) -> Any:
        """Return a quantity of the model at a point of the path."""
        inputs = self._given(coordinate, load_factor)
        return self.model.compute(
            quantity, **(self.memory.choose(quantity, inputs) if self.memory else inputs)
        )

    def settle(self, coordinate: FloatArray, load_factor: float) -> FloatArray | None:
        """Return the internal states of members there, (n_internal,); None if they have none."""
        return None if self.memory is None else self.memory.settle(self._given(coordinate, load_factor))

    def _given(self, coordinate: FloatArray, load_factor: float) -> dict[str, Any]:
        return {**self.arguments, **self.loads(load_factor), "coordinate": coordinate}

    def residual(self, coordinate: FloatArray, load_factor: float, /) -> FloatArray:
        """Return the static force on every coordinate, (n,)."""
        return np.asarray(self.compute(self._force, coordinate, load_factor))

    def static_force(self, coordinate: FloatArray, load_factor: float) -> FloatArray:
        """Return the force on every coordinate without those of rigid bars, (n,)."""
        return np.asarray(self.compute(self._force, coordinate, load_factor))

    def stiffness(self, coordinate: FloatArray, load_factor: float, /) -> Any:
        """Return the tangent stiffness, sparse (n, n)."""
        return self.compute("tangent_stiffness", coordinate, load_factor)

    def load_vector(self, coordinate: FloatArray, load_factor: float, /) -> FloatArray:
        """Return the generalised force of the pattern, (n,)."""
        if self._load is not None:
            return self._load
        if "gravity" in self.patterns:
            return self._growth(coordinate)
        jacobian = self.compute("node_jacobian", coordinate, load_factor)
        return np.asarray(jacobian.T @ self._spread().ravel())

    def neutral_motions(self) -> NeutralMotions | None:
        """Return the finder of rigid motions that cost no force; None if the anchors permit none."""
        manifest = self.model.manifest
        if not manifest.coordinate_node_axis:
            return None

        def permitted(coordinate: FloatArray) -> FloatArray:
            return build_rigid_motions(manifest, place_nodes(self.model, coordinate))

        if permitted(self.model.nominal("coordinate").ravel()).shape[1] == 0:
            return None
        return lambda coordinate, stiffness: find_neutral_motions(stiffness, permitted(coordinate), 0.0)

    def find_held(self) -> tuple[str, ...]:
        """Return the names of loaded nodes whose load moves nothing, since they are held where it acts."""
        manifest, loaded = self.model.manifest, self._spread() != 0
        moves = np.zeros_like(loaded)
        if manifest.coordinate_node_axis:
            column = {axis: k for k, axis in enumerate(manifest.axes)}
            for node, axis in manifest.coordinate_node_axis:
                moves[node, column[axis]] = True
            moves[manifest.body_points] = True
        else:
            jacobian = self.compute("node_jacobian", self.model.nominal("coordinate").ravel(), 0.0)
            moves = np.asarray(abs(jacobian).sum(axis=1)).reshape(loaded.shape) > 0
        held = loaded.any(axis=1) & ~(loaded & moves).any(axis=1)
        return tuple(manifest.node_name[node] for node in np.flatnonzero(held))

    def _growth(self, coordinate: FloatArray) -> FloatArray:
        """Return the forces on coordinates by a load factor of 1, (n,), in which they are linear."""
        forces = [np.asarray(self.compute(self._force, coordinate, factor)) for factor in (1.0, 0.0)]
        change: FloatArray = forces[0] - forces[1]
        return change

    def _constant_load(self) -> FloatArray:
        manifest = self.model.manifest
        if "gravity" in self.patterns:
            return self._growth(self.model.nominal("coordinate").ravel())
        column = {axis: k for k, axis in enumerate(manifest.axes)}
        spread = self._spread()
        for body in manifest.body_places:
            body.gather(spread)
        return np.array([spread[node, column[axis]] for node, axis in manifest.coordinate_node_axis])

    def _spread(self) -> FloatArray:
        """Return the pattern over all nodes, (n_nodes, n_axes)."""
        manifest = self.model.manifest
        spread = np.zeros((len(manifest.node_name), len(manifest.axes)))
        if "node_load" in self.patterns:
            rows = [manifest.node_name.index(name) for name in manifest.argument("node_load").over]
            spread[rows] = self.patterns["node_load"]
        return spread


def _check_growing(model: Model, patterns: Mapping[str, Any]) -> None:
    """Raise where a growing argument is no load, or no run-time argument of the model."""
    changeable = {argument.name for argument in model.manifest.arguments}
    for name in patterns:
        check_choice(name, GROWING, "load", "pattern")
        if name not in changeable:
            raise FormulationError(
                "a load path needs loads that may change at run time",
                where=model.manifest.name,
                hint=f'build the model with [parameters] {name} = "all"',
            )


def _check_patterns(patterns: Mapping[str, FloatArray], bases: Mapping[str, FloatArray]) -> None:
    for name, pattern in patterns.items():
        if pattern.shape != bases[name].shape or not np.isfinite(pattern).all():
            _refuse_pattern(pattern, bases[name].shape)
    if not patterns:
        raise InvalidValueError("no load pattern", where="pattern", given={}, allowed=", ".join(GROWING))
    if not any(pattern.any() for pattern in patterns.values()):
        _refuse_pattern(np.concatenate([pattern.ravel() for pattern in patterns.values()]), None)


def _refuse_pattern(pattern: FloatArray, shape: tuple[int, ...] | None) -> None:
    raise InvalidValueError(
        "the load pattern is zero or not finite",
        where="pattern",
        given=pattern if shape in (None, pattern.shape) else pattern.shape,
        allowed=f"finite numbers{'' if shape is None else f' of shape {shape}'}, not all zero",
    )


class BarPath(ModelPath):
    """Equilibria of springs and rigid bars with loads base + load factor times pattern, as ModelPath."""

    has_rigid_bars: ClassVar[bool] = True

    def __init__(self, model: Model, pattern: Pattern, arguments: Mapping[str, Any] | None = None) -> None:
        super().__init__(model, pattern, arguments)
        self._problem = BarProblem(model, self.static_arguments(1.0))
        self.memory = self._problem.memory
        start = self._problem.to_search_coordinate(model.nominal("coordinate").ravel())
        stiffest = float(self._problem.row_stiffness(start).max(initial=0.0))
        self._sigma = SIGMA_STIFFNESS_RATIO * stiffest or 1.0
        self._last: tuple[float, BarProblem] | None = None

    def offers(self, quantity: str) -> bool:
        """Return whether `compute` gives the quantity."""
        return quantity == "member_tension" or super().offers(quantity)

    def compute(self, quantity: str, coordinate: FloatArray, load_factor: float) -> Any:
        """Return a quantity of the model at a point of the path; tensions are those of rigid bars too."""
        if quantity != "member_tension":
            return super().compute(quantity, coordinate, load_factor)
        problem, placed = self._at(coordinate, load_factor)
        return problem.forces(placed)[1]

    def residual(self, coordinate: FloatArray, load_factor: float, /) -> FloatArray:
        """Return g, (n,) [N]."""
        problem, placed = self._at(coordinate, load_factor)
        return problem.residual(placed) - self._sigma * (coordinate - placed)

    def stiffness(self, coordinate: FloatArray, load_factor: float, /) -> Any:
        """Return P A P + sigma (1 - P), sparse (n, n) [N/m]."""
        problem, placed = self._at(coordinate, load_factor)
        along = problem.directions(placed)
        held = scipy.sparse.eye_array(self.size) - along @ along.T
        return scipy.sparse.csc_array(along @ problem.stiffness(placed) @ along.T + self._sigma * held)

    def load_vector(self, coordinate: FloatArray, load_factor: float, /) -> FloatArray:
        """Return the part of the pattern that bars leave free, (n,) [N]."""
        problem, placed = self._at(coordinate, load_factor)
        along = problem.directions(placed)
        return np.asarray(along @ (along.T @ super().load_vector(coordinate, load_factor)))

    def _at(self, coordinate: FloatArray, load_factor: float) -> tuple[BarProblem, FloatArray]:
        """Return the static problem under this load and the nearest configuration that keeps the lengths."""
        if self._last is None or self._last[0] != load_factor:
            self._last = (load_factor, self._problem.under(**self.loads(load_factor)))
        problem = self._last[1]
        placed = problem.place(coordinate)
        if placed is None:
            raise NonFiniteError(
                "no configuration near here has the lengths of the rigid bars", where="load path"
            )
        return problem, placed


def build_path(model: Model, pattern: Pattern, arguments: Mapping[str, Any] | None = None) -> ModelPath:
    """Return the load path of a model, for its formulation.

    Parameters
    ----------
    model : CompiledModel
        The model.
    pattern, arguments
        As for ModelPath.

    Returns
    -------
    ModelPath
        A BarPath where the model has rigid bars.

    Raises
    ------
    FormulationError, InvalidValueError
        As for ModelPath.
    """
    require_model(model)
    kind = BarPath if model.manifest.rigid_bar else ModelPath
    return kind(model, pattern, arguments)
