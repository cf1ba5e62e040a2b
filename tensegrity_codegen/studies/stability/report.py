"""All cases of a study: run side by side, resumed from a journal; outcomes as one page and one data file."""

import dataclasses
import json
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.report.pages.page import render_page
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.structure.sliding import require_no_rings
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.stability.cases import Case, generate_cases, is_essential
from tensegrity_codegen.studies.stability.extended import certify_extended
from tensegrity_codegen.studies.stability.judge import (
    NOT_RUN,
    RULES,
    Judgement,
    Limits,
    Outcome,
    Truth,
    certify_case,
    judge,
    judge_peer,
    read_outcomes,
)
from tensegrity_codegen.studies.stability.methods import (
    EXPLICIT,
    FIXED,
    FOR_STIFF_BARS,
    CaseModels,
    Ending,
    import_peers,
    list_methods,
    list_peers,
    run_own,
    run_peer,
)
from tensegrity_codegen.studies.stability.page import build_page
from tensegrity_codegen.studies.study import hash_study, prepare_study
from tensegrity_codegen.studies.work_precision.measure import set_problem
from tensegrity_codegen.system.errors import TensegrityError
from tensegrity_codegen.system.forked import count_workers, run_pieces
from tensegrity_codegen.system.journal import Journal, Resumption
from tensegrity_codegen.system.output_folder import write_folder
from tensegrity_codegen.system.progress import part_of

REFERENCES = (*EXPLICIT, FOR_STIFF_BARS)  # the quickest first; auto is one of them


def list_contenders(case: Case, limits: Limits) -> tuple[tuple[str, bool], ...]:
    """Return name of every contender of a case, and whether it is one of our methods."""
    methods = list_methods(case.structure) if case.step is None else (FIXED,)
    peers = list_peers(case) if limits.peers else ()
    return (*((name, True) for name in methods), *((name, False) for name in peers))


def run_case(
    models: CaseModels, case: Case, limits: Limits, methods: Sequence[str] | None = None
) -> list[Outcome]:
    """Return the outcomes of one case; methods: of ours, all that apply if not given."""
    everyone = list_contenders(case, limits)
    methods = methods or [name for name, is_own in everyone if is_own]
    endings = {
        method: _end(partial(models.of, case, method), case, method, limits.run, case.rtol)
        for method in methods
    }
    peers = [name for name, is_own in everyone if not is_own]
    peer_endings = {name: run_peer(case, name, limits.run, models) for name in peers}
    truth = None
    if any(ending.status == "ok" for ending in (*endings.values(), *peer_endings.values())):
        truth = _certify(models, case, endings, limits)
    outcomes = [
        _outcome(case, name, True, ending, judge(case, ending, truth)) for name, ending in endings.items()
    ]
    return outcomes + [
        _outcome(case, name, False, ending, judge_peer(case, ending, truth))
        for name, ending in peer_endings.items()
    ]


def _certify(models: CaseModels, case: Case, endings: dict[str, Ending], limits: Limits) -> Truth | None:
    """Return the reference of a case: by two methods, in extended precision, or of positions alone."""
    failed = [name for name, ending in endings.items() if ending.status != "ok"]
    names = [name for name in REFERENCES if name in list_methods(case.structure) and name not in failed]
    free = dataclasses.replace(case, step=None)
    runs = [
        cache(partial(_end, partial(models.of, free, name), free, name, limits.reference)) for name in names
    ]
    explicit = [run for name, run in zip(names, runs, strict=True) if name in EXPLICIT]
    truth = (
        certify_case(case, explicit) or certify_extended(case, limits.reference) or certify_case(case, runs)
    )
    if truth is not None:
        return truth
    stiff = case.structure.is_bar.any() and not case.is_rigid and limits.compiles
    # Bars that follow their tension to first order: exact in the limit of stiff ones.
    corrected = partial(_end, partial(models.corrected, free), free, "rk853", limits.reference)
    witnesses = [corrected] if stiff and len(names) < 2 else []
    return certify_case(case, (*runs, *witnesses), positions_only=True)


def _end(
    compile_model: Callable[[], CompiledModel], case: Case, method: str, limit: float, rtol: float
) -> Ending:
    """Return how one of our methods ends on a case; the model is compiled first, which may be refused."""
    try:
        return run_own(compile_model(), case, method, rtol, limit)
    except TensegrityError as error:
        return Ending("error", error.problem, np.zeros((0, 0)), 0.0)


def _outcome(case: Case, contender: str, is_own: bool, ending: Ending, judgement: Judgement) -> Outcome:
    error = None if judgement.error is None or not np.isfinite(judgement.error) else judgement.error
    return Outcome(
        case.group,
        case.name,
        contender,
        is_own,
        judgement.verdict,
        error,
        ending.status,
        ending.message,
        ending.seconds,
        judgement.rule,
        judgement.tension_error,
    )


Progress = Callable[[float], None]


def run_cases(
    structure: Structure,
    t_end: float,
    limits: Limits,
    *,
    compiler: str | None,
    flags: str,
    journal: Journal,
    deadline: float,
    progress: Progress | None,
) -> tuple[Outcome, ...]:
    """Return the outcomes of all cases of a structure, at rest or not, with springs or rigid bars.

    Essential cases are run before all others.

    structure: what the cases are made from.
    t_end: end of each motion [s].
    limits: times that runs may take, and whether peers take part.
    compiler, flags: of the generated C, see build_library.
    journal: cases found here are not run again; each case that is done is kept here at once.
    deadline: time of time.monotonic() [s] at which running cases are ended. They and those that were not
        begun have the verdict "not run", and are not kept.
    progress: called about twice a second with the fraction of cases that are done, or of the time until the
        deadline that has passed, whichever is larger.
    """
    start = set_problem(structure, t_end, 2).structure
    models = CaseModels(start, compiler=compiler, flags=flags)
    cases = list(generate_cases(start, t_end))
    sections = {
        n: read_outcomes(journal.find(_name(case)), dict(list_contenders(case, limits)))
        for n, case in enumerate(cases)
    }
    done = {n: section for n, section in sections.items() if section is not None}
    journal.announce(structure.name, "cases", len(done), len(cases))
    if limits.peers:
        import_peers()
    why = dict.fromkeys(range(len(cases)), f"the time budget of {limits.total:g} s had passed before")
    order = sorted(set(why) - set(done), key=lambda n: (not is_essential(cases[n]), n))

    began = time.monotonic()

    def look() -> None:
        if progress is not None:  # the budget ends the work however many cases are open
            spent = (time.monotonic() - began) / max(deadline - began, 1e-9)
            progress(min(max(len(done) / len(cases), spent), 1.0))

    look()
    work = partial(run_case, models, limits=limits)
    pieces = run_pieces(
        work, [cases[n] for n in order], deadline=deadline, workers=count_workers(), look=look
    )
    with closing(pieces):
        for piece in pieces:
            number = order[piece.index]
            if piece.result is None:
                why[number] = f"could not be run: {piece.problem}"
                continue
            done[number] = piece.result
            journal.store(_name(cases[number]), [row.as_dict() for row in piece.result])
    return tuple(
        row
        for n, case in enumerate(cases)
        for row in (done[n] if n in done else _not_run(case, limits, why[n]))
    )


def _name(case: Case) -> str:
    return f"{case.group}: {case.name}"


def _not_run(case: Case, limits: Limits, why: str) -> Sequence[Outcome]:
    return [
        Outcome.not_run(case.group, case.name, name, is_own, why)
        for name, is_own in list_contenders(case, limits)
    ]


PAGE_NAME, DATA_NAME = "stability.html", "stability.json"
JOURNAL_NAME = "journal"


@dataclass(frozen=True)
class StabilityReport:
    """Outcomes by name of the scene, and the files that they stand in."""

    outcomes: dict[str, tuple[Outcome, ...]]
    html: Path
    data: Path
    t_end: float
    limits: Limits

    @property
    def cases_not_run(self) -> tuple[tuple[str, str, str], ...]:
        """Scene, group and name of every case that was not run."""
        rows = [(name, row) for name, rows in self.outcomes.items() for row in rows]
        return tuple(dict.fromkeys((n, r.group, r.case) for n, r in rows if r.verdict == NOT_RUN))

    def count(self, verdict: str, *, own: bool) -> int:
        """Return how often a verdict fell on our methods, or on peers."""
        rows = [row for rows in self.outcomes.values() for row in rows]
        return sum(row.verdict == verdict and row.is_own == own for row in rows)

    def count_rule(self, rule: str) -> int:
        """Return how many results of our methods were judged by one of RULES."""
        return sum(row.rule == rule and row.is_own for rows in self.outcomes.values() for row in rows)

    def as_dict(self) -> dict[str, Any]:
        """Return all outcomes in JSON's types."""
        return {
            "t_end": self.t_end,
            "limits": dataclasses.asdict(self.limits),
            "rules": {rule: self.count_rule(rule) for rule in RULES},
            "not_run": [{"scene": s, "group": g, "case": c} for s, g, c in self.cases_not_run],
            "scenes": {name: [row.as_dict() for row in rows] for name, rows in self.outcomes.items()},
        }


def write_stability(
    structures: Sequence[Structure],
    folder: Path,
    *,
    t_end: float,
    limits: Limits,
    compiler: str | None,
    flags: str,
    progress: Callable[[float], None] | None = None,
    fresh: bool = False,
    overwrite: bool = False,
    notice: Callable[[Resumption], None] | None = None,
) -> StabilityReport:
    """Run all cases of some structures and write stability.html and .json into `folder`.

    Finished cases go into a journal in the folder at once. The same call again takes them from there, if
    code, scene, options and machine are the same, and runs the others; with `fresh` it runs all. `notice` is
    called with what is taken. All scenes share limits.total: each has an equal part of the time that is left
    when it begins.
    """
    limits.check()
    for structure in structures:
        require_no_rings(structure, "stiff and extreme cases")
    prepare_study(structures, t_end, folder, (PAGE_NAME, DATA_NAME), overwrite=overwrite)
    end, outcomes = time.monotonic() + limits.total, dict[str, tuple[Outcome, ...]]()
    options = (t_end.hex(), repr(dataclasses.replace(limits, total=0.0)))  # the total changes no result
    for number, structure in enumerate(structures):
        now, remaining = time.monotonic(), len(structures) - number
        key = hash_study(structure, compiler, flags, *options)
        outcomes[structure.name] = run_cases(
            structure,
            t_end,
            limits,
            compiler=compiler,
            flags=flags,
            journal=Journal(
                folder / JOURNAL_NAME / f"{structure.name}.jsonl", key, fresh=fresh, notice=notice
            ),
            deadline=now + max(0.0, end - now) / remaining,
            progress=part_of(progress, number / len(structures), 1.0 / len(structures)),
        )
    report = StabilityReport(outcomes, folder / PAGE_NAME, folder / DATA_NAME, t_end, limits)
    data = json.dumps(report.as_dict(), indent=1, allow_nan=False) + "\n"
    page = render_page(build_page(outcomes, t_end, limits))
    files = {PAGE_NAME: page.encode("utf-8"), DATA_NAME: data.encode("utf-8")}
    write_folder(folder, files, overwrite=overwrite)
    return report
