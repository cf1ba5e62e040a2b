"""From a symbolic model to C text: one function an emitter, chosen by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from tensegrity_codegen.codegen.describe import describe
from tensegrity_codegen.codegen.left_out import account_left_out, is_offered, with_feature
from tensegrity_codegen.codegen.prune import PrunedFunction, prune
from tensegrity_codegen.codegen.unrolled import PROJECTION, check_unrollable, emit_unrolled
from tensegrity_codegen.errors import FormulationError, suggest
from tensegrity_codegen.manifest import LeftOut, Manifest
from tensegrity_codegen.request import ModelRequest
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.symbolic.model import SymbolicModel

__all__ = ["EMITTERS", "GeneratedSource", "emit"]

EMITTERS: dict[str, Callable[..., dict[str, str]]] = {"unrolled": emit_unrolled}


@dataclass(frozen=True)
class GeneratedSource:
    """Generated files by name, and the manifest that describes them."""

    manifest: Manifest
    files: dict[str, str]


def emit(
    structure: Subject,
    request: ModelRequest,
    object_size: Callable[[dict[str, str]], int] | None = None,
) -> GeneratedSource:
    """Return the C source of what `request` wants of `structure`.

    object_size: bytes of object code of some sources; with it, what was left out is compiled too and its
    bytes are measured instead of estimated.
    Raises FormulationError for what the formulation or the emitter cannot serve.
    """
    if request.emitter not in EMITTERS:
        raise FormulationError(
            "unknown emitter",
            where="model.emitter",
            given=request.emitter,
            hint=suggest(request.emitter, EMITTERS),
        )
    request = _with_projection(structure, request)
    functions, model = _prune(structure, request)
    left_out = account_left_out(model, request, functions)
    if object_size is not None:
        own = object_size(_sources(model, request, functions))
        left_out = tuple(_measure(model, request, row, own, object_size) for row in left_out)
    manifest = describe(model, request, functions, left_out)
    return GeneratedSource(manifest, EMITTERS[request.emitter](manifest, functions))


def _prune(structure: Subject, request: ModelRequest) -> tuple[tuple[PrunedFunction, ...], SymbolicModel]:
    check_unrollable(structure)
    model = build_model(structure, request)
    return prune(model, request.quantities), model


def _with_projection(structure: Subject, request: ModelRequest) -> ModelRequest:
    """Return the request with the functions by which integrators keep redundant coordinates consistent."""
    if not request.integrators:
        return request
    check_unrollable(structure)
    model = build_model(structure, request)
    wanted = [name for name in PROJECTION if name not in request.quantities and is_offered(model, name)]
    return replace(request, quantities=(*request.quantities, *wanted))


def _sources(
    model: SymbolicModel, request: ModelRequest, functions: tuple[PrunedFunction, ...]
) -> dict[str, str]:
    return EMITTERS[request.emitter](describe(model, request, functions, ()), functions)


def _measure(
    model: SymbolicModel,
    request: ModelRequest,
    row: LeftOut,
    own: int,
    object_size: Callable[[dict[str, str]], int],
) -> LeftOut:
    structure, wider = with_feature(row.what, model.subject, request)
    functions, variant = _prune(structure, wider)
    return replace(row, object_bytes=object_size(_sources(variant, wider, functions)) - own, measured=True)
