"""Methods on a case: ours, simulated as a user would, and peers, in processes of their own."""

import math
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.pipeline.build_library import MANY_CALLS, build_library
from tensegrity_codegen.runtime.accuracy.choice import integrators_for
from tensegrity_codegen.runtime.accuracy.integrate import integrate
from tensegrity_codegen.runtime.integrate.motion import Motion, Progress
from tensegrity_codegen.runtime.integrate.options import RunOptions, check_options
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.model.consistent import make_consistent
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.trajectory.evaluate import evaluate_trajectory
from tensegrity_codegen.runtime.trajectory.simulation_quantities import simulation_quantities
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.ground import CHANGEABLE
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.stability.cases import Case, as_springs, with_rigid_bars, with_springs
from tensegrity_codegen.studies.work_precision.library_contenders import CompiledMotion
from tensegrity_codegen.studies.work_precision.measure import Contender, MotionProblem, Run, Unavailable
from tensegrity_codegen.studies.work_precision.peers import peer_contenders
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import NonFiniteError, TensegrityError
from tensegrity_codegen.system.forked import can_fork
from tensegrity_codegen.tables.formulations import choose_formulation, find_formulation
from tensegrity_codegen.tables.integrators import INTEGRATORS, STIFF_INTEGRATOR
from tensegrity_codegen.tables.request import AUTO_EVENTS, ModelRequest

AUTO = "auto"
EXPLICIT = ("rk853", "rk54")
# Those that certify nothing.
OTHERS = tuple(name for name, row in INTEGRATORS.items() if row.kind == "adaptive" and name not in EXPLICIT)
FOR_STIFF_BARS = STIFF_INTEGRATOR
FIXED = "rk4"
OF_GROUND = ("stiffness", "friction", "stick_stiffness")
OF_MEMBERS = ("rest_length", "spring_constant", "damping")


class CaseModels:
    """The models of one structure, each compiled when first needed; they may raise TensegrityError."""

    def __init__(self, structure: Structure, *, compiler: str | None, flags: str) -> None:
        self.structure, self.compiler, self.flags = structure, compiler, flags
        self._made: dict[tuple[object, ...], CompiledModel] = {}

    def of(self, case: Case, method: str = "") -> CompiledModel:
        """Return the model that a case is for, all its members springs or the bars rigid.

        That of the method auto holds the integrators that the verb simulate would compile for the case alone,
        all others every integrator.
        """
        formulation = choose_formulation(rigid_bars=case.is_rigid).name
        structure = as_springs(self.structure) if case.is_rigid else with_springs(self.structure)
        if case.is_rigid and not structure.is_rigid.any():
            structure = with_rigid_bars(structure)
        integrators = (*list_integrators(structure), FIXED)
        if method == AUTO:
            integrators = integrators_for(AUTO, case.structure, formulation, case.rtol)
        structure = structure.with_changes(ground=case.structure.ground)
        key = (case.is_rigid, integrators, has_friction(structure))
        if key not in self._made:
            self._made[key] = self._compile(structure, formulation, integrators)
        return self._made[key]

    def corrected(self, case: Case) -> CompiledModel:
        """Return a model of just this case, its bars rigid but for the first order of their stretch."""
        extra = ("consistent_coordinate", "consistent_velocity")
        request = ModelRequest(
            (*simulation_quantities("rigid_bar"), *extra),
            formulation="rigid_bar",
            integrators=("rk853",),
            events=AUTO_EVENTS,
            options={"bars": "all", "correction": "first_order"},
        )
        return self._build(case.structure, request)

    def _compile(self, structure: Structure, formulation: str, integrators: tuple[str, ...]) -> CompiledModel:
        """Return the model that keeps changeable whatever differs between cases."""
        flexible = tuple(int(e) for e in np.flatnonzero(~structure.is_rigid))
        anchored = structure.node_anchored.any(axis=1)
        massive = structure.node_mass > 0
        massive[structure.coordinate_node_axis[0, 0]] |= not massive.any()
        parameters = {
            "rest_length": tuple(range(structure.n_members)),
            "spring_constant": flexible,
            "damping": flexible,
            "node_mass": tuple(int(n) for n in np.flatnonzero(massive)),
            "anchor_position": tuple(int(n) for n in np.flatnonzero(anchored)),
        }
        if has_friction(structure):
            parameters["ground"] = tuple(CHANGEABLE.index(name) for name in OF_GROUND)
        rigid = find_formulation(formulation).has_rigid_bars
        extra = ("consistent_coordinate", "consistent_velocity") if rigid else ()
        request = ModelRequest(
            (*simulation_quantities(formulation), *extra),
            formulation=formulation,
            parameters={name: indices for name, indices in parameters.items() if indices},
            integrators=integrators,
            events=AUTO_EVENTS,
        )
        return self._build(structure, request)

    def _build(self, structure: Structure, request: ModelRequest) -> CompiledModel:
        request = replace(request, emitter="auto")
        return build_library(
            structure, request, compiler=self.compiler, flags=self.flags, calls=MANY_CALLS
        ).load()


def has_friction(structure: Structure) -> bool:
    """Return whether there is a ground with friction, whose numbers are run-time parameters then."""
    return structure.ground is not None and structure.ground.friction > 0.0


def list_methods(structure: Structure) -> tuple[str, ...]:
    """Return our methods with error control that a structure can have, `auto` first."""
    return (AUTO, *list_integrators(structure))


def list_integrators(structure: Structure) -> tuple[str, ...]:
    """Return the integrators with error control that a structure can have."""
    free = ~np.all(structure.node_anchored[:, list(structure.axes)], axis=1)
    moves = np.any(free[structure.connectivity], axis=1)
    is_stiff = bool((structure.is_mixed & moves).any())
    return (*EXPLICIT, *([FOR_STIFF_BARS] if is_stiff else []), *OTHERS)


def values_of(model: CompiledModel, structure: Structure) -> Mapping[str, FloatArray]:
    """Return state and run-time parameters with which the model is this structure."""
    node_axes, axes = structure.coordinate_node_axis, list(structure.axes)
    state = {
        "coordinate": structure.node_position[node_axes[:, 0], node_axes[:, 1]],
        "velocity": structure.node_velocity[node_axes[:, 0], node_axes[:, 1]],
    }
    node = {name: index for index, name in enumerate(structure.node_name)}
    member = {name: index for index, name in enumerate(structure.member_name)}
    for argument in model.manifest.arguments:
        if argument.name == "anchor_position":
            state["anchor_position"] = structure.node_position[[node[n] for n in argument.over]][:, axes]
        elif argument.name == "node_mass":
            state["node_mass"] = structure.node_mass[[node[n] for n in argument.over]]
        elif argument.name == "ground":
            state["ground"] = np.array([getattr(structure.ground, name) for name in argument.over])
        elif argument.name in OF_MEMBERS:
            state[argument.name] = getattr(structure, argument.name)[[member[e] for e in argument.over]]
    return state


SAMPLES = 5
ATOL_OF_RTOL = 1e-3


class OverTime(Exception):
    """A run that was stopped because its time was up."""


@dataclass(frozen=True)
class Ending:
    """How a run ended: "ok", another status, "error" (a named one) or "over time"; its states (n_t, n).

    speed_bound [m/s]: by how much velocities are off at most since stiff members vibrate unseen, as the run
    itself says; tension (n_t, n_members) [N], None where the run has none; tension_bound [N]: as speed_bound,
    of two-sided members whose tensions are unknowns of the method; None where they follow from lengths.
    """

    status: str
    message: str
    state: FloatArray
    seconds: float
    speed_bound: float = 0.0
    tension: FloatArray | None = None
    tension_bound: float | None = None


def run_own(model: CompiledModel, case: Case, method: str, rtol: float, limit: float) -> Ending:
    """Return how one of our methods ends on a case, its error at the samples controlled to `rtol`.

    A method with a fixed step takes the case's. limit: seconds of CPU time after which it is stopped.
    """
    started = time.process_time()
    no_states = np.zeros((0, 2 * len(model.manifest.coordinate_name)))
    try:
        raw, trajectory = _simulate(model, case, method, rtol, partial(_watch, started + limit))
    except OverTime:
        return Ending("over time", f"stopped after {limit:g} s", no_states, time.process_time() - started)
    except TensegrityError as error:
        return Ending("error", error.problem, no_states, time.process_time() - started)
    speed = float(raw.evidence.get("vibration_speed_error", 0.0))
    pull = raw.evidence.get("vibration_tension_error")
    seconds = time.process_time() - started
    return Ending(
        trajectory.status, trajectory.message, raw.state, seconds, speed, trajectory.member_tension, pull
    )


def tolerance_of(structure: Structure, state: FloatArray, rtol: float) -> FloatArray:
    """Return the error that `rtol` allows of each component of states (n_t, n): by its node's vector."""
    node = structure.coordinate_node_axis[:, 0]
    same = (node[:, None] == node[None, :]).astype(np.float64)
    lengths = [np.sqrt(component**2 @ same) for component in np.split(state, 2, axis=1)]
    allowed: FloatArray = ATOL_OF_RTOL * rtol + rtol * np.hstack(lengths)
    return allowed


def _simulate(
    model: CompiledModel, case: Case, method: str, rtol: float, watch: Progress
) -> tuple[RawTrajectory, Trajectory]:
    """Return the samples, and the result that a simulation makes of them."""
    values = dict(values_of(model, case.structure))
    step = None if case.step is None else case.step * case.t_end
    options = RunOptions(method, rtol, ATOL_OF_RTOL * rtol, step)
    check_options(options, case.t_end, SAMPLES)
    if not all(np.isfinite(value).all() for value in values.values()):
        raise NonFiniteError("the initial state is not finite", where="simulate")
    position, speed = make_consistent(model, values.pop("coordinate"), values.pop("velocity"), values)
    state, times = np.concatenate([position, speed]), np.linspace(0.0, case.t_end, SAMPLES)
    raw = integrate(Motion(model, state, times, values, watch), options)
    return raw, evaluate_trajectory(model, raw, values)


def _watch(deadline: float, fraction: float) -> None:
    if fraction < 1.0 and time.process_time() > deadline:
        raise OverTime


PEER_STEP = 1e-3  # of the time span, for those who take a step and no tolerance
STEPPING = "MuJoCo"
WAITING = 5.0  # times its limit by the clock, for a peer that waits or shares its processor


def list_peers(case: Case) -> tuple[str, ...]:
    """Return the names of the peers of a case, none where processes cannot be made as they need them."""
    if not can_fork():
        return ()
    names = tuple(name for name, _ in peer_contenders(_problem(case), usual=True))
    return names if case.step is None else tuple(name for name in names if name.startswith(STEPPING))


def import_peers() -> None:
    """Import the packages of peers, once for all processes that are forked from this one."""
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
        node_axes = case.structure.coordinate_node_axis
        state = run.node_position[:, node_axes[:, 0], node_axes[:, 1]]
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
    position, speed = make_consistent(model, values.pop("coordinate"), values.pop("velocity"), values)
    return CompiledMotion(model, values, np.concatenate([position, speed]))


def _problem(case: Case) -> MotionProblem:
    return MotionProblem(case.structure, np.linspace(0.0, case.t_end, SAMPLES), False)
