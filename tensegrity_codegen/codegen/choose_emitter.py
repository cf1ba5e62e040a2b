"""Choice of the emitter where the scene leaves it open: `model.emitter = "auto"`.

The rule is a function of a few facts; where its numbers come from: docs/decisions/0014-auto-emitter.md.
If an emitter or a formulation does not serve a request, hints name choices that do, each of which was
tried: a hint that leads to another refusal is worse than none.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tensegrity_codegen.codegen.integrators.events import find_events
from tensegrity_codegen.codegen.table.emitter import TABLE
from tensegrity_codegen.codegen.unrolled import MAX_MEMBERS
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.ground_support import needs_state_jacobian
from tensegrity_codegen.structure.sliding import has_rings
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError, TensegrityError
from tensegrity_codegen.system.summaries import describe_count
from tensegrity_codegen.tables.formulations import FORMULATIONS, choose_formulation, find_formulation
from tensegrity_codegen.tables.integrators import called_quantities
from tensegrity_codegen.tables.request import ModelRequest

AUTO = "auto"
MAX_STRAIGHT_LINE_MEMBERS = (
    100  # members up to which straight-line code is faster than loops and compiles quickly
)


@dataclass(frozen=True)
class EmitterFacts:
    """Facts that the choice depends on.

    lacking: wanted quantities that the emitter table does not serve.
    most_members: largest number of members that the emitter unrolled takes.
    has_rings: whether cables slide through rings.
    """

    formulation: str
    n_members: int
    lacking: tuple[str, ...] = ()
    most_members: int = MAX_MEMBERS
    has_rings: bool = False


@dataclass(frozen=True)
class EmitterChoice:
    """The name of an emitter, and a sentence that says why it was chosen."""

    name: str
    why: str


def choose_emitter(facts: EmitterFacts) -> EmitterChoice:
    """Return the emitter for these facts."""
    count = facts.n_members
    members = describe_count(count, "member")
    emitters = find_formulation(facts.formulation).emitters
    if facts.has_rings:
        return EmitterChoice("unrolled", "cables through rings: the only emitter that knows them")
    if "table" not in emitters:
        return EmitterChoice("unrolled", f"the only emitter for the formulation {facts.formulation!r}")
    if count <= MAX_STRAIGHT_LINE_MEMBERS:
        return EmitterChoice("unrolled", f"{members}: code without tables is fastest")
    if facts.lacking and count <= facts.most_members:
        why = f"{members}, and loops over tables do not serve {', '.join(facts.lacking)}"
        return EmitterChoice("unrolled", why)
    return EmitterChoice(
        "table", f"{members}, more than {MAX_STRAIGHT_LINE_MEMBERS}: loops whose code does not grow"
    )


def find_facts(structure: Subject, request: ModelRequest) -> EmitterFacts:
    """Return the facts of the choice; those that make no difference keep their defaults."""
    facts = EmitterFacts(request.formulation, structure.n_members)
    if has_rings(structure):
        return replace(facts, has_rings=True)
    is_open = MAX_STRAIGHT_LINE_MEMBERS < facts.n_members <= MAX_MEMBERS
    if "table" in find_formulation(request.formulation).emitters and is_open:
        try:
            return replace(facts, lacking=_find_lacking(structure, request))
        except FormulationError:  # options that loops do not have
            return replace(facts, lacking=("rigid bars with these options",))
    return facts


def list_candidates(structure: Subject, request: ModelRequest) -> tuple[str, ...]:
    """Return the emitters worth a measurement: the one named, or all that write different code."""
    if request.emitter != AUTO or has_rings(structure):
        return ("unrolled" if request.emitter == AUTO else request.emitter,)
    return ("unrolled", "table")


def _find_lacking(structure: Subject, request: ModelRequest) -> tuple[str, ...]:
    """Return the quantities, also of integrators, that the emitter table does not serve."""
    quantities = [
        *request.quantities,
        *called_quantities(request.integrators, needs_state_jacobian(structure)),
    ]
    quantities += find_events(request, lambda _: True, structure)[1]
    model = TABLE.build(structure, request)
    return tuple(name for name in dict.fromkeys(quantities) if not TABLE.is_offered(model, name))


MAX_CHOICES_IN_HINT = 2
NEARLY_RIGID_RATIO = 1000.0  # stiffness of a bar over that of the stiffest cable
STIFFEN_BARS_HINT = "give the bars a stiffness, 1,000 times that of the cables is nearly rigid"
EMITTERS = ("unrolled", "table")
CheckRequest = Callable[[Subject, ModelRequest], Any]  # raises where the request cannot be served


@dataclass(frozen=True)
class Alternative:
    """Words for another choice, and the structure and request that it makes."""

    words: str
    structure: Subject
    request: ModelRequest
    is_other_model: bool = False  # which may lack quantities of the present one


def find_alternatives(
    structure: Subject, request: ModelRequest, error: FormulationError, check_request: CheckRequest
) -> str:
    """Return a hint of choices that `check_request` accepts, the error's own hint if there is none.

    check_request: raises TensegrityError for a request that cannot be served. A choice that leaves a fault
    which no choice mends, such as bars without a radius, is named with its remedy.
    """
    hints: list[str] = []
    partly: list[str] = []
    for choice in list_alternatives(structure, request, error):
        words, fault_hint = _try_alternative(choice, set(error.lacking or ()), check_request)
        if words:
            (partly if fault_hint else hints).append(f"{words}, and {fault_hint}" if fault_hint else words)
        if len(hints) == MAX_CHOICES_IN_HINT:
            break
    hints = hints or partly[:1]
    if hints and error.lacking and "did you mean" in error.hint:
        hints.append(error.hint)
    if not hints and structure.n_members > MAX_MEMBERS:
        hints = [f"a structure of at most {MAX_MEMBERS} members", *([error.hint] if error.lacking else [])]
    return "; or ".join(hints) or error.hint


def _try_alternative(choice: Alternative, needed: set[str], check_request: CheckRequest) -> tuple[str, str]:
    """Return the words of an alternative, "" for one that does not work, and the hint of another fault."""
    request, dropped, fault_hint = choice.request, list[str](), ""
    while True:
        try:
            check_request(choice.structure, request)
        except FormulationError as error:
            lacking = set(error.lacking or ())
            quantities = tuple(name for name in request.quantities if name not in lacking)
            if error.lacking is None:
                fault_hint = error.hint
                break
            if (
                not choice.is_other_model
                or not quantities
                or quantities == request.quantities
                or lacking & needed
            ):
                return "", ""
            dropped += sorted(lacking)
            request = replace(request, quantities=quantities)
        except TensegrityError:
            return "", ""
        else:
            break
    return (f"{choice.words} (which has no {', '.join(dropped)})" if dropped else choice.words), fault_hint


def list_alternatives(
    structure: Subject, request: ModelRequest, error: FormulationError
) -> Iterator[Alternative]:
    """Yield the choices that may serve where this request does not, the least changes first."""
    lacking = error.lacking or ()
    for name in EMITTERS:
        if name != request.emitter:
            yield Alternative(f'emitter = "{name}"', structure, replace(request, emitter=name))
    if isinstance(structure, Structure):
        yield from _list_formulations(structure, request)
    quantities = tuple(name for name in request.quantities if name not in lacking)
    if lacking and quantities:
        advice = f"leave out {', '.join(name for name in request.quantities if name in lacking)}"
        yield Alternative(advice, structure, replace(request, quantities=quantities))
    if "node_mass" in request.parameters:
        parameters = {name: indices for name, indices in request.parameters.items() if name != "node_mass"}
        yield Alternative(
            "leave node_mass out of parameters", structure, replace(request, parameters=parameters)
        )
    if isinstance(structure, Structure) and structure.is_rigid.any():
        rigid = choose_formulation(rigid_bars=True).name
        springs = replace(request, formulation=rigid, options={})
        # The structure with springs in place of its rigid bars.
        with np.errstate(divide="ignore", invalid="ignore"):
            mu = np.nan_to_num(structure.mu)
        stiff = NEARLY_RIGID_RATIO * max(float(mu.max(initial=0.0)), 1.0)
        constants = np.where(structure.is_rigid, stiff, structure.spring_constant)
        for choice in _list_formulations(structure.with_changes(spring_constant=constants), springs):
            if choice.request.formulation != rigid:
                yield replace(choice, words=f"{STIFFEN_BARS_HINT}, and {choice.words}")


def _list_formulations(structure: Structure, request: ModelRequest) -> Iterator[Alternative]:
    variants = [
        (formulation.name, dict(variant))
        for formulation in FORMULATIONS.values()
        for variant in formulation.variants
    ]
    for name, options in variants:
        if (name, options) == (request.formulation, dict(request.options)):
            continue
        advice = f'formulation = "{name}"' if name != request.formulation else ""
        if options:
            inside = ", ".join(f'{key} = "{value}"' for key, value in options.items())
            advice = f"{advice}{' with ' if advice else ''}options = {{ {inside} }}"
        if advice:
            changed = replace(request, formulation=name, options=options, emitter=AUTO)
            yield Alternative(advice, structure, changed, is_other_model=True)
