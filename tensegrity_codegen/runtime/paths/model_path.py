"""A compiled model under a proportional load, as a problem whose load path can be followed.

The arguments that grow, loads on nodes or gravity, are a_0 + lambda a: a_0 the base, a the pattern.
"""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.contacts.rest_memory import find_rest_memory
from tensegrity_codegen.runtime.model.arrays import to_doubles
from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.runtime.model.named_inputs import read_arguments
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.runtime.model.require import require_double, require_model, require_quantities
from tensegrity_codegen.runtime.paths.path_problem import NeutralMotions, Watch
from tensegrity_codegen.runtime.statics.rigid_motion import build_rigid_motions, find_neutral_motions
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance, check_switch
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, check_choice

# What a load path needs of a model in node coordinates; events need member_extension and bar_distance too.
LOAD_PATH_QUANTITIES = ("node_residual", "tangent_stiffness")

Pattern = ArrayLike | Mapping[str, ArrayLike]

GROWING = ("node_load", "gravity")  # arguments that the forces are linear in
PURPOSE = "a load path needs"
FORCES = ("node_residual", "coordinate_force")  # what formulations call g


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
    g(q, lambda) = -dU/dq (docs/model.md, load paths).
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
        given = read_arguments(arguments)
        patterns = dict(pattern) if isinstance(pattern, Mapping) else {"node_load": pattern}
        _check_growing(model, patterns)
        shapes = {name: f"numbers of shape {model.nominal(name).shape}" for name in patterns}
        self.bases = {
            name: to_doubles(given.pop(name, model.nominal(name)), name, shapes[name]).copy()
            for name in patterns
        }
        self.patterns = {
            name: to_doubles(value, "pattern", shapes[name]).copy() for name, value in patterns.items()
        }
        _check_patterns(self.patterns, self.bases)
        self.size = len(model.manifest.coordinate_name)
        self.arguments = {**given, "velocity": np.zeros(self.size)}
        self.memory = find_rest_memory(model, given)
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

    def offers(self, quantity: str) -> bool:
        """Return whether `compute` gives the quantity."""
        return self.model.has(quantity)

    def compute(self, quantity: str, coordinate: FloatArray, load_factor: float) -> Any:
        """Return a quantity of the model at a point of the path."""
        given = self._given(coordinate, load_factor)
        return self.model.compute(quantity, **(self.memory.choose(quantity, given) if self.memory else given))

    def settle(self, coordinate: FloatArray, load_factor: float) -> FloatArray | None:
        """Return the internal states of members there, (n_internal,); None where they have none."""
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

    def _growth(self, coordinate: FloatArray) -> FloatArray:
        """Return what a load factor of 1 adds to the forces on coordinates, (n,); they are linear in it."""
        forces = [np.asarray(self.compute(self._force, coordinate, factor)) for factor in (1.0, 0.0)]
        change: FloatArray = forces[0] - forces[1]
        return change

    def _constant_load(self) -> FloatArray:
        manifest = self.model.manifest
        if "gravity" in self.patterns:
            return self._growth(self.model.nominal("coordinate").ravel())
        column = {axis: k for k, axis in enumerate(manifest.axes)}
        spread = self._spread()
        return np.array([spread[node, column[axis]] for node, axis in manifest.coordinate_node_axis])

    def _spread(self) -> FloatArray:
        """Return the pattern over all nodes, (n_nodes, n_axes)."""
        manifest = self.model.manifest
        spread = np.zeros((len(manifest.node_name), len(manifest.axes)))
        if "node_load" in self.patterns:
            rows = [manifest.node_name.index(name) for name in manifest.argument("node_load").over]
            spread[rows] = self.patterns["node_load"]
        return spread


def watch_slack(path: ModelPath, members: Sequence[str]) -> Watch:
    """Return the monitored function l - rho - q of some cables; at zero a cable goes slack or taut.

    Parameters
    ----------
    path : ModelPath
        The load path.
    members : sequence of str
        Names of the cables.

    Returns
    -------
    Watch
        For follow_path.

    Raises
    ------
    FormulationError
        The model lacks member_extension.
    UnknownNameError
        An unknown member.
    """
    check_instance(path, ModelPath, "path", "what build_path(...) returns")
    rows = _find_rows(members, path.model.manifest.member_name, "members")
    require_quantities(path.model, ("member_extension",), PURPOSE)

    def extension(coordinate: FloatArray, load_factor: float) -> FloatArray:
        found = np.asarray(path.compute("member_extension", coordinate, load_factor))
        if path.model.has("plastic_elongation"):  # rest lengths that have grown
            found = found - path.compute("plastic_elongation", coordinate, load_factor)
        return found[rows]

    return Watch("slack", tuple(members), extension, rising="taut", is_kink=True)


def watch_switch(path: ModelPath, members: Sequence[str] = ()) -> list[Watch]:
    """Return the monitored switches of member laws, where slopes jump; none where the model has none.

    Parameters
    ----------
    path : ModelPath
        The load path.
    members : sequence of str
        Names of the members whose law has a switch, in their order. Without names the path is cut there and
        the switches are no events.

    Returns
    -------
    list of Watch
        For follow_path, one or none.
    """
    check_instance(path, ModelPath, "path", "what build_path(...) returns")
    if not path.model.has("switch_margin"):
        return []
    count = len(np.asarray(path.model.compute("switch_margin")))
    names, kind = (tuple(members), "switch") if members else (("",) * count, "")

    def margin(coordinate: FloatArray, load_factor: float) -> FloatArray:
        return np.asarray(path.compute("switch_margin", coordinate, load_factor))

    return [Watch(kind, names, margin, rising=kind, is_kink=True)]


def watch_yield(path: ModelPath) -> list[Watch]:
    """Return the monitored margins of plastic members, where flow begins; none where the model has none.

    Parameters
    ----------
    path : ModelPath
        The load path.

    Returns
    -------
    list of Watch
        For follow_path, one or none.
    """
    check_instance(path, ModelPath, "path", "what build_path(...) returns")
    if not path.model.manifest.subjects_of("yield"):
        return []
    names = tuple(name.rsplit("_", 1)[0] for name in path.model.manifest.subjects_of("yield"))

    def margin(coordinate: FloatArray, load_factor: float) -> FloatArray:
        return np.asarray(path.compute("yield_margin", coordinate, load_factor))

    return [Watch("yield", names, margin, is_kink=True)]


def watch_contact(path: ModelPath, pairs: Sequence[str] | None = None, *, stops: bool = True) -> Watch:
    """Return the monitored distances between bars; at zero two bars touch.

    Parameters
    ----------
    path : ModelPath
        The load path.
    pairs : sequence of str, optional
        Names of pairs such as ``"bar1_bar2"``; by default all.
    stops : bool
        Whether the path ends at the first contact; beyond it bars pass through each other.

    Returns
    -------
    Watch
        For follow_path.

    Raises
    ------
    FormulationError
        The model lacks bar_distance.
    UnknownNameError
        An unknown pair.
    """
    check_instance(path, ModelPath, "path", "what build_path(...) returns")
    require_quantities(path.model, ("bar_distance",), PURPOSE)
    known = path.model.manifest.bar_pair_name
    rows = _find_rows(known if pairs is None else pairs, known, "pairs of bars")
    names = tuple(known[row] for row in rows)
    check_switch(stops, "stops")

    def distance(coordinate: FloatArray, load_factor: float) -> FloatArray:
        return np.asarray(path.compute("bar_distance", coordinate, load_factor))[rows]

    return Watch("contact", names, distance, rising="separation", stops=stops)


def _find_rows(names: Sequence[str], known: Sequence[str], what: str) -> list[int]:
    check_instance(names, (tuple, list), "watch", f"a list of names of {what}")
    for name in names:
        check_choice(name, known, f"name among {what}", "watch")
    return [known.index(name) for name in names]


def _check_growing(model: Model, patterns: Mapping[str, Any]) -> None:
    """Raise where what is to grow is no load, or no run-time argument of the model."""
    known = {item.name for item in model.manifest.arguments}
    for name in patterns:
        check_choice(name, GROWING, "load", "pattern")
        if name not in known:
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
