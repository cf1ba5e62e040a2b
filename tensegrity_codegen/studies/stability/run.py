"""All cases of a scene with all methods, judged."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.errors import FormulationError
from tensegrity_codegen.structure import Structure
from tensegrity_codegen.studies.stability.cases import Case, generate_cases
from tensegrity_codegen.studies.stability.judge import Truth, certify_case, judge
from tensegrity_codegen.studies.stability.own import Ending, compile_cases, methods_for, run_own
from tensegrity_codegen.studies.stability.peers import list_peers, run_peer
from tensegrity_codegen.studies.work_precision.peers import peer_contenders
from tensegrity_codegen.studies.work_precision.problem import set_problem

__all__ = ["Limits", "Outcome", "run_cases"]

Progress = Callable[[float], None]
FloatArray = NDArray[np.float64]

LOST = 1e-2  # error of a peer, over the mean member length, from which its result is called wrong


@dataclass(frozen=True)
class Limits:
    """Seconds that a run may take, and a reference; peers: whether they are run too."""

    run: float = 10.0
    reference: float = 20.0
    peers: bool = True


@dataclass(frozen=True)
class Outcome:
    """One case with one method.

    error: of ours, the largest certified error over the tolerance; of a peer, the largest error of a
    coordinate [m]; None where nothing certifies.
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
    """Return the outcomes of all cases; FormulationError for a structure with rigid bars."""
    if structure.is_rigid.any():
        raise FormulationError(
            "the cases scale the stiffness of bars",
            where=f"{structure.name}: members",
            given="rigid bars",
            allowed="bars with a stiffness",
            hint="give the bars a stiffness; the cases go up to 10^12 times that of the cables",
        )
    start = set_problem(structure, t_end, 2).structure
    model = compile_cases(start, compiler=compiler, flags=flags)
    methods = methods_for(start)
    cases = list(generate_cases(start, t_end))
    peers = [name for name, _ in peer_contenders(set_problem(start, t_end, 2))]
    peers = peers if limits.peers and list_peers() else []
    outcomes: list[Outcome] = []
    for number, case in enumerate(cases):
        runs = [partial(_reference, model, case, method, limits.reference) for method in methods]
        truth = certify_case(case, runs)
        for method in methods:
            ending = run_own(model, case, method, case.rtol, limits.run)
            verdict, error = judge(case, ending, truth)
            outcomes.append(_outcome(case, method, True, verdict, error, ending))
        for name in peers:
            ending = run_peer(case, name, limits.run)
            verdict, error = _judge_peer(case, ending, truth)
            outcomes.append(_outcome(case, name, False, verdict, error, ending))
        if progress is not None:
            progress((number + 1) / len(cases))
    return tuple(outcomes)


def _reference(model: Any, case: Case, method: str, limit: float, rtol: float) -> Ending:
    return run_own(model, case, method, rtol, limit)


def _judge_peer(case: Case, ending: Ending, truth: Truth | None) -> tuple[str, float | None]:
    """Judge coordinates alone, leniently: wrong from a hundredth of the mean member length on."""
    if ending.status == "over time":
        return "over time", None
    if ending.status != "ok":
        return "stopped", None
    if case.expects_refusal or not np.isfinite(ending.state).all():
        return "wrong", None
    if truth is None:
        return "unchecked", None
    n = truth.state.shape[1] // 2
    if ending.state.shape != (len(truth.state), n):
        return "wrong", None
    error = float(np.abs(ending.state - truth.state[:, :n]).max())
    length = float(case.structure.member_length().mean())
    return ("wrong" if error > LOST * length else "survived"), error


def _outcome(
    case: Case, contender: str, is_own: bool, verdict: str, error: float | None, ending: Ending
) -> Outcome:
    kept = None if error is None or not np.isfinite(error) else error
    return Outcome(
        case.group, case.name, contender, is_own, verdict, kept, ending.status, ending.message, ending.seconds
    )
