"""One case with all methods and peers, judged."""

import dataclasses
from collections.abc import Sequence
from functools import cache, partial

import numpy as np

from tensegrity_codegen.studies.stability.cases import Case
from tensegrity_codegen.studies.stability.judge import Judgement, Truth, certify_case, judge, judge_peer
from tensegrity_codegen.studies.stability.models import (
    EXPLICIT,
    FIXED,
    FOR_STIFF_BARS,
    CaseModels,
    list_methods,
)
from tensegrity_codegen.studies.stability.outcome import Limits, Outcome
from tensegrity_codegen.studies.stability.own import Ending, run_own
from tensegrity_codegen.studies.stability.peers import list_peers, run_peer
from tensegrity_codegen.studies.stability.second_opinion import certify_extended
from tensegrity_codegen.system.errors import TensegrityError

REFERENCES = (*EXPLICIT, FOR_STIFF_BARS)  # the quickest first; auto is one of them


def list_contenders(case: Case, limits: Limits) -> tuple[tuple[str, bool], ...]:
    """Return name of every contender of a case, and whether it is one of our methods."""
    own = list_methods(case.structure) if case.step is None else (FIXED,)
    peers = list_peers(case) if limits.peers else ()
    return (*((name, True) for name in own), *((name, False) for name in peers))


def run_case(
    models: CaseModels, case: Case, limits: Limits, methods: Sequence[str] | None = None
) -> list[Outcome]:
    """Return the outcomes of one case; methods: of ours, all that apply if not given."""
    everyone = list_contenders(case, limits)
    methods = methods or [name for name, is_own in everyone if is_own]
    own = {method: _end(models, case, method, case.rtol, limits.run) for method in methods}
    peers = [name for name, is_own in everyone if not is_own]
    others = {name: run_peer(case, name, limits.run, models) for name in peers}
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
        return run_own(models.of(case, method), case, method, rtol, limit)
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
