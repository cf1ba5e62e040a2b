"""A robot of three rods in flight and on the ground beside MuJoCo: time for one error, and what converges.

python benchmarks/robots.py [--rounds 9] [--only flight ground] [--json FILE] [--write]   needs mujoco

The rods are a tube with two balls and two motors, six points off the axis each, nine damped cables.

- Flight: 0.5 s without gravity, the rods spinning; the error is the largest of all points at the end, against
  bodies with quaternions by DOP853 at a relative tolerance of 1e-13. Each program at its cheapest setting
  that reaches 1e-6 m: ours by `simulate` from Python, and its C alone in a loop in C; MuJoCo by one `mj_step`
  for all steps, which loops in C, at the longest step of its RK4, with and without its constraint solver.
- Ground: the same robot falls 6 mm onto a floor, level (it rests) or inclined by 5 degrees (it rolls), with
  the servos of its cables at a constant length. The two contact laws are different, so that each program is
  compared with itself: MuJoCo by how far points at the end move when its step is halved, ours by how far they
  are from those at a relative tolerance of 1e-12. The stiffness of the ground is MuJoCo's at rest.

Times are medians of processor time of single runs over rounds that take turns.
"""

import argparse
import json
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from harness.turns import (
    draw_bars,
    find_about,
    measure_call,
    publish,
    table_text,
    take_turns,
    time_in_turns,
)
from numpy.typing import NDArray

from tensegrity_codegen.codegen.compilation.flags import build_program_command, find_flags
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.export.rigid_parts import numbers
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.simulation_quantities import simulation_quantities
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.request import AUTO_EVENTS, ModelRequest
from tests.free_body_cases import make_three_rods
from tests.reference_bodies import BodyReference, read_orientation
from tests.scene.samples import build

Array = NDArray[np.float64]
Row = dict[str, Any]
FLIGHT_TIME, FLIGHT_ERROR = 0.5, 1e-6
GROUND_TIMES, SLOPES = (1.0, 2.0), (0.0, 5.0)
LIFT, BALL = 0.03, 0.024  # of the rods above their place in flight, radius of the balls [m]
SERVO = 500.0  # stiffness of the servos of bottom and top cables, which hold 0.16 m [N/m]
GROUND = {
    "stiffness": 11361.0,
    "stick_stiffness": 11361.0,
    "dissipation": 2.0,
    "friction": 0.8,
    "stick_damping": 30.0,
}
METHODS = ("rk54", "rk853")
RTOLS = tuple(10.0 ** (-k / 10) for k in range(30, 90))
GROUND_RTOLS = (1e-4, 1e-6, 1e-8, 1e-10)
MUJOCO_COUNTS = tuple(range(400, 500, 5))  # steps of the flight
MUJOCO_STEPS = (2e-3, 5e-4, 1.25e-4, 3.125e-5, 7.8125e-6)
MUJOCO_INTEGRATORS = ("Euler", "implicitfast", "implicit", "RK4")
FLAGS = {"": "", ", without constraints": '<flag constraint="disable"/>'}
PAGE = "robots_measured.md"
FLIGHT = ("program", "setting", "error [m]", "CPU [ms]", "times slower than our C")
# Runs of the library's own integrator, timed in C; prints the seconds of one run, then the state at the end.
DRIVER = """
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "flight.h"
int main(int argc, char **argv) {
  static double state[FLIGHT_N_STATES], work[FLIGHT_RK853_WORK];
  const double t_end = atof(argv[1]), rtol = atof(argv[2]);
  const int n = atoi(argv[3]), watch = argc > 4 ? FLIGHT_EVENT_CABLE : 0;
  const clock_t started = clock();
  for (int k = 0; k < n; ++k) {
    double time = 0.0, step = 0.0;
    long long n_sampled = 0;
    flight_run run = {0};
    memset(work, 0, sizeof work);
    memcpy(state, flight_nominal_coordinate, sizeof flight_nominal_coordinate);
    memcpy(state + FLIGHT_N_COORDINATES, flight_nominal_velocity, sizeof flight_nominal_velocity);
    run.watch = watch;
    run.follows_two_errors = 1;
    if (flight_integrate_rk853_run(t_end, rtol, rtol, 1000000, &time, &step, state, 0, NULL, NULL, &n_sampled,
                                   &run, work)) return 1;
  }
  printf("%.9e", (double)(clock() - started) / CLOCKS_PER_SEC / n);
  for (int k = 0; k < FLIGHT_N_COORDINATES; ++k) printf(" %.17g", state[k]);
  return 0;
}
"""


def main() -> None:
    """Print both tables, or write them into the document."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--rounds", type=int, default=9, help="rounds of the times")
    parser.add_argument("--only", nargs="*", choices=("flight", "ground"), default=("flight", "ground"))
    parser.add_argument("--json", type=Path, help="file for all rows")
    parser.add_argument("--write", action="store_true", help=f"write docs/{PAGE}")
    chosen = parser.parse_args()
    found: dict[str, Any] = {}
    if "flight" in chosen.only:
        found["flight"] = measure_flight(chosen.rounds)
    if "ground" in chosen.only:
        found["ground"] = [
            row
            for slope in SLOPES
            for t_end in GROUND_TIMES
            for row in measure_ground(slope, t_end, chosen.rounds)
        ]
    if chosen.json:
        chosen.json.write_text(json.dumps(found, indent=1), encoding="utf-8")
    parts = (*print_tables(found), find_about(__doc__))
    publish(PAGE, describe_finding(found), *parts, write=chosen.write)


def describe_finding(found: Mapping[str, Sequence[Row]]) -> str:
    """Return the ratio to MuJoCo in flight, and the least and largest ones on the ground."""
    words = []
    if "flight" in found:
        own = {row["name"]: row["seconds"] for row in found["flight"]}
        peer = min(seconds for name, seconds in own.items() if name.startswith("MuJoCo"))
        call = next(seconds for name, seconds in own.items() if name.startswith("simulate"))
        words.append(
            f"in flight at equal error MuJoCo takes {peer / own['C alone']:.1f} times the time of our C, "
            f"{peer / call:.2g} times that of `simulate`"
        )
    if "ground" in found:
        rows = [row for row in found["ground"] if row["name"].startswith("MuJoCo")]
        ratios = {row["ratio"] for row in rows if row["setting"] == rows[0]["setting"]}
        least, most = min(ratios), max(ratios)
        words.append(f"on the ground {least:.2g} to {most:.2g} times at its step of {rows[0]['setting']}")
    text = ", ".join(words)
    return text[0].upper() + text[1:]


def print_tables(found: Mapping[str, Any]) -> Iterator[str]:
    """Yield the tables of what was measured, as Markdown."""
    if "flight" in found:
        own = next(row["seconds"] for row in found["flight"] if row["name"] == "C alone")
        rows = [
            (row["name"], row["setting"], f"{row['error']:.1e}", f"{1e3 * row['seconds']:.3f}",
             f"{row['seconds'] / own:.1f}")
            for row in found["flight"]
        ]  # fmt: skip
        yield f"A flight of {FLIGHT_TIME} s:"
        yield draw_bars(FLIGHT[0], FLIGHT[4])
        yield table_text(FLIGHT, rows)
    if "ground" in found:
        yield from print_ground(found["ground"])


def print_ground(rows: list[Row]) -> Iterator[str]:
    """Yield a table of MuJoCo's runs, then one of ours: a row for each floor, time and method."""
    groups: dict[tuple[float, float, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["slope"], row["t_end"], row["name"]), []).append(row)
    for is_ours, words in ((False, "change [m] when halved"), (True, "change [m] from rtol 1e-12")):
        chosen = {key: group for key, group in groups.items() if key[2].startswith("ours") == is_ours}
        settings = [row["setting"] for row in next(iter(chosen.values()))]
        more = ("CPU [ms] at the last", "times slower than ours", "at the first")
        last = ("CPU [ms]",) if is_ours else more
        head = ("floor", "time [s]", f"program, {words}", *settings, *last)
        yield table_text(head, [list(list_cells(key, group, is_ours)) for key, group in chosen.items()])


def list_cells(key: tuple[float, float, str], group: list[Row], is_ours: bool) -> Iterator[str]:
    """Yield the cells of a row of one method."""
    slope, t_end, name = key
    yield from (f"{slope:.0f} deg", f"{t_end:.0f}", name)
    yield from (f"{row['error']:.1e}" for row in group)
    times = [f"{1e3 * row['seconds']:.1f}" for row in group]
    yield ", ".join(times) if is_ours else times[-1]
    if not is_ours:
        yield from (f"{group[k]['ratio']:.2g}" for k in (-1, 0))


def make_robot(slope: float | None) -> dict[str, Any]:
    """Return the scene in flight, or on a ground that descends along x by a slope [deg]."""
    if slope is None:
        return make_three_rods()
    scene = make_three_rods(((0.0, 0.0, 0.0),) * 3)
    tilt, feet = np.radians(slope), {"foot_low": -0.17, "foot_high": 0.17}
    for body in scene["bodies"].values():
        balls = {name: {"position": [0.0, 0.0, z], "radius": BALL} for name, z in feet.items()}
        body["points"] = body["points"] | balls
        for end in ("from", "to"):
            body[end] = [*body[end][:2], body[end][2] + LIFT]
    for name, member in scene["members"].items():
        member["spring_constant"] += 0.0 if name.startswith("vertical") else SERVO
    contacts = [f"{name}.{foot}" for name in scene["bodies"] for foot in feet]
    pull = 9.81 * np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
    return scene | {"gravity": pull.tolist(), "ground": {"contacts": contacts, **GROUND}}


def measure_flight(rounds: int) -> list[Row]:
    """Return each program at its cheapest setting that reaches the error."""
    scene = make_robot(None)
    exact = find_exact(scene)
    runs: dict[str, tuple[str, float, Callable[[], float]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, setting, error, clock in (*try_ours(scene, exact, Path(folder)), *try_mujoco(scene, exact)):
            runs[name] = (setting, error, clock)
        seconds = take_turns({name: clock for name, (_, _, clock) in runs.items()}, rounds)
    return [
        {"name": name, "setting": setting, "error": error, "seconds": float(np.median(seconds[name]))}
        for name, (setting, error, _) in runs.items()
    ]


def find_exact(scene: Mapping[str, Any]) -> Array:
    """Return the points of all bodies at the end of the flight (n_points, 3) [m], by the reference."""
    reference = BodyReference(scene)
    state = reference.integrate([FLIGHT_TIME], 1e-13)[0]
    return np.array(reference.move_points(state, reference.owner, reference.local)[0])


def try_ours(scene: dict[str, Any], exact: Array, folder: Path) -> Iterator[tuple[str, str, float, Any]]:
    """Yield our doors at the loosest tolerance that reaches the error: name, setting, error, clock."""
    structure = build(scene)[0]
    at = find_points(structure, scene)

    def accepts(position: Array) -> float:
        error = float(np.abs(position[at] - exact).max())
        return error if error < FLIGHT_ERROR else 0.0

    for rtol in RTOLS:
        model = compile_scene(scene, for_=("simulate",), rtol=rtol)
        call = partial(simulate, model, FLIGHT_TIME, samples=2, rtol=rtol)
        if error := accepts(call().node_position[-1]):
            yield "simulate, all by default", f"rtol {rtol:.1e}", error, partial(measure_call, call, 20)
            break
    built = build_library(structure, request_motion("rk853"), flags="native")
    built.export(folder / "flight")
    (folder / "flight" / "drive.c").write_text(DRIVER, encoding="utf-8")
    command = build_program_command(find_compiler(), find_flags("native"), ("drive.c", "flight.c"), "drive")
    subprocess.run([*command, "-lm"], cwd=folder / "flight", check=True)
    for name, watch in (("C alone", ()), ("C alone, with events of cables", ("watch",))):
        for rtol in RTOLS:
            words = (str(folder / "flight" / "drive"), repr(FLIGHT_TIME), repr(rtol))
            state = np.array(run_program(*words, "1", *watch)[1:])
            position = structure.node_position.copy()
            position[tuple(structure.coordinate_node_axis.T)] = state
            for place in structure.body_places:
                place.attach(position)
            if error := accepts(position):
                clock = partial(lambda *all_words: run_program(*all_words)[0], *words, "300", *watch)
                yield name, f"rk853, rtol {rtol:.1e}", error, clock
                break


def find_points(structure: Structure, scene: Mapping[str, Any]) -> list[int]:
    """Return the nodes of all points of bodies, in the order of the scene."""
    return [structure.node_name.index(name.replace(".", "_")) for name in BodyReference(scene).index]


def request_motion(*methods: str) -> ModelRequest:
    """Return a request of what simulations need."""
    names = simulation_quantities("rigid_bar")
    return ModelRequest(names, formulation="rigid_bar", integrators=methods, events=AUTO_EVENTS)


def run_program(*words: str) -> list[float]:
    """Return the numbers that a program prints."""
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return [float(word) for word in done.stdout.split()]


def try_mujoco(scene: Mapping[str, Any], exact: Array) -> Iterator[tuple[str, str, float, Any]]:
    """Yield MuJoCo's RK4 at the longest step that reaches the error."""
    for words, flag in FLAGS.items():
        for count in MUJOCO_COUNTS:
            run = prepare_mujoco(scene, "RK4", FLIGHT_TIME, count, flag)
            error = float(np.abs(run() - exact).max())
            if error < FLIGHT_ERROR:
                yield f"MuJoCo RK4{words}", f"{count} steps", error, partial(measure_call, run, 5)
                break


def measure_ground(slope: float, t_end: float, rounds: int) -> list[Row]:
    """Return how far runs of each program are from its own better ones, and their times."""
    scene = make_robot(slope)
    structure = build(scene)[0]
    model = build_library(structure, request_motion(*METHODS), flags="native").load()
    at = find_points(structure, scene)

    def move(method: str, rtol: float) -> Array:
        stepping = Stepping(atol=rtol / 10, control="steps", max_steps=10_000_000)
        found = simulate(model, t_end, samples=2, method=method, rtol=rtol, stepping=stepping)
        return np.array(found.node_position[-1, at])

    rows: list[Row] = []
    calls: dict[str, Callable[[], Array]] = {}

    def add(name: str, setting: str, call: Callable[[], Array], better: Array) -> None:
        calls[str(len(rows))] = call
        error = float(np.abs(call() - better).max())
        rows.append({"slope": slope, "t_end": t_end, "name": name, "setting": setting, "error": error})

    for method in METHODS:
        exact = move(method, 1e-12)
        for rtol in GROUND_RTOLS:
            add(f"ours, {method}", f"rtol {rtol:.0e}", partial(move, method, rtol), exact)
    for integrator in MUJOCO_INTEGRATORS:
        for step in MUJOCO_STEPS:
            count = round(t_end / step)
            call, finer = (prepare_mujoco(scene, integrator, t_end, n, "") for n in (count, 2 * count))
            add(f"MuJoCo {integrator}", f"{1e3 * step:.3g} ms", call, finer())
    seconds = time_in_turns(calls, max(1, rounds // 3))
    for row, found in zip(rows, seconds.values(), strict=True):
        row["seconds"] = found
    own = [row for row in rows if row["name"].startswith("ours")]
    for row in rows:
        equal = [mine["seconds"] for mine in own if mine["error"] <= row["error"]]
        row["ratio"] = row["seconds"] / min(equal, default=float("nan"))
    return rows


def prepare_mujoco(
    scene: Mapping[str, Any], integrator: str, t_end: float, count: int, flag: str
) -> Callable[[], Array]:
    """Return a run of MuJoCo to the positions of all points at the end (n_points, 3) [m]."""
    model = mujoco.MjModel.from_xml_string(describe_robot(scene, integrator, t_end / count, flag))
    spins = [body["angular_velocity"] for body in scene["bodies"].values()]

    def run() -> Array:
        data = mujoco.MjData(model)
        for k, spin in enumerate(spins):
            data.qvel[6 * k + 3 : 6 * k + 6] = spin
        data.ctrl[:] = data.act[:] = 0.16
        mujoco.mj_step(model, data, nstep=count)
        mujoco.mj_kinematics(model, data)
        return np.array(data.site_xpos)

    return run


def describe_robot(scene: Mapping[str, Any], integrator: str, step: float, flag: str) -> str:
    """Return the scene as MJCF; only balls and floor touch."""
    ground, bodies, tendons, servos = scene.get("ground"), [], [], []
    touch = 'contype="1" conaffinity="2"' if ground else 'contype="0" conaffinity="0"'
    for name, body in scene["bodies"].items():
        geoms = "".join(
            f'<geom type="{"sphere" if part["kind"] == "ball" else "cylinder"}" size="{part["radius"]!r}" '
            f'mass="{part["mass"]!r}" '
            + (f'pos="{numbers(part["position"])}" {touch}/>' if "position" in part
               else f'fromto="{numbers(part["from"])} {numbers(part["to"])}" contype="0" conaffinity="0"/>')
            for part in body["parts"]
        )  # fmt: skip
        sites = "".join(
            f'<site name="{name}.{key}" pos="{numbers(at["position"] if isinstance(at, dict) else at)}"/>'
            for key, at in body["points"].items()
        )
        place = (
            f'pos="{numbers(np.add(body["from"], body["to"]) / 2)}" quat="{numbers(read_orientation(body))}"'
        )
        bodies.append(f'<body name="{name}" {place}><freejoint/>{geoms}{sites}</body>')
    for name, member in scene["members"].items():
        ends = "".join(f'<site site="{end}"/>' for end in member["nodes"])
        servo = bool(ground) and not name.startswith("vertical")
        stiffness = member["spring_constant"] - (SERVO if servo else 0.0)
        spring = f'stiffness="{stiffness!r}" damping="{member["damping"]!r}"'
        spring += f' springlength="0 {member["rest_length"]!r}"'
        tendons.append(f'<spatial name="{name}" {spring}>{ends}</spatial>')
        if servo:
            servos.append(f'<position tendon="{name}" kp="{SERVO!r}" ctrlrange="0.1 0.3"/>')
    floor = '<geom type="plane" size="5 5 1" contype="2" conaffinity="1"/>' if ground else ""
    pull = numbers(scene.get("gravity", (0.0, 0.0, 0.0)))
    return (
        f'<mujoco><compiler angle="radian"/><option timestep="{step!r}" integrator="{integrator}" '
        f'gravity="{pull}" cone="elliptic">{flag}</option><default>'
        '<geom condim="3" friction="0.8 0.005 0.0001" solref="-5000 -50"/>'
        f'<general dyntype="filter" dynprm="0.05"/></default><worldbody>{floor}{"".join(bodies)}</worldbody>'
        f"<tendon>{''.join(tendons)}</tendon><actuator>{''.join(servos)}</actuator></mujoco>"
    )


if __name__ == "__main__":
    main()
