"""Support of cables through rings: all that lacks it ends in one error, before any number is computed."""

from typing import Any

from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest

FORMULATIONS_WITH_RINGS = ("node_position", "rigid_bar")
EMITTERS_WITH_RINGS = ("auto", "unrolled")


def has_rings(subject: Any) -> bool:
    """Return whether cables of a structure or body system slide through rings."""
    return bool(getattr(subject, "ring_nodes", ()))


def require_no_rings(subject: Any, what: str, hint: str = "") -> None:
    """Raise FormulationError for cables through rings; what: names what does not know them."""
    if not has_rings(subject):
        return
    cables = [name for name, rings in zip(subject.member_name, subject.ring_nodes, strict=True) if rings]
    raise FormulationError(
        f"cables through rings are not supported here: {what}",
        where=f"{subject.name}: members.{cables[0]}.nodes",
        allowed="two nodes",
        hint=hint or "split the cable at its rings, each part with a tension of its own",
    )


def check_rings(subject: Any, request: ModelRequest) -> None:
    """Raise FormulationError for a request that a structure with cables through rings cannot serve."""
    if request.formulation not in FORMULATIONS_WITH_RINGS:
        either = " or ".join(FORMULATIONS_WITH_RINGS)
        require_no_rings(subject, f"formulation {request.formulation!r}", f"choose {either}")
    if request.options.get("correction", "none") != "none":
        require_no_rings(subject, "rigid bars with correction", 'choose correction = "none"')
    if request.emitter not in EMITTERS_WITH_RINGS:
        require_no_rings(subject, f"emitter {request.emitter!r}", 'choose emitter = "auto"')
