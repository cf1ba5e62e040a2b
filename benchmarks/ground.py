"""Structures on the ground beside MuJoCo and Drake: creep at rest, a bounce, a prism that drops.

python benchmarks/ground.py [--write]   needs mujoco (extra `bench`), some rows drake

- Creep: a block of 1 kg at rest on a slope of 20 degrees with friction 0.5, which holds up to 26.6; its speed
  after 2 s. A dry block does not move.
- Bounce: 1 kg falls 0.5 m onto a ground of 1e5 N/m with the dissipation 0.311252583112 s/m; the height after
  0.9 s against 0.077226660238 m. Drake has the same normal law, MuJoCo another one.
- Prism: six nodes of 0.02 kg, three rigid bars of 0.1 kg, nine damped cables, tilted, dropped from 0.5 m onto
  a ground of 2e4 N/m with friction 0.5, 0.6 s. Our error is against our motion at a relative tolerance of
  1e-13; MuJoCo's contact law is another one, so its error is how far it moves when its step is halved.

Times are medians of CPU time over rounds that take turns, of whole runs called from Python, of ours with the
check of their error.
"""

import argparse
import importlib.util
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np
from harness.turns import draw_bars, find_about, publish, table_text, time_in_turns
from numpy.typing import NDArray

from tensegrity_codegen.export.rigid_parts import numbers
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.integrate.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.integrate.event_log import Watch
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.trajectory.simulation_quantities import SIMULATION_QUANTITIES
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.request import ModelRequest
from tests.ground_cases import GRAVITY, make_block, make_prism, make_slope
from tests.runtime.integrate.test_ground import rotate

FloatArray = NDArray[np.float64]
Row = tuple[str, ...]
PAGE = "ground_measured.md"
METHODS = ("rk54", "rk853")
SLOPE, REST_TIME = np.radians(20.0), 2.0
BOUNCE_TIME, BOUNCE_HEIGHT, DISSIPATION = 0.9, 0.077226660238, 0.311252583112
PRISM_TIME, ROUNDS = 0.6, 5
DROP = ("tilted prism", "error at the end [m]", "CPU [ms]", "times faster than MuJoCo at 5e-5 s")
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-8, 1e-10)
MUJOCO_STEPS = (1e-3, 2e-4, 1e-4, 5e-5)
DRAKE_SOLVERS, DRAKE_SCHEMES = ("sap", "similar"), ("runge_kutta3", "radau3")
MUJOCO_CREEP = {
    "MuJoCo, elliptic cone": ("", ""),
    "MuJoCo, impratio 1e4, stiffened": ('impratio="1e4"', 'solref="0.002 1" solimp="0.9999 0.9999 0.001"'),
    "MuJoCo, noslip": ('noslip_iterations="10"', ""),
}
BALL = 0.01  # radius of a peer's contact [m]


def main() -> None:
    """Print three tables, or write them into the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--write", action="store_true", help=f"write docs/{PAGE}")
    chosen = parser.parse_args()
    prism = measure_prism()
    publish(
        PAGE,
        describe_finding(prism),
        draw_bars(DROP[0], DROP[3]),
        table_text(DROP, prism),
        table_text(("block at rest on 20 degrees", "speed after 2 s [m/s]"), measure_creep()),
        table_text(("bounce", "error of the height after 0.9 s [m]"), measure_bounce()),
        find_about(__doc__),
        write=chosen.write,
    )


def describe_finding(rows: Sequence[Row]) -> str:
    """Return how many times faster than MuJoCo's shortest step ours are, and the errors of both."""
    ours, peers = (
        [row for row in rows if row[0].startswith("MuJoCo") == is_peer] for is_peer in (False, True)
    )
    slow, fast = (choose(ours, key=lambda row: float(row[3])) for choose in (min, max))
    loose = max(ours, key=lambda row: float(row[1]))
    return (
        f"A prism that drops onto the ground: {slow[3]} to {fast[3]} times as fast as {peers[-1][0]}, which "
        f"is off by {peers[-1][1]} m; ours by {loose[1]} m at worst ({loose[0]})"
    )


def measure_creep() -> list[Row]:
    """Return program and speed of the block downhill."""
    slope, downhill = make_slope(SLOPE)
    speeds = {name: float(prepare(slope, name, 1e-8, REST_TIME)()[3:6] @ downhill) for name in METHODS}
    for name, (options, contact) in MUJOCO_CREEP.items():
        speeds[name] = float(push_mujoco_ball(options, contact)[0])
    for name in DRAKE_SOLVERS + DRAKE_SCHEMES if has_drake() else ():
        speeds[f"Drake, {name}"] = float(move_drake_ball(name, SLOPE, 0.0, REST_TIME)[1][0])
    return [(name, f"{abs(speed):.1e}") for name, speed in speeds.items()]


def measure_bounce() -> list[Row]:
    """Return program and error of the height of a ball of 1 kg that fell 0.5 m."""
    ball = make_block([0.0, 0.0, 0.5], dissipation=DISSIPATION)
    heights = {
        f"{name}, rtol {rtol:.0e}": float(prepare(ball, name, rtol, BOUNCE_TIME)()[2])
        for name in METHODS
        for rtol in (1e-6, 1e-10)
    }
    for name in DRAKE_SOLVERS + DRAKE_SCHEMES if has_drake() else ():
        heights[f"Drake, {name}"] = float(move_drake_ball(name, 0.0, 0.5, BOUNCE_TIME)[0][2])
    return [(name, f"{abs(height - BOUNCE_HEIGHT):.1e}") for name, height in heights.items()]


def measure_prism() -> list[Row]:
    """Return program and setting, error, time and ratio to MuJoCo's time at its shortest step."""
    prism = make_prism(rotate((0.0, 0.3, 0.2)))
    n_positions = prism.node_position.size
    exact = prepare(prism, "rk853", 1e-13, PRISM_TIME)()[:n_positions]
    runs = {f"{m}, rtol {r:.0e}": prepare(prism, m, r, PRISM_TIME) for m in METHODS for r in TOLERANCES}
    errors = {name: float(np.abs(run()[:n_positions] - exact).max()) for name, run in runs.items()}
    peers = {f"MuJoCo RK4, {step:.0e} s": prepare_mujoco_prism(prism, step) for step in MUJOCO_STEPS}
    for (name, run), step in zip(peers.items(), MUJOCO_STEPS, strict=True):
        errors[name] = float(np.abs(run() - prepare_mujoco_prism(prism, step / 2)()).max())
    times = time_in_turns(runs | peers, ROUNDS)
    slowest = times[f"MuJoCo RK4, {MUJOCO_STEPS[-1]:.0e} s"]
    return [(n, f"{errors[n]:.1e}", f"{1e3 * t:.2f}", f"{slowest / t:.0f}") for n, t in times.items()]


def prepare(structure: Structure, method: str, rtol: float, t_end: float) -> Callable[[], FloatArray]:
    """Return a run of one of our methods from the scene's start to the state (q, v, z) at the end."""
    formulation = "rigid_bar" if structure.is_rigid.any() else "node_position"
    request = ModelRequest(
        SIMULATION_QUANTITIES, formulation=formulation, integrators=(method,), events=("auto",)
    )
    model = build_library(structure, request, flags="native").load()
    state = np.concatenate([model.nominal("coordinate"), model.nominal("velocity")])
    motion = Motion(model, state, np.array([0.0, t_end]), watch=Watch(("cable", "ground", "stick")))
    return lambda: np.asarray(integrate_adaptive(motion, RunOptions(method, rtol, rtol / 100)).state[-1])


# MuJoCo


def push_mujoco_ball(options: str, contact: str) -> FloatArray:
    """Return the velocity of a ball of 1 kg that cannot turn, after its time at rest in tilted gravity."""
    pull = GRAVITY * np.array([np.sin(SLOPE), 0.0, -np.cos(SLOPE)])
    slides = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
    rough = f'friction="0.5 0 0" condim="3" {contact}'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="1e-3" gravity="{numbers(pull)}" cone="elliptic" {options}/><worldbody>'
        f'<geom type="plane" size="5 5 1" {rough}/><body pos="0 0 {BALL}">{slides}'
        f'<geom type="sphere" size="{BALL}" mass="1" {rough}/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=round(REST_TIME / 1e-3))
    return np.array(data.qvel)


def prepare_mujoco_prism(prism: Structure, step: float) -> Callable[[], FloatArray]:
    """Return a run of MuJoCo's RK4 to the node positions at the end (3 n_nodes,) [m]."""
    model = mujoco.MjModel.from_xml_string(describe_prism(prism, step))

    def run() -> FloatArray:
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=round(PRISM_TIME / step))
        mujoco.mj_kinematics(model, data)
        return np.concatenate([data.site(f"n{k}").xpos for k in range(prism.n_nodes)])

    return run


def describe_prism(prism: Structure, step: float) -> str:
    """Return a structure of rigid bars that share no node, on its ground, as MJCF: balls at their ends."""
    place, ground = prism.node_position, prism.ground
    assert ground is not None
    bodies, tendons = [], []
    for e, (i, j) in enumerate(prism.connectivity):
        if not prism.is_rigid[e]:
            stiffness, damping, rest = (
                float(values[e]) for values in (prism.mu, prism.damping, prism.rest_length)
            )
            spring = f'stiffness="{stiffness!r}" damping="{damping!r}" springlength="0 {rest!r}"'
            tendons.append(f'<spatial {spring}><site site="n{i}"/><site site="n{j}"/></spatial>')
            continue
        half = float(np.linalg.norm(place[j] - place[i])) / 2
        mass, ends = float(prism.member_mass[e]), float(prism.node_mass[i] + prism.node_mass[j])
        across, along = mass * half**2 / 3 + ends * half**2, 1e-6
        turn = np.zeros(4)
        mujoco.mju_quatZ2Vec(turn, (place[j] - place[i]) / (2 * half))
        balls = "".join(
            f'<site name="n{node}" pos="0 0 {z!r}"/><geom type="sphere" size="{BALL}" pos="0 0 {z!r}" '
            f'mass="0" friction="{ground.friction} 0 0" condim="3" contype="1" conaffinity="2"/>'
            for node, z in ((i, -half), (j, half))
        )
        inertia = f'mass="{mass + ends!r}" diaginertia="{across!r} {across!r} {along!r}"'
        bodies.append(
            f'<body pos="{numbers((place[i] + place[j]) / 2)}" quat="{numbers(turn)}"><freejoint/>'
            f'<inertial pos="0 0 0" {inertia}/>{balls}</body>'
        )
    world = (
        f'<geom type="plane" size="5 5 1" pos="0 0 -{BALL}" friction="{ground.friction} 0 0" contype="2" '
        'conaffinity="1"/>' + "".join(bodies)
    )
    return (
        f'<mujoco><option timestep="{step!r}" integrator="RK4" gravity="0 0 -{GRAVITY}" cone="elliptic"/>'
        f"<worldbody>{world}</worldbody><tendon>{''.join(tendons)}</tendon></mujoco>"
    )


# Drake


def has_drake() -> bool:
    """Return whether Drake is installed."""
    return importlib.util.find_spec("pydrake") is not None


def move_drake_ball(name: str, slope: float, height: float, t_end: float) -> tuple[FloatArray, FloatArray]:
    """Return position and velocity of a ball of 1 kg that hardly turns, by a discrete solver or a scheme."""
    from pydrake import all as drake

    builder = drake.DiagramBuilder()
    config = drake.MultibodyPlantConfig(time_step=1e-3 if name in DRAKE_SOLVERS else 0.0)
    if name in DRAKE_SOLVERS:
        config.discrete_contact_approximation = name
    plant, _ = drake.AddMultibodyPlant(config, builder)
    inertia = drake.SpatialInertia(1.0, np.zeros(3), drake.UnitInertia(1e6, 1e6, 1e6))
    body = plant.AddRigidBody("ball", inertia)
    soft, hard, still = drake.ProximityProperties(), drake.ProximityProperties(), drake.RigidTransform()
    dissipation = 0.5 if slope else DISSIPATION
    friction: Any = drake.CoulombFriction(0.5, 0.5)
    drake.AddContactMaterial(dissipation, 1e5, friction, soft)
    drake.AddContactMaterial(dissipation=dissipation, friction=friction, properties=hard)
    plant.RegisterCollisionGeometry(body, still, drake.Sphere(BALL), "ball", soft)
    plant.RegisterCollisionGeometry(plant.world_body(), still, drake.HalfSpace(), "ground", hard)
    pull = GRAVITY * np.array([np.sin(slope), 0.0, -np.cos(slope)])
    plant.mutable_gravity_field().set_gravity_vector(pull)
    plant.Finalize()
    simulator = drake.Simulator(builder.Build())
    if name in DRAKE_SCHEMES:
        scheme = drake.SimulatorConfig(integration_scheme=name, accuracy=1e-8, use_error_control=True)
        drake.ApplySimulatorConfig(scheme, simulator)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetFreeBodyPose(context, body, drake.RigidTransform([0.0, 0.0, BALL + height]))
    simulator.AdvanceTo(t_end)
    centre = plant.EvalBodyPoseInWorld(context, body).translation() - [0.0, 0.0, BALL]
    return np.array(centre), np.array(plant.GetVelocities(context)[3:6])


if __name__ == "__main__":
    main()
