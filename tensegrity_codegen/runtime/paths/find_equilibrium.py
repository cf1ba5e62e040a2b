"""The stable equilibrium under loads, and whether the structure snapped on the way there.

Loads are let grow from zero, and the path is compared with the equilibrium. Beyond a limit load, or a
bifurcation, the branch on which the structure began has no stable equilibrium; what a search then finds is
stable and in balance, and far from there. The path begins where the structure is given. If it is not in
balance there without loads, as before its prestress has settled, it is first held by the loads that balance
it, which are then let go in proportion.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.model.arguments import merge_inputs, read_arguments
from tensegrity_codegen.runtime.model.arrays import check_shape, to_doubles, to_sized
from tensegrity_codegen.runtime.model.interface import Model, require_model
from tensegrity_codegen.runtime.paths.model_path import GROWING
from tensegrity_codegen.runtime.paths.ramp import MAX_FOLLOWED, Ramp, Way
from tensegrity_codegen.runtime.statics import equilibrium as search
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium, Snap
from tensegrity_codegen.runtime.statics.newton import Progress
from tensegrity_codegen.structure.pieces import find_chains
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance, check_switch
from tensegrity_codegen.system.errors import TensegrityError, check_choice
from tensegrity_codegen.tables.static_methods import Method

LENGTH_TOLERANCE = 1e-5  # of the longest member: difference of lengths up to which two equilibria are one
POSITION_TOLERANCE = 1e-2  # of the structure's size: the same of positions, neutral motions taken out


def find_snap(
    model: Model,
    found: Equilibrium,
    base: FloatArray,
    load: FloatArray,
    *,
    cables: Sequence[str] = (),
    arguments: Mapping[str, Any] | None = None,
) -> Snap:
    """Return whether the equilibrium under `load` was reached by a jump from that under `base` [N]."""
    _check_call(model, found, cables, arguments)
    base, load = (to_doubles(value, name, "loads [N]") for name, value in (("base", base), ("load", load)))
    check_shape(base, load.shape, "base")
    pattern = load - base
    if not pattern.any():
        return Snap(False)
    ramp = Ramp(
        model, {"node_load": np.asarray(base, dtype=float)}, {"node_load": pattern}, cables, arguments
    )
    try:
        begun = search.find_equilibrium(model, arguments=ramp.arguments_at(0.0), raise_on_failure=False)
        if not begun.is_found:
            return Snap(None, reason=f"no equilibrium was found before the load: {begun.message}")
        return _compare(ramp.follow(begun.coordinate), found)
    except TensegrityError as error:
        return Snap(None, reason=error.problem)


def find_load_snap(
    model: Model,
    found: Equilibrium,
    loads: Mapping[str, ArrayLike],
    *,
    coordinate: ArrayLike | None = None,
    cables: Sequence[str] = (),
    arguments: Mapping[str, Any] | None = None,
) -> Snap:
    """Return whether an equilibrium was reached by a jump while prestress, then all loads, grew from zero."""
    _check_call(model, found, cables, arguments)
    check_instance(loads, Mapping, "loads", "a dictionary of node_load [N] and gravity [m/s2]")
    for name in loads:
        check_choice(name, GROWING, "load", "loads")
    full = {name: to_doubles(value, name, "loads, or gravity") for name, value in loads.items()}
    ramp = Ramp(model, {name: 0 * value for name, value in full.items()}, full, cables, arguments)
    start = model.nominal("coordinate").ravel()
    if coordinate is not None:
        start = to_sized(coordinate, start.shape, "coordinate").ravel()
    if len(start) > MAX_FOLLOWED:
        return Snap(None, reason=f"paths of more than {MAX_FOLLOWED} coordinates are not followed")
    try:
        is_loaded = any(value.any() for value in full.values())
        settled = ramp.settle(start, start if is_loaded else found.coordinate)
        if settled.failed:
            return Snap(None, reason=f"the path of the prestress was not followed: {settled.message}")
        if settled.limit is not None:
            return Snap(True, 0.0, settled.limit, reason=settled.message)
        if not is_loaded:
            return _compare(settled, found)
        return _compare(ramp.follow(settled.coordinate), found)
    except TensegrityError as error:
        return Snap(None, reason=error.problem)


def _check_call(model: Any, found: Any, cables: Any, arguments: Any) -> None:
    """Raise InvalidValueError for arguments of the wrong kinds."""
    require_model(model)
    check_instance(found, Equilibrium, "found", "what find_equilibrium(...) returns")
    check_instance(cables, (tuple, list), "cables", "a list of names of members")
    read_arguments(arguments)


def _compare(way: Way, found: Equilibrium) -> Snap:
    """Return whether growing loads lead to the equilibrium that was found under them."""
    if way.failed:
        return Snap(None, reason=way.message)
    if way.limit is not None:
        return Snap(True, way.limit, reason=way.message)
    difference = float(np.abs(way.member_length - found.member_length).max(initial=0.0))
    moved = found.distance_of(way.node_position)
    if (
        difference <= LENGTH_TOLERANCE * float(found.member_length.max(initial=0.0))
        and not moved > POSITION_TOLERANCE * found.extent
    ):
        return Snap(False)
    return Snap(True, reason="the increasing loads lead to another equilibrium, without a limit point")


def join_snaps(whole: Snap, added: Snap) -> Snap:
    """Combine the results for all loads from zero and for added loads alone: snapped if one of them is."""
    results = [snapped for snapped in (whole.snapped, added.snapped) if snapped is not None]
    snapped = True if True in results else False if len(results) == 2 else None
    return replace(
        whole,
        snapped=snapped,
        limit_added_load_factor=added.limit_load_factor,
        reason=whole.reason or added.reason,
    )


def find_equilibrium(
    model: Model,
    *,
    coordinate: ArrayLike | None = None,
    arguments: Mapping[str, Any] | None = None,
    tolerance: float = 1e-9,
    max_iterations: int = 500,
    method: Method = "auto",
    frictionless: bool = False,
    snap_check: bool = True,
    progress: Progress | None = None,
    raise_on_failure: bool = True,
) -> Equilibrium:
    """Find a stable equilibrium: a local minimum of the potential energy.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"equilibrium"``, see compile_scene.
    coordinate : array_like, shape (n_coordinates,), optional
        Start [m]; by default the positions of the scene.
    arguments : mapping, optional
        Inputs and parameters by name, where they differ from the scene.
    tolerance : float
        Allowed node residual, as a part of the largest member force.
    max_iterations : int
        Largest number of iterations.
    method : str
        ``"newton"`` with damped members, ``"relaxation"`` (dynamic, 40 steps per iteration), or
        ``"auto"``: Newton, and where it fails relaxation followed by Newton.
    frictionless : bool
        On the ground: without friction, whatever its coefficient. With friction, weights and loads grow from
        zero in steps, twice as many until that changes nothing.
    snap_check : bool
        Whether the loads are followed from zero to find out if the structure snapped, see `Equilibrium.snap`.
        That takes about ten times as long as the search.
    progress : callable, optional
        Called with the iteration and the largest node residual [N].
    raise_on_failure : bool
        Whether to raise an error where no equilibrium is found; otherwise its status tells.

    Returns
    -------
    Equilibrium
        Positions, tensions, residual, stability and status.

    Raises
    ------
    UnstableError, ConvergenceError
        No stable equilibrium was found; the error has the evidence.
    InvalidValueError, NonFiniteError, UnknownNameError
        A wrong argument.
    FormulationError
        The model lacks a quantity.

    Notes
    -----
    Solves dU/dq = 0 with a positive semidefinite Hessian d2U/dq2 (docs/statics.md).

    Examples
    --------
    >>> from tensegrity_codegen import compile_scene, find_equilibrium
    >>> model = compile_scene("two_nodes.toml", for_="equilibrium")
    >>> found = find_equilibrium(model)
    >>> found.status, round(float(found.member_length[0]), 6)  # 1 m + 0.5 kg 9.81 m/s2 / (80 N/m)
    ('converged', 1.061313)
    """
    check_switch(snap_check, "snap_check")
    equilibrium = search.find_equilibrium(
        model,
        coordinate=coordinate,
        arguments=arguments,
        tolerance=tolerance,
        max_iterations=max_iterations,
        method=method,
        frictionless=frictionless,
        progress=progress,
        raise_on_failure=raise_on_failure,
    )
    if not snap_check:
        return equilibrium
    return replace(
        equilibrium, snap=judge_snap(model, equilibrium, coordinate=coordinate, arguments=arguments)
    )


def judge_snap(
    model: Model,
    equilibrium: Equilibrium,
    *,
    coordinate: ArrayLike | None = None,
    arguments: Mapping[str, Any] | None = None,
    base: FloatArray | None = None,
) -> Snap:
    """Return whether loads from zero, or those added to `base`, lead to a jump; unknown on the ground."""
    structure = equilibrium.structure
    if not equilibrium.is_found:
        return Snap(None, reason="no equilibrium was found")
    if equilibrium.slid:
        return Snap(None, reason="paths do not know friction at rings")
    # On the ground the loads have grown already; without its weight a chain has no stiffness.
    if equilibrium.feet is not None or (isinstance(structure, Structure) and find_chains(structure)):
        return Snap(None)
    constant = _name_constant_loads(model)
    if structure is None or constant:
        return Snap(None, reason=f"{constant} cannot grow from zero: they are constants of the library")
    inputs = merge_inputs(model.manifest, arguments)
    changing = {argument.name for argument in model.manifest.arguments}
    loads = {
        name: np.asarray(inputs.pop(name, model.nominal(name)), dtype=np.float64)
        for name in GROWING
        if name in changing
    }
    weight = {name: value for name, value in loads.items() if name == "gravity" and value.any()}
    loads = {"node_load": loads["node_load"], **weight}
    members = zip(structure.member_name, structure.is_bar, strict=True)
    cables = [name for name, bar in members if not bar and model.has("member_extension")]
    total = find_load_snap(model, equilibrium, loads, coordinate=coordinate, cables=cables, arguments=inputs)
    initial_load = model.nominal("node_load") if base is None else base
    if not (loads["node_load"] - initial_load).any() or not (initial_load.any() or weight):
        return total
    added = find_snap(
        model, equilibrium, initial_load, loads["node_load"], cables=cables, arguments=inputs | weight
    )
    return join_snaps(total, added)


def _name_constant_loads(model: Model) -> str:
    """Return which loads that act are constants of the library, an empty text if none are."""
    structure = getattr(model, "structure", None)
    changing = {argument.name: argument.over for argument in model.manifest.arguments}
    if structure is None or "node_load" not in changing:
        return "loads"
    loaded = {name for name, load in zip(structure.node_name, structure.node_load, strict=True) if load.any()}
    if not loaded <= set(changing["node_load"]):
        return "loads of other nodes than those under [parameters] node_load"
    axes = list(model.manifest.axes)
    is_heavy = bool(np.array(structure.gravity)[axes].any())
    return "weights" if is_heavy and "gravity" not in changing else ""
