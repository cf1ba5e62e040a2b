"""Other integrators over the same structure, where they are installed: one file each."""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import chain

from tensegrity_codegen.studies.work_precision.library_contenders import CompiledMotion
from tensegrity_codegen.studies.work_precision.measure import Contender, MotionProblem, Unavailable
from tensegrity_codegen.studies.work_precision.peers import cvode, mujoco_tendons, scipy_ivp, sundials


def peer_contenders(
    problem: MotionProblem,
    compiled: Callable[[], CompiledMotion] | None = None,
    *,
    compiler: str | None = None,
    usual: bool = False,
) -> Iterator[tuple[str, Callable[[], Contender]]]:
    """Yield name and maker of each peer; makers raise Unavailable where it is not installed or not able."""
    makers = chain(
        mujoco_tendons.contenders(problem, usual=usual),
        () if usual else cvode.contenders(problem, compiler),
        sundials.usual_contenders(problem) if usual else sundials.contenders(problem, compiler),
        scipy_ivp.contenders(problem, compiled, usual=usual),
    )
    if problem.structure.ground is not None:
        why = "has no contacts with this law of friction"
    elif problem.structure.internal_name:
        why = "has no members that yield or relax, and no motors with a lag"
    else:
        yield from makers
        return
    yield from ((name, partial(_refuse, why)) for name, _ in makers)


def _refuse(why: str) -> Contender:
    raise Unavailable(why)
