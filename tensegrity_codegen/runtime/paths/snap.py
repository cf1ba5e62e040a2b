"""Has a structure snapped? Its loads are let grow from zero, and the path is compared with the equilibrium.

Beyond a limit load, or a bifurcation, the branch on which the structure began has no stable equilibrium;
what a search then finds is stable and in balance, and far from there. The path begins where the structure is
given. If it is not in balance there without loads, as before its prestress has settled, it is first held by
the loads that balance it, which are then let go in proportion.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.model.arguments import read_arguments
from tensegrity_codegen.runtime.model.arrays import to_doubles, to_sized
from tensegrity_codegen.runtime.model.interface import Model, require_model
from tensegrity_codegen.runtime.paths.model_path import GROWING
from tensegrity_codegen.runtime.paths.ramp import MOST_FOLLOWED, Ramp, Way
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium, Snap
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance
from tensegrity_codegen.system.errors import InvalidValueError, TensegrityError, check_choice

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
    if base.shape != load.shape:
        raise InvalidValueError("wrong shape", where="base", given=base.shape, allowed=f"shape {load.shape}")
    pattern = load - base
    if not pattern.any():
        return Snap(False)
    ramp = Ramp(
        model, {"node_load": np.asarray(base, dtype=float)}, {"node_load": pattern}, cables, arguments
    )
    try:
        begun = find_equilibrium(model, arguments=ramp.arguments_at(0.0), raise_on_failure=False)
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
    if len(start) > MOST_FOLLOWED:
        return Snap(None, reason=f"paths of more than {MOST_FOLLOWED} coordinates are not followed")
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
    """Return what the way of the loads says of the equilibrium that was found under them."""
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
