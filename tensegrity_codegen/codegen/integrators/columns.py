"""Derivatives of motions as states: which functions they call, and what the templates read."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from tensegrity_codegen.symbolic.model import Frame
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.manifest import COLUMN_STARTS, Manifest
from tensegrity_codegen.tables.quantities import PARAMETERS
from tensegrity_codegen.tables.request import ModelRequest


def list_column_quantities(frame: Frame | Manifest) -> tuple[str, ...]:
    """Return the quantities that the rates of the columns call; none without columns."""
    if not frame.column_name:
        return ()
    of_parameters = any(name.partition(".")[0] not in COLUMN_STARTS for name in frame.column_name)
    of_state = ("state_derivative", "state_jacobian", "margin_state_jacobian")
    return (*of_state, *(("parameter_jacobian", "margin_parameter_jacobian") if of_parameters else ()))


def check_jumps(subject: Any, request: ModelRequest, events: Sequence[str]) -> None:
    """Raise FormulationError where derivatives would miss jumps of forces, since no event finds them.

    A cable with damping, in the scene or at run time, pulls with a jump as it becomes taut. events: the kinds
    that integrators watch.
    """
    changeable = np.isin(np.arange(subject.n_members), request.parameters.get("damping", ()))
    jumps = subject.tension_only & ((subject.damping > 0) | changeable)
    if request.columns and jumps.any() and "cable" not in events:
        names = [subject.member_name[e] for e in np.flatnonzero(jumps)]
        raise FormulationError(
            "forces jump where damped cables become taut, and no event of the library finds that",
            where=f"{subject.name}: columns",
            given=", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else ""),
            allowed='cables without damping, or the event "cable" among model.events',
            hint='add "cable" to model.events',
        )


def columns_context(manifest: Manifest) -> dict[str, Any] | None:
    """Return sizes, and of each run-time parameter its column and its scale; None without columns."""
    if not manifest.column_name:
        return None
    parameters = [item for item in manifest.arguments if item.name in PARAMETERS]
    wanted = {name.partition(".")[0] for name in manifest.column_name}
    first = sum(name.partition(".")[0] in COLUMN_STARTS for name in manifest.column_name)
    place: list[int] = []
    scale: list[float] = []
    for item in parameters:
        size, is_wanted = len(item.nominal), item.name in wanted
        place += [first + k if is_wanted else -1 for k in range(size)]
        scale += [manifest.column_scale[first + k] if is_wanted else 1.0 for k in range(size)]
        first += size if is_wanted else 0
    n = 2 * len(manifest.coordinate_name) + len(manifest.internal_name)
    of_parameters = "parameter_jacobian" in list_column_quantities(manifest)
    count = len(manifest.column_name)
    cables = next((item.shape[0] for item in manifest.functions if item.quantity == "cable_margin"), 0)
    of_margins = any(item.quantity == "margin_parameter_jacobian" for item in manifest.functions)
    sizes = {"cables": cables, "moved": n, "count": count, "place": place, "scale": scale}
    return sizes | {"of_parameters": of_parameters, "of_margins": of_margins}
