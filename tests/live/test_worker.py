"""The worker of a running model in node: pulled bars beside native C, energies, orders that are refused."""

import base64
import json
import shutil
import subprocess
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import Profile, compile_scene, load_scene, simulate
from tensegrity_codegen.cli.picture import request_play
from tensegrity_codegen.live.engine import add_engine
from tensegrity_codegen.live.live_page import live_folder
from tensegrity_codegen.live.live_scene import build_live_scene
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.integrate.options import Stepping
from tests.codegen.compilers import require_compiler
from tests.live.pages import EXAMPLES, GALLERY
from tests.live.test_live_scene import unpack
from tests.rigid_scenes import HANGING as RODS

# Zig compiles the C library of WebAssembly the first time, for minutes where the processor is shared.
pytestmark = [
    pytest.mark.thorough,
    pytest.mark.optimised,
    pytest.mark.timeout(1800),
    pytest.mark.skipif(shutil.which("node") is None, reason="no node is installed"),
]

# Four bars with axial vibrations of 1,600 Hz.
QUAD = """
name = "quad"
gravity = [0, 0, -9.81]
[classes.bar]
kind = "bar"
spring_constant = 5e6
density = 1800
radius = 0.006
inner_radius = 0.005
[classes.cable]
kind = "cable"
spring_constant = 2e4
[shape]
kind = "prism"
bars = 4
bottom_radius = 0.40
top_radius = 0.30
height = 0.90
node_mass = 0.05
anchor_bottom = "z"
prestress = 300
[[loads]]
node = "t1"
force = [0, 0, -100]
"""

DRIVER = """
const { worker, engine, module, given } = JSON.parse(require("fs").readFileSync(0));
let last = null;
Object.assign(globalThis, { onmessage: null, postMessage: (state) => (last = state) });
(0, eval)(worker);
const order = (name, more = {}) => (onmessage({ data: { order: name, answer: 1, ...more } }), last);
const built = order("build", { engine, bytes: Buffer.from(module, "base64") });
if (built.refused) throw new Error(built.refused);
const result = (() => { SCRIPT })();
process.stdout.write(JSON.stringify(result), () => process.exit(0)); // its ports keep node alive
"""

# Pulls a node upwards; the pointer stands still or moves on a circle. Rows of time, force, tensions of bars,
# and energy with that of the spring.
PULL = """
const { method, node, bars, force, period, count, step } = given;
order("method", { name: method });
const start = Array.from(order("state").nodes.slice(3 * node, 3 * node + 3));
const { stiffness, mass } = engine.pull, far = force / stiffness, damping = 0.5 * Math.sqrt(stiffness * mass);
const target = (time) => {
  const angle = period ? 2 * Math.PI * time / period : 0;
  return [start[0] + far * Math.sin(angle), start[1], start[2] + far * Math.cos(angle)];
};
const rows = [];
for (let k = 0, next = 0; k <= count; k++) {
  const time = k * step;
  let state = order("advance", { time });
  if (time >= next) {
    state = order("pull", { pull: { node, target: target(time + 1 / 60), stiffness, damping } });
    next = period ? next + 1 / 60 : Infinity;
  }
  if (state.status) throw new Error(state.text);
  const stretch = Math.hypot(...[0, 1, 2].map((axis) => target(0)[axis] - state.nodes[3 * node + axis]));
  const energy = state.total + 0.5 * stiffness * stretch ** 2;
  rows.push([time, state.pull, bars.map((e) => state.tension[e]), energy]);
}
return rows;
"""


def run_worker(subject: Any, built: Any, script: str, profile: Profile | None = None, **given: Any) -> Any:
    """Return what a script says that orders a worker in node: `engine`, `given` and `order` are there."""
    shown, module = build_live_scene(subject), built.path.read_bytes()
    scene = add_engine(shown, subject, built.manifest, module, rtol=1e-6, profile=profile)

    def list_channel(name: str) -> list[float]:
        return np.asarray(unpack(scene.channels[name])).ravel().tolist()  # type: ignore[no-any-return]

    engine = dict(scene.data["engine"])
    engine |= {name: list_channel(name) for name in ("coordinate_place", "stated_position")}
    engine["nominal"] = {name: list_channel(f"nominal_{name}") for name in engine["sizes"]}
    data = {
        "worker": (live_folder() / "worker.js").read_text(encoding="utf-8"),
        "engine": engine,
        "module": base64.b64encode(built.path.read_bytes()).decode(),
        "given": given,
    }
    command = ["node", "-e", DRIVER.replace("SCRIPT", script)]
    done = subprocess.run(command, input=json.dumps(data), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module", params=["prism", "quad"])
def case(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, ...]:
    """Structure, module, native model and time between the samples [s], which tell the vibrations of bars."""
    require_compiler("zig")
    path = tmp_path_factory.mktemp("worker") / "quad.toml"
    path.write_text(QUAD, encoding="utf-8")
    subject, wanted = load_scene(EXAMPLES / "prism.toml" if request.param == "prism" else path)
    play = request_play(subject, wanted)
    native = build_library(subject, replace(play, integrators=("rk54", "rk853"))).load()
    step = 1e-4 if request.param == "prism" else 2.5e-5
    return subject, build_library(subject, play, target="wasm32"), native, step


@pytest.mark.parametrize("method", ["rk54", "radau"])
@pytest.mark.parametrize(("force", "period"), [(2.0, 0.0), (30.0, 0.0), (30.0, 0.5)])
def test_a_pulled_bar_has_the_tension_of_native_c_under_the_same_force(
    case: tuple[Any, ...], method: str, force: float, period: float
) -> None:
    subject, built, native, step = case
    node, bars = subject.node_name.index("t1"), np.flatnonzero(subject.is_bar)
    rows = run_worker(
        subject, built, PULL, method=method, node=node, bars=bars.tolist(), force=force, period=period,
        count=4000, step=step,
    )  # fmt: skip
    time, tension, energy = (np.array([row[k] for row in rows]) for k in (0, 2, 3))
    load = np.repeat(subject.node_load[None], len(time), axis=0)
    load[:, node] += np.array([row[1] for row in rows])
    motion = simulate(
        native, float(time[-1]), samples=time, method="rk853", rtol=1e-9, stepping=Stepping(control="steps"),
        schedule=Profile(time, {"node_load": load}, "cubic"),
    )  # fmt: skip
    expected = motion.member_tension[:, bars]
    assert np.abs(tension - expected).max() < 0.01 * np.abs(expected).max()
    if not period:  # the pull held still, once it has its strength
        growth = np.diff(energy[time > 1 / 60 + step])
        assert growth.max() < 1e-9 * abs(energy[0])


def test_a_structure_at_rest_stays_calm_after_a_pull(case: tuple[Any, ...]) -> None:
    subject, built, _, _ = case
    script = """
    const { stiffness, mass, place } = engine.pull;
    const start = order("state").nodes.slice(3 * given.node, 3 * given.node + 3);
    const damping = Math.sqrt(stiffness * mass);
    order("pull", { pull: { node: given.node, target: Array.from(start), stiffness, damping } });
    const held = order("advance", { time: 0.1 });
    order("pull", { pull: null });
    const freed = order("advance", { time: 0.2 }), later = order("advance", { time: 0.5 });
    return [held.pull.length, freed.pull.length, freed.total, later.total, later.status];
    """
    held, freed, before, after, status = run_worker(
        subject, built, script, node=subject.node_name.index("t1")
    )
    assert (held, freed, status) == (3, 0, 0)
    assert after == pytest.approx(before, rel=1e-6)  # without a pull nothing takes energy


REFUSED = [
    ("set", {"name": "gravity", "values": [0, 0]}, "3 numbers for gravity"),
    ("set", {"name": "gravity", "values": ["a", 0, 0]}, "3 numbers for gravity"),
    ("set", {"name": "coordinate", "values": []}, "the name of an argument, one of"),
    ("pull", {"pull": {"node": 1.5}}, "null, or a node from 0 to"),
    ("pull", {"pull": {"node": 1, "target": [0, 0]}}, "numbers: target of 3"),
    ("method", {"name": "rk4"}, "the method rk54 or radau"),
    ("speed", {"speed": 0}, "a speed above 0"),
    ("advance", {"time": None}, "a time [s]"),
    ("jump", {}, "the order build, run"),
]


def test_wrong_orders_are_refused_and_change_nothing(case: tuple[Any, ...]) -> None:
    subject, built, _, _ = case
    script = """
    const before = order("advance", { time: 0.01 });
    const refused = given.orders.map(([name, more]) => order(name, more).refused);
    const after = order("state");
    const isSame = before.total === after.total && after.status === 0;
    return [refused, isSame, order("advance", { time: 0.02 }).status];
    """
    texts, is_same, status = run_worker(subject, built, script, orders=[row[:2] for row in REFUSED])
    assert is_same
    assert status == 0
    for (name, _, words), text in zip(REFUSED, texts, strict=True):
        assert text.startswith(f"{name}: ")
        assert words in text


def test_a_structure_on_the_ground_bounces_as_in_native_c() -> None:
    require_compiler("zig")
    subject, request = load_scene(GALLERY / "superball_drop.toml")
    play = request_play(subject, request)
    built = build_library(subject, play, target="wasm32")
    script = """
    const rows = [0.4, 0.6, 1.0].map((time) => Array.from(order("advance", { time }).nodes));
    const { total, status } = order("state");
    order("reset");
    const again = Array.from(order("advance", { time: 1.0 }).nodes);
    return { rows, total, status, again };
    """
    found = run_worker(subject, built, script)
    native = build_library(subject, replace(play, integrators=("rk54", "rk853"), events=("auto",))).load()
    stepping = Stepping(atol=1e-12, control="steps")
    motion = simulate(
        native, 1.0, samples=[0.0, 0.4, 0.6, 1.0], method="rk853", rtol=1e-10, stepping=stepping
    )
    assert motion.log.count > 5
    rows = np.array(found["rows"]).reshape(3, 12, 3)
    np.testing.assert_allclose(rows, motion.node_position[1:], atol=1e-4)
    assert rows[1, :, 2].min() < 0.031 < rows[0, :, 2].min()  # it has touched with its rods' radius
    assert found["total"] == pytest.approx(motion.total_energy[-1], abs=1e-2)
    assert found["status"] == 0
    np.testing.assert_allclose(found["again"], found["rows"][-1], atol=1e-4)


def test_inputs_follow_their_profile_as_in_native_c() -> None:
    """Of three winches one stands still and one jumps; a pull without strength changes nothing."""
    require_compiler("zig")
    subject, request = load_scene(GALLERY / "icosahedron_roll.toml")
    play = request_play(subject, request)
    built = build_library(subject, play, target="wasm32")
    values = {"winch_1": [0, -0.17, -0.17, 0, 0, 0], "winch_3": [0, 0, 0, -0.01, 0.01, 0.01]}
    profile = Profile([0.0, 0.5, 0.9, 1.4, 1.4, 1.6], values)
    script = """
    const rows = [0.3, 0.95, 2.0].map((time) => {
      const { nodes, tension } = order("advance", { time });
      return [Array.from(nodes), Array.from(tension)];
    });
    order("reset");
    order("advance", { time: 0.33 });
    order("pull", { pull: { node: 5, target: [0, 0, 1], stiffness: 0, damping: 0 } });
    order("advance", { time: 0.95 });
    order("pull", { pull: null });
    const { nodes, tension, status } = order("advance", { time: 2.0 });
    return { rows, again: Array.from(nodes), status, labels: engine.sliders.map(({ label }) => label) };
    """
    found = run_worker(subject, built, script, profile)
    native = build_library(subject, replace(play, integrators=("rk54", "rk853"), events=("auto",))).load()
    longer = Profile([*profile.time, 2.0], {name: [*row, row[-1]] for name, row in values.items()})
    motion = simulate(
        native, 2.0, samples=[0.0, 0.3, 0.95, 2.0], method="rk853", rtol=1e-10, schedule=longer,
        stepping=Stepping(atol=1e-12, control="steps"),
    )  # fmt: skip
    assert np.abs(motion.node_position[-1] - motion.node_position[0]).max() > 0.1
    for k, (nodes, tension) in enumerate(found["rows"], start=1):
        np.testing.assert_allclose(np.reshape(nodes, (12, 3)), motion.node_position[k], atol=1e-4)
        np.testing.assert_allclose(tension[6:], motion.member_tension[k, 6:], atol=0.05)
    np.testing.assert_allclose(found["again"], found["rows"][-1][0], atol=1e-5)
    assert found["status"] == 0
    assert [label for label in found["labels"] if label.startswith("winch")] == ["winch_2"]


def test_points_of_bodies_are_where_native_c_has_them() -> None:
    require_compiler("zig")
    subject, wanted = load_scene(RODS)
    play = request_play(subject, wanted)
    script = "const { nodes, tension } = order('advance', { time: 0.2 }); return [[...nodes], [...tension]];"
    nodes, tension = run_worker(subject, build_library(subject, play, target="wasm32"), script)
    own = simulate(compile_scene(RODS, for_="simulate"), t_end=0.2, samples=2, rtol=1e-9)
    np.testing.assert_allclose(np.reshape(nodes, (-1, 3)), own.node_position[-1], atol=1e-5)
    np.testing.assert_allclose(tension[:2], own.member_tension[-1, :2], atol=1e-2)
