"""Simulated motions as motions that feedback follows, through contacts with the ground too."""

import numpy as np

from tensegrity_codegen.control.feedback.design.linear_samples import check_motion
from tensegrity_codegen.control.planning.plan_point import PlanModel, find_actuation
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.named_inputs import INPUT
from tensegrity_codegen.runtime.model.require import require_model
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.system.checks import check_instance
from tensegrity_codegen.system.errors import InvalidValueError


def record_motion(model: CompiledModel, run: Trajectory) -> Motion:
    """Return a simulated motion as one that `design_lqr` and `simulate_control` follow.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"control"``, see compile_scene.
    run : Trajectory
        Motion of `simulate`, of the same scene, that ends at rest. Its samples become the knots: some at each
        command, and more where forces change fast.

    Returns
    -------
    Motion
        Coordinates, inputs, tensions and deflections of contacts at the samples.

    Raises
    ------
    InvalidValueError
        A motion that stopped early, begins after 0 s, or belongs to another model.
    StructureError
        The structure has no actuators.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tensegrity_codegen import Profile, compile_scene, record_motion, simulate
    >>> winch = '[[actuators]]\\nname = "winch"\\nmembers = "cord"\\n'
    >>> _ = Path("lift.toml").write_text('axes = "z"\\n' + Path("two_nodes.toml").read_text() + winch)
    >>> model = compile_scene("lift.toml", for_=("simulate", "control"))
    >>> pull = Profile([0.0, 0.5, 1.0], {"winch": [0.0, -0.1, -0.1]})
    >>> record_motion(model, simulate(model, 1.0, samples=101, schedule=pull)).duration
    1.0
    """
    require_model(model)
    check_instance(run, Trajectory, "run", "a Trajectory of simulate")
    actuation = find_actuation(model)
    if run.status != "ok" or run.input is None or run.time[0] != 0.0:
        raise InvalidValueError(
            "not a motion from 0 s to its end",
            where="run",
            given=f"{run.status}, from {run.time[0]:g} s",
            allowed="status ok, from 0 s, with the inputs of the actuators",
        )
    names = ("coordinate", "velocity", INPUT, *(() if run.internal is None else ("internal",)))
    internal = np.zeros((len(run.time), 0)) if run.internal is None else run.internal
    rows = zip(run.coordinate, run.velocity, run.input, internal, strict=True)
    found = [model.compute("acceleration", **dict(zip(names, row, strict=False))) for row in rows]
    inputs = run.input[:, actuation.place]
    motion = Motion(
        time=run.time,
        coordinate=run.coordinate,
        velocity=run.velocity,
        acceleration=np.array(found),
        rest_length=PlanModel(model, actuation).rest_length(inputs),
        input=run.input,
        member_tension=run.member_tension,
        peak_rate=np.abs(np.diff(inputs, axis=0) / np.diff(run.time)[:, None]).max(axis=0),
        actuators=actuation.names,
        input_name=run.input_name,
        internal=internal,
    )
    check_motion(model, motion)
    return motion
