"""A user's script with every public name, typed; tests/test_python_manners.py runs it."""

from pathlib import Path
from typing import Any

import numpy as np

import tensegrity_codegen as tc

SCENE = {
    "name": "lift",
    "axes": "z",
    "gravity": [0, 0, -9.81],
    "classes": {"spring": {"kind": "cable", "spring_constant": 80.0, "damping": 0.4}},
    "nodes": {
        "top": {"position": [0, 0, 0], "anchored": True},
        "load": {"position": [0, 0, -1], "mass": 0.5},
    },
    "members": {"cord": {"class": "spring", "nodes": ["top", "load"], "rest_length": np.float64(1.0)}},
    "actuators": [{"name": "winch", "members": "cord", "rate": 1.0}],
    "sensors": [{"kind": "member_length", "members": "cord", "noise": 1e-3}],
}
FRAME = {
    "name": "frame",
    "axes": "xz",
    "gravity": [0, -9.81],
    "classes": {"strut": {"kind": "bar", "spring_constant": 1e4}},
    "nodes": {
        "left": {"position": [0, 0], "mass": 1.0},
        "right": {"position": [1, 0], "mass": 1.0},
        "top": {"position": [0.5, 1], "mass": 1.0},
    },
    "members": {
        "base": {"class": "strut", "nodes": ["left", "right"]},
        "west": {"class": "strut", "nodes": ["left", "top"]},
        "east": {"class": "strut", "nodes": ["right", "top"]},
    },
    "ground": {"stiffness": 1e5, "friction": 0.5},
}
SPAN = {
    "name": "span",
    "axes": "xz",
    "gravity": [0, -9.81],
    "nodes": {
        "left": {"position": [0, 0], "anchored": True},
        "right": {"position": [10, 0], "anchored": True},
    },
    "members": {
        "line": {"kind": "cable", "nodes": ["left", "right"], "axial_stiffness": 1e4, "rest_length": 10.5,
                 "mass_per_length": 1.0, "segments": 8},
    },
}  # fmt: skip
WORK = (
    *("simulate", "simulate_batch", "equilibrium", "equilibria", "sensitivity"),
    *("linearize", "analyse", "plan", "time_motion", "control"),
)


def main(folder: Path) -> dict[str, object]:
    """Use everything, write into `folder`, and return the results by name."""
    scene: tc.Scene = tc.read_scene(SCENE)
    (folder / "lift.toml").write_text(scene.to_toml(), encoding="utf-8")
    structure, request = tc.load_scene(folder / "lift.toml")
    assert isinstance(structure, tc.Structure)
    assert isinstance(request, tc.ModelRequest)
    small: tc.CompiledModel = tc.build_library(structure, request).load()
    model: tc.CompiledModel = tc.compile_scene(scene, for_=WORK)
    found: tc.Equilibrium = tc.find_equilibrium(model)
    several: tc.Equilibria = tc.find_equilibria(model, arguments={"winch": np.array([0.0, -0.1])})
    frame = tc.compile_scene(FRAME, for_="equilibrium")
    standing: tc.Stand = tc.stand(frame, tc.find_equilibrium(frame))
    assert standing.verdict == "stands"
    span = tc.find_equilibrium(tc.compile_scene(SPAN, for_="equilibrium"))
    errors: tuple[tc.SegmentError, ...] = tc.add_segment_error(span).segments
    line: tc.Catenary = tc.find_catenary(10.0, 0.0, 10.5, 9.81, 1e4)
    assert abs(errors[0].extrapolated_sag - line.sag) < 1e-3
    analysis: tc.Analysis = tc.analyse(model)
    slopes: tc.Sensitivity = tc.equilibrium_sensitivity(model, found)
    linear: tc.LinearModel = tc.linearize(model, coordinate=found.coordinate)
    (folder / "profile.csv").write_text("time,winch\n0,0\n0.5,-0.1\n1,-0.1\n", encoding="utf-8")
    profile: tc.Profile = tc.read_profile(folder / "profile.csv", ["winch"])
    motion: tc.Trajectory = tc.simulate(model, t_end=1.0, samples=11, schedule=profile)
    recorded: tc.Motion = tc.record_motion(model, motion)
    assert recorded.duration == 1.0
    steps = tc.Stepping(atol=1e-10, max_steps=10_000)
    fall = tc.simulate(model, t_end=0.1, samples=3, until=tc.Until("load.z < -5"), stepping=steps)
    batch: tc.BatchTrajectory = tc.simulate_batch(model, t_end=0.1, samples=3, coordinate=[[-1.0], [-1.1]])
    stepper: tc.Stepper = tc.Stepper(tc.compile_scene(scene, for_="step"), 2, sample=0.01)
    stepper.step()
    planned: tc.PlanResult = tc.plan(model, "load.z=-0.95")
    path = tc.EquilibriumPath([[0.0], [-0.05]])
    timed: tc.Motion = tc.time_motion(model, path, duration=1.0)
    gains: tc.Gains = tc.design_lqr(model, found, [100.0, 1.0], [1.0], sample=0.02)
    mpc: tc.Mpc = tc.design_mpc(model, found, [100.0, 1.0], [1.0], sample=0.02)
    assert mpc.horizon == 20
    estimator: tc.Estimator = tc.design_kalman(model, found, sample=0.02, knots=2)
    distribution: tc.TensionDistribution = tc.design_distribution(model, timed, least_tension=0.1)
    gust = tc.Gust("load", (0.0, 0.0, -0.5), 0.1, 0.1)
    run: tc.ControlRun = tc.simulate_control(
        model,
        found,
        gains,
        estimator=estimator,
        t_end=0.5,
        disturbance=tc.Disturbance(gust=gust),
        limits=tc.ActuatorLimits(rate=2.0),
    )
    tc.draw(motion, time=0.5, labels=True).savefig(folder / "lift.png")
    tc.draw(model, view="front", size="600x500", settle=True).savefig(folder / "rest.png")
    try:
        page: tc.LivePage = tc.view(motion, labels="nodes", follow=True)
        page.write(folder / "lift.html")
    except tc.TensegrityError as error:  # three.js can be neither found nor downloaded
        print(error)
    length: float = float(found.member_length[0])
    speed: float = float(np.abs(motion.velocity_of("load")).max())
    pull: float = float(motion.tension("cord")[-1])
    try:
        motion.position("lood")
    except tc.TensegrityError as error:
        problem: str = error.hint
    print(fall.status, tc.__version__, found.position("load"), length, speed, pull, problem)
    names = ("scene", "structure", "small", "model", "found", "analysis", "slopes", "linear", "profile")
    more = (
        "motion",
        "several",
        "batch",
        "planned",
        "path",
        "timed",
        "gains",
        "estimator",
        "distribution",
        "run",
    )
    values = locals()
    return {name: values[name] for name in (*names, *more)}


def deliver(folder: Path, results: dict[str, object]) -> dict[str, object]:
    """Use what studies a loop of control and what is given to other programs; longer work."""
    model, motion, gains = results["model"], results["timed"], results["gains"]
    assert isinstance(model, tc.CompiledModel)
    assert isinstance(motion, tc.Motion)
    assert isinstance(gains, tc.Gains)
    tuning: tc.Tuning = tc.choose_weights(model, motion, sample=0.02)
    errors = tc.StatedErrors(start_error=1e-3, gusts=(tc.RandomGust("load", 0.2, 0.1),))
    study: tc.ControlStudy = tc.study_control(
        model, motion, tuning=tuning, estimator=None, errors=errors, sample=0.02, draws=tc.Draws(2, seed=1)
    )
    runs: tuple[tc.ControlRun, ...] = tc.simulate_control_batch(
        model, motion, gains, draws=[tc.Disturbance()], sample=0.02
    )
    bundle: tc.ControllerBundle = tc.build_controller(
        model, motion, gains, out=folder / "controller", code=tc.ControllerCode(knots=5)
    )
    loaded: tc.LoadedController = tc.load_controller(bundle.folder)
    seen = (tc.Observed("length of cord", "m"), tc.Observed("command", "m"))
    description = tc.Description("lift", 0.02, seen, (tc.Acted("winch", 0.0, 0.1, rate=0.5),))
    layer: Any = ((np.array([[2.0, 0.5]]),), (np.zeros(1),))
    policy = tc.Policy(
        weights=layer[0], biases=layer[1], mean=np.zeros(2), scale=np.ones(2), description=description
    )
    policy.write(folder / "policy.npz")
    read: tc.Policy = tc.read_policy(folder / "policy.npz")
    assert read([0.1, 0.0]) == [0.2]
    graphs: tc.SymbolicFunctions = tc.symbolic_functions(SCENE)
    ahead = tc.design_mpc(
        model, motion, tuning.Q, tuning.R, sample=0.02, integral_action=tuning.integral_action
    )
    tc.export_acados(model, motion, ahead, out=folder / "acados")

    def reward(step: tc.EnvironmentStep) -> Any:
        return step.progress() - 0.1 * step.effort()

    env = tc.environment(folder / "lift.toml", 2, act={"winch": (-0.1, 0.1)}, reward=reward, seconds=0.04)
    env.reset(seed=1)
    recorded: tc.Trajectory = env.record()
    assert len(recorded.time) == 3
    fmu = tc.export_fmu(folder / "lift.toml", folder / "lift.fmu")
    stored = tc.sweep(
        SCENE, do="evaluate", over={"gravity[2]": "-10:0:3"}, out=folder / "sweep.zarr", workers=1
    )
    assert stored["member_tension"].shape[0] == 3
    drawn = tc.Sampling({"gravity[2]": "uniform(-10,0)"}, n=4, seed=1, method="sobol")
    assert (tc.sweep(SCENE, do="evaluate", sample=drawn, workers=1)["status"] == 0).all()
    assert tc.Cluster("tcp://10.0.0.1:8786").wait > 0
    measured = {"time": [0.1, 0.2, 0.3], "load.z": [-1.04, -1.1, -1.12]}
    identified: tc.Identification = tc.identify(SCENE, measured, ["classes.spring.spring_constant"])
    assert identified.n_values == 3

    def loss(moved: tc.Trajectory) -> tuple[float, dict[str, Any]]:
        return float((moved.node_position**2).sum()), {"node_position": 2.0 * moved.node_position}

    design: tc.Design = tc.optimise(
        tc.LossGradient(SCENE, ["gravity[2]"], loss, 0.1, samples=3), max_iterations=1
    )
    assert design.loss <= design.start_loss

    def roll() -> tc.Walk:
        gait: tc.Gait = tc.design_gait(SCENE)
        return gait.walk(3, (0.0, 1.0))

    refused = ""
    try:
        roll()
    except tc.TensegrityError as error:
        refused = str(error)
    assert "winches" in refused
    shape: tc.Form = tc.form(SCENE, density={"cables": 5.0})
    assert shape.status == "stable"
    sizing: tc.Sizing = tc.size_members(
        SCENE, density=7850.0, yield_stress=2e8, load_cases={"pull": {"load": [0.0, 0.0, -50.0]}}
    )
    assert sizing.status == "optimal"
    structure, _ = tc.load_scene(SCENE)
    backwards = tc.ModelRequest(
        ("member_tension", "acceleration", "kinetic_energy", "total_energy", "adjoint_rate"),
        integrators=("rk853",),
    )
    taped = tc.build_library(structure, backwards).load()
    slopes: tc.MotionGradient = tc.motion_gradient(taped, loss, 0.1, samples=3)
    assert slopes.by["velocity"].size == tc.motion_function(taped, 0.1, ["velocity"]).size1_in(0)
    try:  # JAX and PyTorch are not there everywhere
        for build in (tc.to_jax, tc.to_torch):
            build(tc.compile_scene(SCENE, for_="derivatives"), "acceleration")
        for build_motion in (tc.to_jax_motion, tc.to_torch_motion):
            build_motion(tc.compile_scene(SCENE, for_="motion_derivatives"), 0.1)
    except tc.TensegrityError as error:
        print(error)
    return {"tuning": tuning, "study": study, "runs": runs, "loaded": loaded, "graphs": graphs, "fmu": fmu}
