"""Derivatives of motions as states: which functions they call, and what the templates read."""

from typing import Any

from tensegrity_codegen.symbolic.model import Frame
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.quantities import PARAMETERS

STARTS = ("coordinate", "velocity")  # columns whose derivatives begin with one


def list_column_quantities(frame: Frame | Manifest) -> tuple[str, ...]:
    """Return the quantities that the rates of the columns call; none without columns."""
    if not frame.column_name:
        return ()
    starts = tuple(f"{name}." for name in STARTS)
    of_parameters = any(not name.startswith(starts) for name in frame.column_name)
    of_state = ("state_derivative", "state_jacobian", "margin_state_jacobian")
    return (*of_state, *(("parameter_jacobian", "margin_parameter_jacobian") if of_parameters else ()))


def columns_context(manifest: Manifest) -> dict[str, Any] | None:
    """Return sizes, and of each run-time parameter its column and its scale; None without columns."""
    if not manifest.column_name:
        return None
    parameters = [item for item in manifest.arguments if item.name in PARAMETERS]
    wanted = {name.partition(".")[0] for name in manifest.column_name}
    first = sum(name.partition(".")[0] in STARTS for name in manifest.column_name)
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
