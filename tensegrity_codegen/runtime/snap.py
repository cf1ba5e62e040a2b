"""Has a structure snapped? Its loads are let grow from zero, and the path is compared with the equilibrium.

Beyond a limit load the branch on which the structure began has no equilibrium; what a search then finds is
stable and in balance, and far from there. A path that turns back before the full load, or that ends in other
member lengths, is the evidence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.errors import TensegrityError
from tensegrity_codegen.runtime.bar_path import build_path
from tensegrity_codegen.runtime.continuation import StepControl, follow_path
from tensegrity_codegen.runtime.equilibrium import Equilibrium, find_equilibrium
from tensegrity_codegen.runtime.interface import Model
from tensegrity_codegen.runtime.model_path import watch_slack

__all__ = ["MOST_FOLLOWED", "Snap", "find_snap"]

FloatArray = NDArray[np.float64]

MOST_FOLLOWED = 200  # coordinates up to which the path is followed
MOST_STEPS = 300
SAME = 1e-5  # of the longest member: difference of lengths up to which two equilibria are one


@dataclass(frozen=True)
class Snap:
    """snapped: whether the equilibrium lies off the path that the growing loads lead along, None if unknown.

    limit_load_factor: part of the loads at which that path first turns back, None if it does not.
    """

    snapped: bool | None
    limit_load_factor: float | None = None

    def as_evidence(self) -> dict[str, Any]:
        """Return both by name, JSON-ready."""
        return {"snapped": self.snapped, "limit_load_factor": self.limit_load_factor}


def find_snap(
    model: Model,
    found: Equilibrium,
    base: FloatArray,
    load: FloatArray,
    *,
    cables: Sequence[str] = (),
    arguments: Mapping[str, Any] | None = None,
) -> Snap:
    """Return whether `found`, the equilibrium under `load`, was reached by a jump from that under `base`.

    base, load: values of the run-time argument node_load [N]. cables: members that can go slack; the model
    must have member_extension for them. Unknown where there is no equilibrium to begin with, where the path
    is not followed to its end, and above MOST_FOLLOWED coordinates.
    """
    pattern = np.asarray(load) - np.asarray(base)
    if not pattern.any() or len(found.coordinate) > MOST_FOLLOWED:
        return Snap(None if pattern.any() else False)
    given = {**(arguments or {}), "node_load": np.asarray(base, dtype=float)}
    try:
        begun = find_equilibrium(model, arguments=given, raise_on_failure=False)
        if not begun.is_found:
            return Snap(None)
        path = build_path(model, pattern, given)
        watches = [watch_slack(path, cables)] if cables else []
        control = StepControl(most_steps=MOST_STEPS)
        neutral = path.neutral_motions()
        way = follow_path(path, begun.coordinate, most=1.0, watches=watches, neutral=neutral, control=control)
    except TensegrityError:
        return Snap(None)
    limits = way.find_events("limit")
    if limits:
        return Snap(True, limits[0].load_factor)
    if way.status != "completed":
        return Snap(None)
    length = np.asarray(path.compute("member_length", way.coordinate[-1], 1.0))
    apart = float(np.abs(length - found.member_length).max(initial=0.0))
    return Snap(apart > SAME * float(found.member_length.max(initial=0.0)))
