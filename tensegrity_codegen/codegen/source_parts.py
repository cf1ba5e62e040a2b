"""Parts of a C source besides its functions: those that were asked for, or that the scene needs."""

from collections.abc import Sequence

from tensegrity_codegen.codegen.compilation.flags import find_flags
from tensegrity_codegen.tables.manifest import IntegratorSpec, SourcePart
from tensegrity_codegen.tables.request import ModelRequest


def list_parts(
    request: ModelRequest, integrators: Sequence[IntegratorSpec], driven: Sequence[str], n_slack: int
) -> tuple[SourcePart, ...]:
    """Return the optional parts of a C source, with the reason for each that is there or not.

    Parameters
    ----------
    request : ModelRequest
        What is wanted of the structure.
    integrators : sequence of IntegratorSpec
        The integrators of the library, with the events that each can watch.
    driven : sequence of str
        The arguments that can change with time.
    n_slack : int
        Number of members that can go slack.

    Returns
    -------
    tuple of SourcePart
        One entry for each optional part, in the order in which they stand in the file.
    """
    return (
        _machine_check(request),
        _batch_functions(request),
        _event_search(request, integrators, n_slack),
        _energy_correction(integrators),
        _profiles(integrators, driven),
        _casadi_interface(request),
    )


def _machine_check(request: ModelRequest) -> SourcePart:
    if find_flags(request.flags).portable:
        why = f"flags {request.flags!r} suit every machine of an architecture"
        return SourcePart("machine_check", False, why)
    return SourcePart("machine_check", True, f"flags {request.flags!r} use what one machine has")


def _batch_functions(request: ModelRequest) -> SourcePart:
    if not request.batch_width:
        return SourcePart("batch_functions", False, "batch_width is 0")
    return SourcePart("batch_functions", True, f"batch_width is {request.batch_width}")


def _event_search(request: ModelRequest, integrators: Sequence[IntegratorSpec], n_slack: int) -> SourcePart:
    kinds = dict.fromkeys(kind for item in integrators for kind in item.events)
    if kinds:
        why = f"integrators monitor {', '.join(kinds)}"
        if "cable" in kinds:
            why += f"; {n_slack} members can go slack, and a step across that loses its order"
        return SourcePart("event_search", True, why)
    if not integrators:
        return SourcePart("event_search", False, "there is no integrator")
    if request.events is None and n_slack == 0:
        return SourcePart("event_search", False, "no member can go slack, and events names no kind")
    return SourcePart("event_search", False, f"{n_slack} members can go slack, and events names no kind")


def _energy_correction(integrators: Sequence[IntegratorSpec]) -> SourcePart:
    names = [item.name for item in integrators if item.keeps]
    if names:
        return SourcePart("energy_correction", True, f"keep names energy, for {', '.join(names)}")
    return SourcePart("energy_correction", False, "keep does not name energy")


def _profiles(integrators: Sequence[IntegratorSpec], driven: Sequence[str]) -> SourcePart:
    if driven:
        return SourcePart(
            "profiles", True, f"integrators take inputs; {', '.join(driven)} can change with time"
        )
    if not integrators:
        return SourcePart("profiles", False, "there is no integrator")
    return SourcePart("profiles", False, "no motion depends on an input")


def _casadi_interface(request: ModelRequest) -> SourcePart:
    if request.interfaces:
        return SourcePart("casadi_interface", True, f"interfaces names {', '.join(request.interfaces)}")
    return SourcePart("casadi_interface", False, "interfaces does not name casadi")
