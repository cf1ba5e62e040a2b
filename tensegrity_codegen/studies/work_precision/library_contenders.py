"""Our own contenders: every formulation that a structure allows, every integrator that it can have."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from tensegrity_codegen.codegen.choose_emitter import MAX_STRAIGHT_LINE_MEMBERS
from tensegrity_codegen.pipeline.analyses import want_analyses
from tensegrity_codegen.pipeline.build_library import MANY_CALLS, build_library
from tensegrity_codegen.runtime.accuracy.integrate import integrate_once
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions, Stepping
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.model.consistent import make_consistent
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.evaluate import evaluate_trajectory
from tensegrity_codegen.runtime.trajectory.simulation_quantities import simulation_quantities
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.studies.work_precision.measure import Contender, MotionProblem, Row, Run, Unavailable
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import TensegrityError
from tensegrity_codegen.tables.formulations import choose_formulation, find_formulation
from tensegrity_codegen.tables.integrators import STIFF_INTEGRATOR
from tensegrity_codegen.tables.request import AUTO_EVENTS, ModelRequest

TOLERANCES = tuple(10.0**-k for k in range(2, 13))
STEPS = tuple(10.0 ** (-k / 2) for k in range(2, 11))  # of the time span
ADAPTIVE = ("rk54", "rk853")
FIXED = ("rk4",)
AUTO = "auto"
IMPLICIT = (STIFF_INTEGRATOR,)
IMPLICIT_TOLERANCES = TOLERANCES[:8]  # of order 5, with more work a step: below, others are faster
ATOL_OF_RTOL = 1e-2  # absolute tolerance [m, m/s] over the relative one


@dataclass(frozen=True)
class Variant:
    """A formulation with options and the emitter that writes it; the methods to run it with."""

    formulation: str
    options: Mapping[str, str] = field(default_factory=dict)
    emitter: str = "auto"
    methods: tuple[str, ...] = (*ADAPTIVE, *FIXED)


@dataclass(frozen=True)
class CompiledMotion:
    """A compiled model, run-time arguments unlike its scene's, and the initial state (n_states,)."""

    model: CompiledModel
    arguments: Mapping[str, FloatArray]
    state: FloatArray


# The two with options are for bars that have a stiffness.
VARIANTS: Mapping[str, Variant] = {
    "node_position": Variant("node_position", methods=(*ADAPTIVE, *IMPLICIT, *FIXED)),
    "node_position by table": Variant("node_position", emitter="table", methods=(*ADAPTIVE, *IMPLICIT)),
    "node_distance": Variant("node_distance"),
    "rigid_bar": Variant("rigid_bar", methods=(*ADAPTIVE, *IMPLICIT, *FIXED)),
    "rigid_bar, all bars": Variant("rigid_bar", {"bars": "all"}),
    "rigid_bar, corrected": Variant("rigid_bar", {"bars": "all", "correction": "first_order"}),
}


def list_library_contenders(
    problem: MotionProblem, *, flags: str, compiler: str | None, extra_methods: tuple[str, ...] = ()
) -> Iterator[tuple[str, Callable[[], Contender]]]:
    """Yield name and maker of each of our contenders; makers raise Unavailable for what does not apply."""
    for title, variant in VARIANTS.items():
        for method in (*variant.methods, *(extra_methods if title == "node_position" else ())):
            yield f"{title}, {method}", partial(_make, problem, title, method, flags, compiler)
    yield "simulate, auto", partial(_make_simulate, problem, flags, compiler)


def _make_simulate(problem: MotionProblem, flags: str, compiler: str | None) -> Contender:
    """Return the function `simulate` by its own method, over a model compiled for it; Python counts too."""
    structure = problem.structure
    title = choose_formulation(rigid_bars=bool(structure.is_rigid.any())).name
    request = want_analyses(structure, ModelRequest((), formulation=title), ("simulate",))
    model = build_library(structure, request, compiler=compiler, flags=flags, calls=MANY_CALLS).load()

    def run(setting: float) -> Callable[[], Run]:
        stepping = Stepping(atol=ATOL_OF_RTOL * setting)
        trajectory = simulate(
            model, problem.t_end, samples=problem.sample_time, rtol=setting, stepping=stepping
        )
        return partial(_look, trajectory)

    return Contender("simulate, auto", "own", title, AUTO, "tolerance", TOLERANCES, run)


def compile_problem(
    problem: MotionProblem, title: str, integrator: str, flags: str, compiler: str | None
) -> CompiledModel:
    """Return the model of a problem in one of VARIANTS; Unavailable where the structure has it not."""
    variant = VARIANTS[title]
    formulation, options = variant.formulation, variant.options
    rigid = problem.structure.is_rigid
    if rigid.any() != (title == "rigid_bar") and not options:
        raise Unavailable("has rigid bars" if rigid.any() else "has no rigid bars")
    if options and not (problem.structure.is_bar & ~rigid).any():
        raise Unavailable("has no bars with a stiffness")
    if variant.emitter != "auto" and problem.structure.n_members > MAX_STRAIGHT_LINE_MEMBERS:
        raise Unavailable("the emitter table is the usual one at this size")
    is_rigid = find_formulation(formulation).has_rigid_bars
    extra = ("consistent_coordinate", "consistent_velocity") if is_rigid else ()
    request = ModelRequest(
        (*simulation_quantities(formulation), *extra),
        formulation=formulation,
        integrators=(integrator,),
        events=AUTO_EVENTS,
        options=options,
        emitter=variant.emitter,
    )
    try:
        return build_library(
            problem.structure, request, compiler=compiler, flags=flags, calls=MANY_CALLS
        ).load()
    except TensegrityError as error:
        raise Unavailable(error.problem) from error


def _make(problem: MotionProblem, title: str, method: str, flags: str, compiler: str | None) -> Contender:
    model = compile_problem(problem, title, method, flags, compiler)
    state = initial_state(model)
    fixed = method in FIXED

    def run(setting: float) -> Callable[[], Run]:
        options = RunOptions(method, setting, ATOL_OF_RTOL * setting)
        if fixed:
            options = RunOptions(method, step=setting * problem.t_end)
        raw = integrate_once(Motion(model, state, problem.sample_time), options)
        return lambda: _look(evaluate_trajectory(model, raw, {}))

    settings = STEPS if fixed else IMPLICIT_TOLERANCES if method in IMPLICIT else TOLERANCES
    kind = "step" if fixed else "tolerance"
    return Contender(f"{title}, {method}", "own", title, method, kind, settings, run)


def _look(trajectory: Trajectory) -> Run:
    """Return a run with the status that a simulation gives it, which looks at the energy too."""
    drift = None if trajectory.energy_drift is None else float(np.ptp(trajectory.total_energy))
    counts = (trajectory.n_steps, trajectory.n_evaluations)
    return Run(trajectory.node_position, trajectory.status, trajectory.message, *counts, drift)


def describe_simulation(row: Row, t_end: float, flags: str) -> str:
    """Return options of the verb simulate, and keys of a scene, with which it repeats one of our runs."""
    variant = VARIANTS[row.formulation]
    accuracy = f"--rtol {row.setting:g} --atol {ATOL_OF_RTOL * row.setting:g}"
    if row.kind == "step":
        accuracy = f"--step {row.setting * t_end:.6g}"
    control = "" if row.method == AUTO else "--control steps "
    keys = [f'formulation = "{variant.formulation}"']
    if variant.options:
        options = ", ".join(f'{key} = "{value}"' for key, value in variant.options.items())
        keys.append(f"options = {{ {options} }}")
    if variant.emitter != "auto":
        keys.append(f'emitter = "{variant.emitter}"')
    return (
        f"simulate --t-end {t_end:g} --method {row.method} {accuracy} {control}--flags {flags}, with "
        f"{', '.join(keys)} under [model]"
    )


def initial_state(model: CompiledModel) -> FloatArray:
    """Return the scene's own state (n_states,), brought onto the constraints of the model."""
    return np.concatenate(make_consistent(model, model.nominal("coordinate"), model.nominal("velocity"), {}))


def place_samples(
    model: CompiledModel, raw: RawTrajectory, arguments: Mapping[str, FloatArray] | None = None
) -> FloatArray:
    """Return node positions (n_t, n_nodes, 3) [m] of the samples that a run reached."""
    n, values = raw.state.shape[1] // 2, arguments or {}
    anchors = values.get("anchor_position")
    return np.stack([place_nodes(model, state[:n], anchors, arguments=values) for state in raw.state])
