"""All cases of a scene with all methods, judged."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np

from tensegrity_codegen.errors import TensegrityError
from tensegrity_codegen.structure import Structure
from tensegrity_codegen.studies.stability.cases import Case, generate_cases
from tensegrity_codegen.studies.stability.judge import Judgement, Truth, certify_case, judge, judge_peer
from tensegrity_codegen.studies.stability.models import (
    EXPLICIT,
    FIXED,
    FOR_STIFF_BARS,
    CaseModels,
    list_methods,
)
from tensegrity_codegen.studies.stability.own import Ending, run_own
from tensegrity_codegen.studies.stability.peers import list_peers, run_peer
from tensegrity_codegen.studies.stability.second_opinion import certify_extended
from tensegrity_codegen.studies.work_precision.problem import set_problem

__all__ = ["Limits", "Outcome", "run_case", "run_cases"]

Progress = Callable[[float], None]

REFERENCES = (*EXPLICIT, FOR_STIFF_BARS)  # the quickest first; auto is one of them


@dataclass(frozen=True)
class Limits:
    """Seconds that a run may take, and a reference; peers: whether they are run too.

    compiles: whether a reference may be compiled for one case alone, where two methods do not certify it.
    """

    run: float = 10.0
    reference: float = 20.0
    peers: bool = True
    compiles: bool = True


@dataclass(frozen=True)
class Outcome:
    """One case with one method.

    error: of ours, the largest certified error over the tolerance; of a peer, the largest error of a
    coordinate [m]; None where nothing certifies. rule: one of RULES by which it was judged, "" where none;
    tension_error: of ours, the largest error of a tension over the largest tension.
    """

    group: str
    case: str
    contender: str
    is_own: bool
    verdict: str
    error: float | None
    status: str
    message: str
    seconds: float
    rule: str
    tension_error: float | None

    def as_dict(self) -> dict[str, Any]:
        """Return the outcome in JSON's types."""
        return dataclasses.asdict(self)


def run_cases(
    structure: Structure,
    t_end: float,
    limits: Limits,
    *,
    compiler: str | None,
    flags: str,
    progress: Progress | None,
) -> tuple[Outcome, ...]:
    """Return the outcomes of all cases of a structure, at rest or not, with springs or rigid bars."""
    start = set_problem(structure, t_end, 2).structure
    models = CaseModels(start, compiler=compiler, flags=flags)
    cases = list(generate_cases(start, t_end))
    outcomes: list[Outcome] = []
    for number, case in enumerate(cases):
        outcomes += run_case(models, case, limits)
        if progress is not None:
            progress((number + 1) / len(cases))
    return tuple(outcomes)


def run_case(
    models: CaseModels, case: Case, limits: Limits, methods: Sequence[str] | None = None
) -> list[Outcome]:
    """Return the outcomes of one case; methods: of ours, all that apply if not given."""
    methods = methods or (list_methods(case.structure) if case.step is None else (FIXED,))
    own = {method: _end(models, case, method, case.rtol, limits.run) for method in methods}
    peers = list_peers(case) if limits.peers else ()
    others = {name: run_peer(case, name, limits.run) for name in peers}
    truth = None
    if any(ending.status == "ok" for ending in (*own.values(), *others.values())):
        truth = _certify(models, case, own, limits)
    found = [_outcome(case, name, True, ending, judge(case, ending, truth)) for name, ending in own.items()]
    return found + [
        _outcome(case, name, False, ending, judge_peer(case, ending, truth))
        for name, ending in others.items()
    ]


def _certify(models: CaseModels, case: Case, own: dict[str, Ending], limits: Limits) -> Truth | None:
    """Return the reference of a case: by two methods, in extended precision, or of positions alone."""
    failed = [name for name, ending in own.items() if ending.status != "ok"]
    names = [name for name in REFERENCES if name in list_methods(case.structure) and name not in failed]
    free = dataclasses.replace(case, step=None)
    runs = [cache(partial(_reference, models, free, name, limits)) for name in names]
    first = [run for name, run in zip(names, runs, strict=True) if name in EXPLICIT]
    truth = certify_case(case, first) or certify_extended(case, limits.reference) or certify_case(case, runs)
    if truth is not None:
        return truth
    stiff = case.structure.is_bar.any() and not case.is_rigid and limits.compiles
    more = [partial(_corrected, models, free, limits)] if stiff and len(names) < 2 else []
    return certify_case(case, (*runs, *more), positions_only=True)


def _reference(models: CaseModels, case: Case, method: str, limits: Limits, rtol: float) -> Ending:
    return _end(models, case, method, rtol, limits.reference)


def _corrected(models: CaseModels, case: Case, limits: Limits, rtol: float) -> Ending:
    """Return the run with bars that follow their tension to first order: exact in the limit of stiff ones."""
    try:
        return run_own(models.corrected(case), case, "rk853", rtol, limits.reference)
    except TensegrityError as error:
        return _refusal(error)


def _end(models: CaseModels, case: Case, method: str, rtol: float, limit: float) -> Ending:
    try:
        return run_own(models.of(case), case, method, rtol, limit)
    except TensegrityError as error:
        return _refusal(error)


def _refusal(error: TensegrityError) -> Ending:
    return Ending("error", error.problem, np.zeros((0, 0)), 0.0)


def _outcome(case: Case, contender: str, is_own: bool, ending: Ending, found: Judgement) -> Outcome:
    kept = None if found.error is None or not np.isfinite(found.error) else found.error
    return Outcome(
        case.group,
        case.name,
        contender,
        is_own,
        found.verdict,
        kept,
        ending.status,
        ending.message,
        ending.seconds,
        found.rule,
        found.tension_error,
    )
