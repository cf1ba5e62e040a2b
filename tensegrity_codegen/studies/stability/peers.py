"""Peers on a case, each in a process of its own, since some do not come back."""

import math
import multiprocessing
import os
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.simulate.consistency import make_consistent
from tensegrity_codegen.studies.stability.cases import Case
from tensegrity_codegen.studies.stability.own import SAMPLES, CaseModels, Ending, values_of
from tensegrity_codegen.studies.work_precision.measure import Contender, MotionProblem, Run, Unavailable
from tensegrity_codegen.studies.work_precision.own import CompiledMotion
from tensegrity_codegen.studies.work_precision.peers import peer_contenders
from tensegrity_codegen.system.forked import can_fork

PEER_STEP = 1e-3  # of the time span, for those who take a step and no tolerance
STEPPING = "MuJoCo"
WAITING = 5.0  # times its limit by the clock, for a peer that waits or shares its processor


def list_peers(case: Case) -> tuple[str, ...]:
    """Return the names of the peers of a case, none where processes cannot be made as they need them.

    Of a case about the step those that take one.
    """
    if not can_fork():
        return ()
    names = tuple(name for name, _ in peer_contenders(_problem(case), usual=True))
    return names if case.step is None else tuple(name for name in names if name.startswith(STEPPING))


def import_peers() -> None:
    """Import what peers need, once for all processes that are forked from this one."""
    with suppress(ImportError):
        import mujoco  # noqa: F401
    import tensegrity_codegen.symbolic.build  # noqa: F401


def run_peer(case: Case, name: str, limit: float, models: CaseModels | None = None) -> Ending:
    """Return how the peer of that name ends on a case; states are node coordinates (n_t, n_coordinates).

    limit: seconds of CPU time, as for our methods; WAITING times that by the clock. models: those of the
    case's structure, for peers that call our compiled accelerations; compiled for the case if not given.
    """
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    child = context.Process(target=_answer, args=(case, name, limit, models, sender))
    started = time.monotonic()
    child.start()
    sender.close()
    try:
        status, message, state = receiver.recv() if receiver.poll(WAITING * limit) else _over_time(limit)
    except EOFError:
        child.join()
        if child.exitcode == -signal.SIGXCPU:
            status, message, state = _over_time(limit)
        else:
            status, message, state = "crashed", "its process ended without a result", np.zeros((0, 0))
    seconds = time.monotonic() - started
    child.kill()
    child.join()
    return Ending(status, message, state, seconds)


def _over_time(limit: float) -> tuple[str, str, NDArray[np.float64]]:
    return "over time", f"stopped after {limit:g} s", np.zeros((0, 0))


def _answer(case: Case, name: str, limit: float, models: CaseModels | None, sender: Any) -> None:
    import resource  # not on all systems

    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)  # what its C code prints is no output of ours
    os.dup2(nowhere, 2)
    seconds = math.ceil(limit)
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    try:
        run = _run(case, name, models)
        places = case.structure.coordinate_node_axis
        state = run.node_position[:, places[:, 0], places[:, 1]]
        sender.send((run.status, run.message, state))
    except Unavailable as error:
        sender.send(("not able", str(error), np.zeros((0, 0))))
    except Exception as error:  # whatever a peer raises is its way to stop
        sender.send(("error", f"{type(error).__name__}: {error}"[:200], np.zeros((0, 0))))


def _run(case: Case, name: str, models: CaseModels | None) -> Run:
    compiled = None if models is None else partial(_compiled, models, case)
    makers: dict[str, Callable[[], Contender]] = dict(peer_contenders(_problem(case), compiled, usual=True))
    contender = makers[name]()
    step = PEER_STEP if case.step is None else case.step
    setting = step if contender.kind == "step" else min(case.rtol, 0.1)
    contender.prepare(setting)
    return contender.run(setting)()


def _compiled(models: CaseModels, case: Case) -> CompiledMotion:
    """Return the compiled motion of a case, its initial state on the constraints of the model."""
    model = models.of(case)
    values = dict(values_of(model, case.structure))
    place, speed = make_consistent(model, values.pop("coordinate"), values.pop("velocity"), values)
    return CompiledMotion(model, values, np.concatenate([place, speed]))


def _problem(case: Case) -> MotionProblem:
    return MotionProblem(case.structure, np.linspace(0.0, case.t_end, SAMPLES), False)
