"""The stable equilibrium under loads, and whether the structure snapped on the way there."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.model.arguments import merge_inputs
from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.runtime.paths.model_path import GROWING
from tensegrity_codegen.runtime.paths.snap import find_load_snap, find_snap, join_snaps
from tensegrity_codegen.runtime.statics import equilibrium as search
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium, Snap
from tensegrity_codegen.runtime.statics.newton import Progress
from tensegrity_codegen.structure.pieces import find_chains
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_switch
from tensegrity_codegen.tables.static_methods import Method


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
    Solves dU/dq = 0 with a positive semidefinite Hessian d2U/dq2 (docs/model.md).

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
    """Return which loads that act are constants of the library, an empty text where none are."""
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
