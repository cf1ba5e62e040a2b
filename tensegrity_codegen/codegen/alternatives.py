"""Alternatives where an emitter or a formulation does not serve a request: choices that do, each tried.

A hint that leads to another refusal is worse than none, so that nothing is named here that was not tried.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tensegrity_codegen.codegen.choose_emitter import AUTO
from tensegrity_codegen.codegen.unrolled import MOST_MEMBERS
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError, TensegrityError
from tensegrity_codegen.tables.formulations import FORMULATIONS, choose_formulation
from tensegrity_codegen.tables.request import ModelRequest

MOST_CHOICES_IN_HINT = 2
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
    """Return a hint of choices that `check_request` accepts, the error's own hint where there is none.

    check_request: raises TensegrityError for a request that cannot be served. A choice that leaves a fault
    which no choice mends, such as bars without a radius, is named with what mends that.
    """
    found: list[str] = []
    partly: list[str] = []
    for choice in list_alternatives(structure, request, error):
        words, rest = _try_alternative(choice, set(error.lacking or ()), check_request)
        if words:
            (partly if rest else found).append(f"{words}, and {rest}" if rest else words)
        if len(found) == MOST_CHOICES_IN_HINT:
            break
    found = found or partly[:1]
    if found and error.lacking and "did you mean" in error.hint:
        found.append(error.hint)
    if not found and structure.n_members > MOST_MEMBERS:
        found = [f"a structure of at most {MOST_MEMBERS} members", *([error.hint] if error.lacking else [])]
    return "; or ".join(found) or error.hint


def _try_alternative(choice: Alternative, needed: set[str], check_request: CheckRequest) -> tuple[str, str]:
    """Return the words of an alternative, "" for one that does not work, and the hint of another fault.

    needed: quantities that it must have.
    """
    request, dropped, rest = choice.request, list[str](), ""
    while True:
        try:
            check_request(choice.structure, request)
        except FormulationError as error:
            lacking = set(error.lacking or ())
            kept = tuple(name for name in request.quantities if name not in lacking)
            if error.lacking is None:
                rest = error.hint
                break
            if not choice.is_other_model or not kept or kept == request.quantities or lacking & needed:
                return "", ""
            dropped += sorted(lacking)
            request = replace(request, quantities=kept)
        except TensegrityError:
            return "", ""
        else:
            break
    return (f"{choice.words} (which has no {', '.join(dropped)})" if dropped else choice.words), rest


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
    kept = tuple(name for name in request.quantities if name not in lacking)
    if lacking and kept:
        words = f"leave out {', '.join(name for name in request.quantities if name in lacking)}"
        yield Alternative(words, structure, replace(request, quantities=kept))
    if "node_mass" in request.parameters:
        parameters = {name: items for name, items in request.parameters.items() if name != "node_mass"}
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
    variants = [(item.name, dict(words)) for item in FORMULATIONS.values() for words in item.variants]
    for name, options in variants:
        if (name, options) == (request.formulation, dict(request.options)):
            continue
        words = f'formulation = "{name}"' if name != request.formulation else ""
        if options:
            inside = ", ".join(f'{key} = "{value}"' for key, value in options.items())
            words = f"{words}{' with ' if words else ''}options = {{ {inside} }}"
        if words:
            changed = replace(request, formulation=name, options=options, emitter=AUTO)
            yield Alternative(words, structure, changed, is_other_model=True)
