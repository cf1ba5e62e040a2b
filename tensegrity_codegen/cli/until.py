"""What `--until` names: the first contact of two bars, or a condition over quantities."""

from dataclasses import replace
from typing import TYPE_CHECKING

from tensegrity_codegen.system.errors import UnknownNameError, suggest

if TYPE_CHECKING:
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.request import ModelRequest


UNTIL = ("contact",)


def read_until(text: str | None) -> tuple[bool, str | None]:
    """Return whether a contact is meant, and the condition if one is.

    Raises UnknownNameError for a word that is neither, InvalidValueError for what is no expression.
    """
    from tensegrity_codegen.runtime.simulate.condition import find_quantities
    from tensegrity_codegen.tables.quantities import QUANTITIES

    if text is None or text in UNTIL:
        return text is not None, None
    if text.isidentifier() and text not in QUANTITIES and text != "time":
        raise UnknownNameError(
            "unknown event",
            where="--until",
            given=text,
            allowed=f"{', '.join(UNTIL)}, or a condition such as 'top.z < 0.1'",
            hint=suggest(text, UNTIL),
        )
    find_quantities(text)
    return False, text


def watching(structure: "Subject", request: "ModelRequest", kind: str, condition: str = "") -> "ModelRequest":
    """Return the request with integrators that watch a kind of event, and the quantities of a condition."""
    from tensegrity_codegen.codegen.integrators.events import choose_events
    from tensegrity_codegen.runtime.simulate.condition import find_quantities

    events = request.events
    if events is None:
        events = choose_events(request, structure)
    quantities = find_quantities(condition) if condition else ()
    kinds = tuple(dict.fromkeys((*events, kind)))
    return replace(request, quantities=(*request.quantities, *quantities), events=kinds)
