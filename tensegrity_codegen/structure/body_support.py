"""Requests that know free rigid bodies, and the error of those that do not."""

from typing import Any

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest

FORMULATION_OF_BODIES = "rigid_bar"
EMITTERS_WITH_BODIES = ("auto", "unrolled")


def has_free_bodies(subject: Any) -> bool:
    """Return whether a structure has rigid bodies beside its nodes."""
    return isinstance(subject, Structure) and bool(subject.bodies)


def require_no_bodies(subject: Any, what: str, hint: str = "") -> None:
    """Raise FormulationError for rigid bodies beside nodes; what: names what does not know them."""
    if has_free_bodies(subject):
        raise FormulationError(
            f"rigid bodies are not supported here: {what}",
            where=f"{subject.name}: bodies.{subject.bodies[0].name}",
            allowed="nodes and members alone",
            hint=hint or "describe thin rods as members of kind bar",
        )


def check_bodies(subject: Any, request: ModelRequest) -> None:
    """Raise FormulationError for a request that a structure with rigid bodies cannot serve."""
    foreign = {
        f"formulation {request.formulation!r}": request.formulation != FORMULATION_OF_BODIES,
        "rigid bars with correction": request.options.get("correction", "none") != "none",
        f"emitter {request.emitter!r}": request.emitter not in EMITTERS_WITH_BODIES,
    }
    hints = (f'formulation = "{FORMULATION_OF_BODIES}"', 'choose correction = "none"', 'emitter = "auto"')
    for (feature, is_foreign), hint in zip(foreign.items(), hints, strict=True):
        if is_foreign:
            require_no_bodies(subject, feature, hint)
