"""Robot steps a second at 50 Hz control beside MuJoCo, at one error a step.

python benchmarks/environments.py [--rounds 5] [--robots 512] [--mjx] [--json FILE] [--write]   needs mujoco

Two robots on a floor, made of rigid rods with a ball at each end and cables off their axes, a motor in every
cable: three rods in nine cables, and six rods in 24 cables (SuperBall's layout). Both programs read the same
MJCF. Motors get random commands, held over samples of 20 ms. An error is how far the ends of rods are, after
one sample from a state of that program's own motion, from those of its own converged reference; what counts
is the 95th percentile over states, 1e-4 m at most. Ours runs at the loosest tolerance that reaches it, MuJoCo
at the longest step, with mujoco.rollout on as many threads, and at 2 ms beside it; MJX by --mjx,
at MuJoCo's step. Times are of
the clock, medians over rounds that take turns.
"""

import argparse
import json
import os
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from harness.turns import draw_bars, find_about, publish, table_text
from mujoco import rollout
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from tensegrity_codegen.pipeline.analyses import want_analyses
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.stepper.stepper import Stepper
from tensegrity_codegen.scene.formats.import_mjcf import import_mjcf

Array = NDArray[np.float64]
SAMPLE, ALLOWED, SHARE = 0.02, 1e-4, 0.95
RTOLS = tuple(10.0 ** (-k / 2) for k in range(3, 19))
COUNTS = tuple(round(10 * 2 ** (k / 2)) for k in range(19))  # steps of MuJoCo in a sample: 2 ms to 4 us
REFERENCE = 16384  # steps of MuJoCo's reference in a sample: 1.2 us
PAGE = "learning_measured.md"


@dataclass(frozen=True)
class Robot:
    """Rods by their ends (n, 2, 3) [m], cables between ends (rod, end), with stiffness and rest length."""

    name: str
    rods: Array
    cables: tuple[tuple[int, int, int, int], ...]
    stiffness: float
    shortening: float  # rest length over the length in the symmetric shape
    span: float  # largest command over the rest length
    ball: float
    mass: float

    def describe(self, integrator: str, step: float, cone: str) -> str:
        """Return the robot as MJCF, lying 1 mm above a floor."""
        bodies, sites, tendons, motors = [], [], [], []
        low = self.rods[..., 2].min() - self.ball - 1e-3
        half = np.linalg.norm(self.rods[0, 1] - self.rods[0, 0]) / 2
        for k, (first, second) in enumerate(self.rods):
            centre, axis = (first + second) / 2 - [0, 0, low], second - first
            points = []
            for e, sign in enumerate((-1, 1)):
                for j in range(8):
                    x, y = 0.6 * self.ball * np.array([np.cos(np.pi * j / 4), np.sin(np.pi * j / 4)])
                    points.append(f'<site name="s{k}_{e}_{j}" pos="{x} {y} {sign * 0.95 * half}"/>')
            sites.append("".join(points))
            balls = "".join(
                f'<geom type="sphere" size="{self.ball}" pos="0 0 {sign * half}" mass="{self.mass / 4}" '
                'contype="1" conaffinity="2"/>'
                for sign in (-1, 1)
            )
            tube = (
                f'<geom type="cylinder" size="{self.ball / 3}" fromto="0 0 {-half} 0 0 {half}" '
                f'mass="{self.mass / 2}" contype="0" conaffinity="0"/>'
            )
            place = (
                f'pos="{" ".join(map(repr, centre.tolist()))}" zaxis="{" ".join(map(repr, axis.tolist()))}"'
            )
            bodies.append(f'<body name="rod{k}" {place}><freejoint/>{tube}{balls}{sites[-1]}</body>')
        used: dict[tuple[int, int], int] = {}
        for number, (a, e, b, f) in enumerate(self.cables):
            rest = float(np.linalg.norm(self.rods[a, e] - self.rods[b, f])) * self.shortening
            ends = []
            for key in ((a, e), (b, f)):
                used[key] = used.get(key, -1) + 1
                ends.append(f'<site site="s{key[0]}_{key[1]}_{2 * used[key] % 8}"/>')
            spring = f'stiffness="{self.stiffness}" damping="2" springlength="0 {rest!r}"'
            tendons.append(f'<spatial name="c{number}" {spring}>{"".join(ends)}</spatial>')
            most = self.stiffness * rest * self.span
            motors.append(f'<motor tendon="c{number}" gear="-1" ctrlrange="{-most} {most}"/>')
        return (
            f'<mujoco model="{self.name}">'
            f'<option timestep="{step!r}" integrator="{integrator}" cone="{cone}"/>'
            '<default><geom condim="3" friction="0.8 0.005 0.0001" solref="-5000 -50"/></default>'
            '<worldbody><geom type="plane" size="50 50 1" contype="2" conaffinity="1"/>'
            f"{''.join(bodies)}</worldbody><tendon>{''.join(tendons)}</tendon>"
            f"<actuator>{''.join(motors)}</actuator></mujoco>"
        )

    @property
    def largest(self) -> Array:
        """Largest changes of rest lengths (n_cables,) [m]."""
        lengths = [np.linalg.norm(self.rods[a, e] - self.rods[b, f]) for a, e, b, f in self.cables]
        return np.array(lengths) * self.shortening * self.span


def make_three_rods() -> Robot:
    """Return three rods in nine cables."""
    angle = np.radians(120.0 * np.arange(3))
    low = np.stack([0.12 * np.cos(angle), 0.12 * np.sin(angle), np.zeros(3)], axis=1)
    turned = angle + np.radians(150.0)
    high = np.stack([0.12 * np.cos(turned), 0.12 * np.sin(turned), np.full(3, 0.22)], axis=1)
    cables = [(k, end, (k + 1) % 3, end) for end in (0, 1) for k in range(3)]
    cables += [(k, 0, (k + 2) % 3, 1) for k in range(3)]
    return Robot("three_rods", np.stack([low, high], axis=1), tuple(cables), 500.0, 0.8, 0.3, 0.024, 0.24)


def make_six_rods() -> Robot:
    """Return six rods in 24 cables: edges of the hull but for those between ends of parallel rods."""
    half, away = 0.25, 0.125
    rods = []
    for axis in range(3):
        for side in (-1, 1):
            end = np.zeros((2, 3))
            end[:, axis] = [-half, half]
            end[:, (axis + 1) % 3] = side * away
            rods.append(end)
    flat = Rotation.from_euler("xyz", [0.6, 0.4, 0.0]).apply(np.array(rods).reshape(-1, 3))
    edges = {
        tuple(sorted(pair))
        for face in ConvexHull(flat).simplices
        for pair in zip(face, np.roll(face, 1), strict=True)
    }
    cables = [(i // 2, i % 2, j // 2, j % 2) for i, j in sorted(edges) if i // 4 != j // 4]
    assert len(cables) == 24
    return Robot("six_rods", flat.reshape(6, 2, 3), tuple(cables), 400.0, 0.85, 0.25, 0.02, 0.2)


def draw_commands(robot: Robot, count: int, samples: int, seed: int) -> Array:
    """Return changes of rest lengths (count, samples, n_cables) [m], random walks within their range."""
    rng = np.random.default_rng(seed)
    steps = rng.uniform(-0.3, 0.3, (count, samples, len(robot.cables))) * robot.largest
    found, last = np.empty_like(steps), np.zeros((count, len(robot.cables)))
    for k in range(samples):
        last = np.clip(last + steps[:, k], -robot.largest, robot.largest)
        found[:, k] = last
    return found


def compile_robot(robot: Robot) -> CompiledModel:
    """Return our library of the robot, compiled for this machine."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{robot.name}.xml"
        path.write_text(robot.describe("RK4", 1e-3, "elliptic"), encoding="utf-8")
        structure, request = load_scene(import_mjcf(path).document)
    request = want_analyses(structure, replace(request, flags="native"), ("step",), method="rk54")
    return build_library(structure, request).load()


def share(error: Array) -> float:
    """Return the error that counts of many."""
    return float(np.quantile(error, SHARE))


def find_rtol(model: CompiledModel, robot: Robot, states: int) -> dict[str, Any]:
    """Return the loosest tolerance that reaches the error, and the errors at it."""
    commands = draw_commands(robot, states, 60, 1)
    fine = Stepping(max_steps=1_000_000)
    walk = model.stepper(states, sample=SAMPLE, rtol=1e-6, threads=os.cpu_count())
    for k in range(59):
        walk.step(commands[:, k])
    start, command = walk.snapshot(), commands[:, 59]
    start["next_step"][:] = 0.0

    def end_at(rtol: float, **more: Any) -> Stepper:
        found = model.stepper(states, sample=SAMPLE, rtol=rtol, threads=os.cpu_count(), **more)
        found.restore(start)
        found.step(command)
        assert not found.status.any()
        return found

    exact = end_at(1e-12, quantities=(), stepping=fine).coordinate
    for rtol in RTOLS:
        error = np.abs(end_at(rtol).coordinate - exact).max(axis=1)
        if share(error) <= ALLOWED:
            break
    return {"rtol": rtol, "error": share(error), "median": float(np.median(error)), "states": states}


def place_ends(qpos: Array, robot: Robot) -> Array:
    """Return the ends of rods (n, ...) [m] of positions and quaternions (n, 7 n_rods)."""
    parts = qpos.reshape(-1, 7)
    half = np.linalg.norm(robot.rods[0, 1] - robot.rods[0, 0]) / 2
    axis = Rotation.from_quat(parts[:, [4, 5, 6, 3]]).apply([0.0, 0.0, half])
    return np.concatenate([parts[:, :3] + axis, parts[:, :3] - axis], axis=1).reshape(len(qpos), -1)


class Peer:
    """MuJoCo with rollouts on threads."""

    def __init__(self, robot: Robot, integrator: str, cone: str, threads: int) -> None:
        self.robot, self.integrator, self.cone, self.threads = robot, integrator, cone, threads
        self.pool = rollout.Rollout(nthread=threads)
        self.gain = robot.stiffness

    def load(self, count: int) -> mujoco.MjModel:
        """Return the model with so many steps in a sample."""
        text = self.robot.describe(self.integrator, SAMPLE / count, self.cone)
        return mujoco.MjModel.from_xml_string(text)

    def advance(self, model: mujoco.MjModel, state: Array, command: Array, count: int, out: Array) -> Array:
        """Return the states after a sample (n, n_state)."""
        data = [mujoco.MjData(model) for _ in range(self.threads)]
        control = (command * self.gain)[:, None]
        self.pool.rollout(model, data, state, control, nstep=count, state=out)
        return out[:, -1].copy()

    def start(self, model: mujoco.MjModel, n: int) -> Array:
        """Return the state at the start (n, n_state)."""
        data, size = mujoco.MjData(model), mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        state = np.zeros(size)
        mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        return np.tile(state, (n, 1))

    def find_step(self, states: int) -> dict[str, Any]:
        """Return the fewest steps in a sample that reach the error against steps of 1.2 us."""
        walk, commands = 400, draw_commands(self.robot, states, 60, 1)
        model = self.load(walk)
        state, out = self.start(model, states), self.room(model, states, walk)
        for k in range(59):
            state = self.advance(model, state, commands[:, k], walk, out)
        command, ends = commands[:, 59], {}
        for count in (*COUNTS, REFERENCE // 2, REFERENCE):
            model = self.load(count)
            # In parts: a rollout stores every step.
            parts = [state[k : k + 16] for k in range(0, states, 16)]
            found = [
                self.advance(
                    model, part, command[16 * k : 16 * k + 16], count, self.room(model, len(part), count)
                )
                for k, part in enumerate(parts)
            ]
            qpos = np.concatenate(found)[:, 1 : 1 + model.nq]
            ends[count] = place_ends(qpos, self.robot)
        reference = ends[REFERENCE]
        errors = {count: np.abs(end - reference).max(axis=1) for count, end in ends.items()}
        self.at = state, command, reference
        good = next((count for count in COUNTS if share(errors[count]) <= ALLOWED), 0)
        at = errors[good or COUNTS[-1]]
        return {
            "count": good, "error": share(at), "median": float(np.median(at)), "states": states,
            "own": share(errors[REFERENCE // 2]), "usual": share(errors[COUNTS[0]]),
        }  # fmt: skip

    def room(self, model: mujoco.MjModel, n: int, count: int) -> Array:
        """Return memory for the states after every step."""
        return np.empty((n, count, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))


class Mjx:
    """MJX, MuJoCo in JAX, in single precision as it comes: 64 robots in one call."""

    def __init__(self, peer: Peer, count: int) -> None:
        import jax
        from mujoco import mjx

        self.peer, self.jax, model = peer, jax, peer.load(count)
        on_device, blank = mjx.put_model(model), mjx.make_data(model)

        def advance(qpos: Any, qvel: Any, control: Any) -> tuple[Any, Any]:
            data = blank.replace(qpos=qpos, qvel=qvel, ctrl=control)
            data = jax.lax.fori_loop(0, count, lambda _, d: mjx.step(on_device, d), data)
            return data.qpos, data.qvel

        self.advance = jax.jit(jax.vmap(advance))
        self.nq, self.nv = model.nq, model.nv

    def find_error(self, states: Array, command: Array, reference: Array) -> Array:
        """Return how far the ends of rods are after a sample (n,) [m]."""
        qpos, qvel = np.split(states[:, 1 : 1 + self.nq + self.nv], [self.nq], axis=1)
        found, _ = self.advance(qpos, qvel, command * self.peer.gain)
        return np.abs(place_ends(np.asarray(found, np.float64), self.peer.robot) - reference).max(axis=1)

    def prepare(self, n: int, samples: int) -> Callable[[], float]:
        """Return a run to the time of a robot step [s], likewise."""
        start = self.peer.start(self.peer.load(1), n)[:, 1 : 1 + self.nq + self.nv]
        control = draw_commands(self.peer.robot, n, 2 * samples, 2) * self.peer.gain

        def run() -> float:
            state = tuple(np.split(start, [self.nq], axis=1))
            for k in range(2 * samples):
                if k == samples:
                    self.jax.block_until_ready(state)
                    started = time.perf_counter()
                state = self.advance(*state, control[:, k])
            self.jax.block_until_ready(state)
            return (time.perf_counter() - started) / samples / n

        return run


def prepare_ours(
    model: CompiledModel, robot: Robot, rtol: float, n: int, threads: int, samples: int
) -> Callable[[], float]:
    """Return a run of ours to the time of a robot step [s], after as many samples that do not count."""
    stepper = model.stepper(n, sample=SAMPLE, rtol=rtol, threads=threads)
    commands = draw_commands(robot, n, 2 * samples, 2)

    def run() -> float:
        stepper.reset()
        for k in range(2 * samples):
            if k == samples:
                started = time.perf_counter()
            stepper.step(commands[:, k])
        assert not stepper.status.any()
        return (time.perf_counter() - started) / samples / n

    return run


def prepare_peer(peer: Peer, count: int, n: int, samples: int) -> Callable[[], float]:
    """Return a run of MuJoCo to the time of a robot step [s], likewise."""
    model = peer.load(count)
    commands, out = draw_commands(peer.robot, n, 2 * samples, 2), peer.room(model, n, count)
    data = [mujoco.MjData(model) for _ in range(peer.threads)]

    def run() -> float:
        state = peer.start(model, n)
        for k in range(2 * samples):
            if k == samples:
                started = time.perf_counter()
            control = (commands[:, k] * peer.gain)[:, None]
            peer.pool.rollout(model, data, state, control, nstep=count, state=out, skip_checks=False)
            state = out[:, -1].copy()
        return (time.perf_counter() - started) / samples / n

    return run


def measure(robot: Robot, chosen: argparse.Namespace) -> list[dict[str, Any]]:
    """Return the rows of a robot."""
    threads, states = chosen.threads, chosen.states
    rows: list[dict[str, Any]] = []
    runs: list[Callable[[], float]] = []

    def add(name: str, setting: str, error: float, run: Callable[[], float]) -> None:
        rows.append({"robot": robot.name, "name": name, "setting": setting, "error": error})
        print(rows[-1], flush=True)
        runs.append(run)

    model = compile_robot(robot)
    own = find_rtol(model, robot, states)
    for t in sorted({1, threads}):
        run = prepare_ours(model, robot, own["rtol"], chosen.robots, t, 25)
        add(f"ours, {t} thread{'s' if t > 1 else ''}", f"rtol {own['rtol']:.1e}", own["error"], run)
    for integrator, cone in product(("implicitfast", "RK4"), ("elliptic", "pyramidal")):
        peer = Peer(robot, integrator, cone, threads)
        found = peer.find_step(states)
        best = found["count"] or COUNTS[-1]
        for count, error in ((best, found["error"]), (COUNTS[0], found["usual"])):
            n = max(threads * 4, min(chosen.robots, 200_000 // (count * 25) * threads))
            setting = f"{SAMPLE / count * 1e3:.2g} ms"
            add(f"MuJoCo {integrator}, {cone}", setting, error, prepare_peer(peer, count, n, 5))
        if chosen.mjx and cone == "pyramidal":
            mjx = Mjx(peer, best)
            error = share(mjx.find_error(*peer.at))
            setting = f"{SAMPLE / best * 1e3:.2g} ms"
            add(f"MJX {integrator}, {cone}, float32", setting, error, mjx.prepare(states, 2))
    seconds = [[run() for run in runs] for _ in range(chosen.rounds)]
    for row, found_seconds in zip(rows, np.median(seconds, axis=0).tolist(), strict=True):
        row["seconds"] = found_seconds
    fastest = min(row["seconds"] for row in rows if row["name"].startswith("ours"))
    return [{**row, "ratio": row["seconds"] / fastest} for row in rows]


def main() -> None:
    """Print the table, or write it into the document."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5, help="rounds of the times")
    parser.add_argument("--robots", type=int, default=512, help="copies side by side")
    parser.add_argument("--states", type=int, default=64, help="states that errors are found at")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--mjx", action="store_true", help="MJX too, which needs jax and mujoco-mjx; minutes")
    parser.add_argument("--json", type=Path, help="file for all rows")
    parser.add_argument("--write", action="store_true", help=f"write into docs/{PAGE}")
    chosen = parser.parse_args()
    rows = [row for robot in (make_three_rods(), make_six_rods()) for row in measure(robot, chosen)]
    cells = [
        (
            row["robot"].replace("_", " "), row["name"], row["setting"], f"{row['error']:.1e}",
            f"{1 / row['seconds']:,.0f}", f"{row['ratio']:.3g}",
        )
        for row in rows
    ]  # fmt: skip
    head = ("robot", "program", "setting", "error a step [m]", "robot steps/s", "times slower")
    if chosen.json:
        chosen.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    bars = draw_bars("robot, program, setting", "robot steps/s")
    parts = (bars, table_text(head, cells), find_about(__doc__))
    publish(PAGE, describe_finding(cells), *parts, write=chosen.write)


def describe_finding(cells: Sequence[Sequence[str]]) -> str:
    """Return robot steps a second of ours, and the ratios to MuJoCo at equal error and at 2 ms."""
    ours = [row for row in cells if row[1].startswith("ours")]
    peers = [row for row in cells if row[1].startswith("MuJoCo")]
    rates = [f"{max((row[4] for row in ours if row[0] == name), key=read_number)} ({name})"
             for name in dict.fromkeys(row[0] for row in ours)]  # fmt: skip
    equal, usual = ([read_number(row[5]) for row in peers[first::2]] for first in (0, 1))
    return (
        f"{' and '.join(rates)} robot steps a second; MuJoCo is {min(equal):.3g} to {max(equal):.3g} "
        "times slower "
        f"at equal error, {min(usual):.3g} to {max(usual):.3g} times at its 2 ms"
    )


def read_number(text: str) -> float:
    """Return the number of a cell."""
    return float(text.replace(",", ""))


if __name__ == "__main__":
    main()
