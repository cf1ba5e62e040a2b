"""All cases of a scene: side by side in processes, within a time budget, resumed from a journal."""

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from functools import partial

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.stability.cases import Case, generate_cases, is_essential
from tensegrity_codegen.studies.stability.models import CaseModels
from tensegrity_codegen.studies.stability.outcome import Limits, Outcome, read_outcomes
from tensegrity_codegen.studies.stability.peers import import_peers
from tensegrity_codegen.studies.stability.run import list_contenders, run_case
from tensegrity_codegen.studies.work_precision.problem import set_problem
from tensegrity_codegen.system.forked import count_workers, run_pieces
from tensegrity_codegen.system.journal import Journal

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

    Parameters
    ----------
    structure : Structure
        What the cases are made from.
    t_end : float
        End of each motion [s].
    limits : Limits
        Times that runs may take, and whether peers take part.
    compiler, flags
        Of the generated C, see build_library.
    journal : Journal
        Cases found here are not run again; each case that is done is kept here at once.
    deadline : float
        Time of time.monotonic() [s] at which running cases are ended. They and those that were not begun
        have the verdict "not run", and are not kept.
    progress : callable or None
        Called about twice a second with the fraction of cases that are done, or of the time until the
        deadline that has passed, whichever is larger.
    """
    start = set_problem(structure, t_end, 2).structure
    models = CaseModels(start, compiler=compiler, flags=flags)
    cases = list(generate_cases(start, t_end))
    done = {n: kept for n, case in enumerate(cases) if (kept := _find(journal, case, limits)) is not None}
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
    work = partial(_run, models, limits)
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


def _run(models: CaseModels, limits: Limits, case: Case) -> list[Outcome]:
    return run_case(models, case, limits)


def _name(case: Case) -> str:
    return f"{case.group}: {case.name}"


def _find(journal: Journal, case: Case, limits: Limits) -> list[Outcome] | None:
    return read_outcomes(journal.find(_name(case)), dict(list_contenders(case, limits)))


def _not_run(case: Case, limits: Limits, why: str) -> Sequence[Outcome]:
    return [
        Outcome.not_run(case.group, case.name, name, is_own, why)
        for name, is_own in list_contenders(case, limits)
    ]
