"""What the options of `build` change of a scene's request."""

from collections.abc import Sequence
from dataclasses import replace

from tensegrity_codegen.codegen.compilation.flags import find_flags
from tensegrity_codegen.tables.precision import find_precision
from tensegrity_codegen.tables.presets import find_preset
from tensegrity_codegen.tables.request import ModelRequest, check_batch_width, check_interfaces


def use_preset(request: ModelRequest, name: str | None) -> ModelRequest:
    """Return the request with the settings of a preset in place of the scene's."""
    return request if name is None else replace(request, **find_preset(name, "--preset").settings)


def narrow_request(
    request: ModelRequest,
    quantity: list[str] | None,
    precision: str | None,
    emitter: str | None,
    batch_width: int | None,
    flags: str | None,
) -> ModelRequest:
    """Return the request with the choices of the command line in place of the scene's."""
    if quantity:
        # Without the acceleration there is nothing to integrate.
        integrators = request.integrators if "acceleration" in quantity else ()
        minimised = {"potential_energy", "tangent_stiffness"} <= set(quantity)
        solvers = request.solvers if minimised else ()
        request = request.wanting(*quantity, integrators=integrators, solvers=solvers)
    if precision is not None:
        request = replace(request, precision=find_precision(precision, "--precision").name)
    if emitter is not None:
        request = replace(request, emitter=emitter)
    if batch_width is not None:
        check_batch_width(batch_width, "--batch-width")
        request = replace(request, batch_width=batch_width)
    if flags is not None:
        request = replace(request, flags=find_flags(flags, "--flags").name)
    return request


def add_interfaces(request: ModelRequest, interfaces: Sequence[str]) -> ModelRequest:
    """Return the request with the interfaces of the command line besides the scene's."""
    check_interfaces(interfaces, "--interface")
    return replace(request, interfaces=tuple(dict.fromkeys((*request.interfaces, *interfaces))))
