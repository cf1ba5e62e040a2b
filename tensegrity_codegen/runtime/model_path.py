"""A compiled model under a proportional load, as a problem whose load path can be followed.

The loads on the nodes are F_0 + lambda F: F_0 the model's own, F the pattern that grows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.errors import FormulationError, InvalidValueError, UnknownNameError, suggest
from tensegrity_codegen.runtime.double_only import require_double
from tensegrity_codegen.runtime.interface import Model
from tensegrity_codegen.runtime.path_problem import NeutralMotions, Watch
from tensegrity_codegen.runtime.placement import place_nodes
from tensegrity_codegen.runtime.require import require_quantities
from tensegrity_codegen.runtime.rigid_motion import build_rigid_motions, find_neutral_motions

__all__ = ["LOAD_PATH_QUANTITIES", "ModelPath", "watch_contact", "watch_slack"]

FloatArray = NDArray[np.float64]

# What a load path needs of a model in node coordinates; events need member_extension and bar_distance too.
LOAD_PATH_QUANTITIES = ("node_residual", "tangent_stiffness")

PURPOSE = "a load path needs"
FORCES = ("node_residual", "coordinate_force")  # what formulations call g


class ModelPath:
    """Equilibria of a model whose run-time argument `node_load` is base + load factor times pattern.

    pattern: (n_loaded, n_axes) [N], rows as in the model's argument node_load; arguments: values of inputs
    and parameters that differ from the scene's, node_load among them as the base. In coordinates that are no
    node coordinates the model has to have the quantity node_jacobian, and node_load over all nodes.
    Raises FormulationError where the model lacks a function, InvalidValueError for a wrong pattern.
    """

    has_rigid_bars: ClassVar[bool] = False

    def __init__(self, model: Model, pattern: ArrayLike, arguments: Mapping[str, Any] | None = None) -> None:
        require_double(model.manifest, "a load path")
        self.model = model
        if bool(model.manifest.rigid_bar) != self.has_rigid_bars:
            raise FormulationError(
                "rigid bars need a load path of their own",
                where=model.manifest.name,
                given=f"{len(model.manifest.rigid_bar)} rigid bars",
                allowed="BarPath with rigid bars, ModelPath without",
                hint="call build_path(model, pattern)",
            )
        self._force = next((name for name in FORCES if model.has(name)), "")
        if not self._force or not model.has("tangent_stiffness"):
            require_quantities(model, LOAD_PATH_QUANTITIES, PURPOSE)
        if all(item.name != "node_load" for item in model.manifest.arguments):
            raise FormulationError(
                "a load path needs loads that may change at run time",
                where=model.manifest.name,
                hint='build the model with [parameters] node_load = "all"',
            )
        given = dict(arguments or {})
        self.base = np.array(given.pop("node_load", model.nominal("node_load")), dtype=float)
        self.pattern = np.array(pattern, dtype=float)
        _check_pattern(self.pattern, self.base.shape)
        self.size = len(model.manifest.coordinate_name)
        self.arguments = {**given, "velocity": np.zeros(self.size)}
        self._load = self._constant_load() if model.manifest.coordinate_node_axis else None
        if self._load is None:
            require_quantities(model, ("node_jacobian",), PURPOSE)

    def offers(self, quantity: str) -> bool:
        """Return whether `compute` gives the quantity."""
        return self.model.has(quantity)

    def compute(self, quantity: str, coordinate: FloatArray, load_factor: float) -> Any:
        """Return a quantity of the model at a point of the path."""
        load = self.base + load_factor * self.pattern
        return self.model.compute(quantity, coordinate=coordinate, node_load=load, **self.arguments)

    def residual(self, coordinate: FloatArray, load_factor: float, /) -> FloatArray:
        """Return the static force on every coordinate, (n,)."""
        return np.asarray(self.compute(self._force, coordinate, load_factor))

    def stiffness(self, coordinate: FloatArray, load_factor: float, /) -> Any:
        """Return the tangent stiffness, sparse (n, n)."""
        return self.compute("tangent_stiffness", coordinate, load_factor)

    def load_vector(self, coordinate: FloatArray, load_factor: float, /) -> FloatArray:
        """Return the generalised force of the pattern, (n,)."""
        if self._load is not None:
            return self._load
        jacobian = self.compute("node_jacobian", coordinate, load_factor)
        return np.asarray(jacobian.T @ self._spread().ravel())

    def neutral_motions(self) -> NeutralMotions | None:
        """Return the finder of rigid motions that cost no force; None where the anchors permit none."""
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
        else:
            jacobian = self.compute("node_jacobian", self.model.nominal("coordinate").ravel(), 0.0)
            moves = np.asarray(abs(jacobian).sum(axis=1)).reshape(loaded.shape) > 0
        held = loaded.any(axis=1) & ~(loaded & moves).any(axis=1)
        return tuple(manifest.node_name[node] for node in np.flatnonzero(held))

    def _constant_load(self) -> FloatArray:
        manifest = self.model.manifest
        column = {axis: k for k, axis in enumerate(manifest.axes)}
        spread = self._spread()
        return np.array([spread[node, column[axis]] for node, axis in manifest.coordinate_node_axis])

    def _spread(self) -> FloatArray:
        """Return the pattern over all nodes, (n_nodes, n_axes)."""
        manifest = self.model.manifest
        spread = np.zeros((len(manifest.node_name), len(manifest.axes)))
        rows = [manifest.node_name.index(name) for name in manifest.argument("node_load").over]
        spread[rows] = self.pattern
        return spread


def watch_slack(path: ModelPath, members: Sequence[str]) -> Watch:
    """Return the watch of l - rho of these members: at zero a cable goes slack or taut, the stiffness jumps.

    Raises FormulationError where the model lacks member_extension, UnknownNameError for unknown members.
    """
    rows = _find_rows(members, path.model.manifest.member_name, "members")
    require_quantities(path.model, ("member_extension",), PURPOSE)

    def extension(coordinate: FloatArray, load_factor: float) -> FloatArray:
        return np.asarray(path.compute("member_extension", coordinate, load_factor))[rows]

    return Watch("slack", tuple(members), extension, rising="taut", is_kink=True)


def watch_contact(path: ModelPath, pairs: Sequence[str] | None = None, *, stops: bool = True) -> Watch:
    """Return the watch of the distances between bars; pairs: names as "bar1_bar2", all by default.

    stops: the path ends at the first contact, since beyond it bars pass through each other.
    Raises FormulationError where the model lacks bar_distance, UnknownNameError for unknown pairs.
    """
    require_quantities(path.model, ("bar_distance",), PURPOSE)
    known = path.model.manifest.bar_pair_name
    names = known if pairs is None else tuple(pairs)
    rows = _find_rows(names, known, "pairs of bars")

    def distance(coordinate: FloatArray, load_factor: float) -> FloatArray:
        return np.asarray(path.compute("bar_distance", coordinate, load_factor))[rows]

    return Watch("contact", names, distance, rising="separation", stops=stops)


def _find_rows(names: Sequence[str], known: Sequence[str], what: str) -> list[int]:
    for name in names:
        if name not in known:
            raise UnknownNameError(
                "the name is not defined",
                where="watch",
                given=name,
                allowed=f"names of {what}",
                hint=suggest(name, known),
            )
    return [known.index(name) for name in names]


def _check_pattern(pattern: FloatArray, shape: tuple[int, ...]) -> None:
    if pattern.shape != shape or not np.isfinite(pattern).all() or not pattern.any():
        raise InvalidValueError(
            "the load pattern is no load",
            where="pattern",
            given=pattern.shape if pattern.shape != shape else pattern,
            allowed=f"finite numbers of shape {shape}, not all zero",
        )
