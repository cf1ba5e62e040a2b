"""Gradients of motions: columns beside them, backwards over their steps, differences of motions, and diffrax.

python benchmarks/gradients.py [--no-mjx] [--write]   rows of others need diffrax, mujoco-mjx

The tilted prism of benchmarks/ground.py (three rigid bars, nine damped cables, friction), dropped from 0.5
m, 0.6 s, 30 events; the x of its last node at the end, to the logarithms of nine rest lengths, of the
stiffness and of the friction of the ground. Errors are of the largest entry of the gradient, against
columns at a relative tolerance of 1e-12; cost is times one motion at the same tolerance. Backwards, one
column along all numbers is integrated beside the motion, which controls its steps.

Then the shipped tower without ground, 0.5 s from a push of its top: the x of its last node to 60 numbers, 39
rest lengths of cables and 21 of their damping constants; backwards with and without that column.

MJX has its own contacts, so that its motion is another one: its derivative to the logarithm of one rest
length, forward, is compared with central differences of its own runs (step 1e-6).

Times are medians of CPU time over rounds that take turns, of whole runs called from Python.
"""

import argparse
import importlib.util
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import tostring

import numpy as np
from harness.turns import draw_bars, find_about, publish, table_text, time_in_turns
from numpy.typing import NDArray

import tensegrity_codegen
from tensegrity_codegen.export.export_mjcf import build_mjcf
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.integrate.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.integrate.adjoint import TapedRun
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.trajectory.simulation_quantities import SIMULATION_QUANTITIES
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.request import ModelRequest
from tests.ground_cases import GRAVITY, make_prism
from tests.runtime.integrate.test_ground import rotate

FloatArray = NDArray[np.float64]
PAGE = "identify_measured.md"
HEAD = ("gradient to 11 numbers", "error", "CPU [ms]", "in motions", "compiled in [s]")
T_END, ROUNDS, NUMBERS = 0.6, 7, 11
TOWER_END, PUSH = 0.5, 0.5  # [s], [m/s]
EXAMPLES = Path(tensegrity_codegen.__file__).parent / "scene" / "examples"
TOLERANCES = (1e-6, 1e-7, 1e-8, 1e-10)
STEPS = (1e-2, 1e-4, 1e-6)


def main() -> None:
    """Print the tables, or write them into the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--write", action="store_true", help=f"write into docs/{PAGE}")
    parser.add_argument("--no-mjx", action="store_true", help="without MJX, which compiles for minutes")
    chosen = parser.parse_args()
    prism = make_prism(rotate((0.0, 0.3, 0.2)))
    plain, wide = (build(prism, columns) for columns in ((), ("rest_length", "ground")))
    size = np.concatenate([wide.nominal("rest_length"), wide.nominal("ground")])
    exact = find_columns(wide, 1e-12) * size
    runs: dict[str, Callable[[], FloatArray]] = {}
    for rtol in TOLERANCES:
        runs[f"columns, rk853 at {rtol:.0e}"] = lambda r=rtol: find_columns(wide, r) * size  # type: ignore[misc]
    back = build(prism, (), backwards=True)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], NUMBERS)
    along = {"direction": (size * signs)[:, None]}
    for rtol in TOLERANCES:
        runs[f"backwards, rk853 at {rtol:.0e}"] = lambda r=rtol: (  # type: ignore[misc]
            go_back(back, r, T_END, ("rest_length", "ground"), 15, along) * size
        )
    for step in STEPS:
        name = f"central differences, step {step:.0e}, rk853 at 1e-08"
        runs[name] = lambda h=step: find_differences(plain, h, 1e-8)  # type: ignore[misc]
    notes = dict.fromkeys(runs, "")
    if importlib.util.find_spec("diffrax"):
        for name, (run, compiled) in build_diffrax(prism).items():
            runs[name], notes[name] = run, f"{compiled:.0f}"
    errors = {name: float(np.abs(run() - exact).max() / np.abs(exact).max()) for name, run in runs.items()}
    own = {f"motion at {r:.0e}": lambda r=r: move(plain, r) for r in TOLERANCES}
    times = time_in_turns({**own, **runs}, ROUNDS)
    rows = []
    for name in runs:
        rtol = next((r for r in TOLERANCES if name.endswith(f"at {r:.0e}")), None)
        cost = "" if rtol is None else f"{times[name] / times[f'motion at {rtol:.0e}']:.1f}"
        rows.append((name, f"{errors[name]:.1e}", f"{1e3 * times[name]:.1f}", cost, notes[name]))
    parts = [draw_bars(HEAD[0], HEAD[2]), table_text(HEAD, rows), compare_tower()]
    if importlib.util.find_spec("mujoco.mjx") and not chosen.no_mjx:
        parts.append(compare_mjx(prism))
    publish(PAGE, describe_finding(rows), *parts, find_about(__doc__), write=chosen.write)


def describe_finding(rows: Sequence[Sequence[str]]) -> str:
    """Return the costs and the errors of gradients backwards, and of differences at their best."""
    back = [row for row in rows if row[0].startswith("backwards")]
    best = min((row for row in rows if row[0].startswith("central")), key=lambda row: float(row[1]))
    costs, errors = ([float(row[k]) for row in back] for k in (3, 1))
    return (
        f"A gradient through contacts costs {min(costs):g} to {max(costs):g} motions backwards, with "
        "errors of "
        f"{min(errors):.0e} to {max(errors):.0e}; differences cost {best[3]} and have {best[1]} at best"
    )


def compare_tower() -> str:
    """Return the table of gradients of the tower to 60 numbers."""
    tower, _ = load_scene(EXAMPLES / "tower.toml")
    cables = tuple(np.flatnonzero(tower.tension_only).tolist())
    wanted = ("rest_length", "damping")
    parameters = {"rest_length": cables, "damping": cables[: 60 - len(cables)]}

    def make(**more: Any) -> CompiledModel:
        quantities = (*SIMULATION_QUANTITIES, *(("adjoint_rate",) if more.pop("backwards", False) else ()))
        more["events"] = ("auto",)
        request = ModelRequest(quantities, integrators=("rk853",), parameters=parameters, **more)
        return build_library(tower, request, flags="native").load()

    models = {"motion": make(), "columns": make(columns=wanted), "backwards": make(backwards=True)}
    models["backwards, with a column"] = make(backwards=True, directions=("all",))
    size = np.concatenate([models["motion"].nominal(name) for name in wanted])
    size[size == 0.0] = 1.0
    along = {"direction": np.zeros_like(models["backwards, with a column"].nominal("direction"))}
    along["direction"][: len(size), 0] = size  # inputs stand behind them
    place = len(tower.coordinate_node_axis) - 3
    exact = np.asarray(integrate(models["columns"], 1e-12, TOWER_END).columns[-1][place]) * size
    rows, rtol = [], 1e-7
    runs = {
        "motion": lambda: integrate(models["motion"], rtol, TOWER_END),
        "columns": lambda: integrate(models["columns"], rtol, TOWER_END).columns[-1][place] * size,
        "backwards": lambda: go_back(models["backwards"], rtol, TOWER_END, wanted, place, {}) * size,
        "backwards, with a column": lambda: (
            go_back(models["backwards, with a column"], rtol, TOWER_END, wanted, place, along) * size
        ),
    }
    times = time_in_turns(runs, ROUNDS)
    for name, run in runs.items():
        error = "" if name == "motion" else f"{np.abs(run() - exact).max() / np.abs(exact).max():.1e}"
        rows.append((name, error, f"{1e3 * times[name]:.2f}", f"{times[name] / times['motion']:.1f}"))
    return table_text(("gradient to 60 numbers, rk853 at 1e-07", "error", "CPU [ms]", "in motions"), rows)


def go_back(
    model: CompiledModel,
    rtol: float,
    t_end: float,
    wanted: tuple[str, ...],
    place: int,
    arguments: dict[str, FloatArray],
) -> FloatArray:
    """Return the derivatives of a coordinate at the end to these numbers, backwards."""
    run = TapedRun(make_motion(model, t_end, arguments), RunOptions("rk853", rtol, rtol / 100))
    raw = run.finish()
    weight = np.zeros((len(raw.time), raw.state.shape[1] + len(model.manifest.internal_name)))
    weight[-1, place] = 1.0
    found = run.go_back(weight)
    return np.concatenate([found.number[name].ravel() for name in wanted])


def build(prism: Structure, columns: tuple[str, ...], *, backwards: bool = False) -> CompiledModel:
    """Return the prism's library, whose cables and ground can change."""
    cables = tuple(int(e) for e in np.flatnonzero(prism.tension_only))
    request = ModelRequest(
        (*SIMULATION_QUANTITIES, *(("adjoint_rate",) if backwards else ())),
        directions=("all",) if backwards else (),
        formulation="rigid_bar",
        integrators=("rk853",),
        events=("auto",),
        parameters={"rest_length": cables, "ground": (0, 2)},
        columns=columns,
    )
    return build_library(prism, request, flags="native").load()


def make_motion(model: CompiledModel, t_end: float, arguments: dict[str, FloatArray]) -> Motion:
    """Return a motion with samples at its start and end; without ground the last node begins with a push."""
    state = np.concatenate([model.nominal("coordinate"), model.nominal("velocity")])
    if not model.manifest.contact_name:
        state[-3] += PUSH
    return Motion(model, state, np.array([0.0, t_end]), arguments=arguments)


def integrate(model: CompiledModel, rtol: float, t_end: float = T_END, **arguments: FloatArray) -> Any:
    """Return the samples at the start and the end of a motion."""
    motion = make_motion(model, t_end, arguments)
    return integrate_adaptive(motion, RunOptions("rk853", rtol, rtol / 100))


def move(model: CompiledModel, rtol: float, **arguments: FloatArray) -> float:
    """Return x of the last node at the end."""
    return float(integrate(model, rtol, **arguments).state[-1][15])


def find_columns(model: CompiledModel, rtol: float) -> FloatArray:
    """Return the derivatives of x of the last node at the end, (11,)."""
    return np.asarray(integrate(model, rtol).columns[-1][15])


def find_differences(model: CompiledModel, step: float, rtol: float) -> FloatArray:
    """Return central differences to the logarithms of the numbers."""
    found = []
    for name in ("rest_length", "ground"):
        nominal = model.nominal(name)
        for k in range(nominal.size):
            ends = []
            for sign in (1.0, -1.0):
                changed = nominal.copy()
                changed[k] *= 1.0 + sign * step
                ends.append(move(model, rtol, **{name: changed}))
            found.append((ends[0] - ends[1]) / (2.0 * step))
    return np.array(found)


def compare_mjx(prism: Structure) -> str:
    """Return the table of derivatives by MJX (Euler and RK4, steps of 1 ms) beside its own differences."""
    import jax
    import jax.numpy as jnp
    import mujoco
    from mujoco import mjx

    jax.config.update("jax_enable_x64", True)
    rows = []
    for name in ("Euler", "RK4"):
        element, _ = build_mjcf(prism, 1e-3, name)
        model = mujoco.MjModel.from_xml_string(tostring(element, encoding="unicode"))
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        mujoco.mj_forward(model, data)
        given, start = mjx.put_model(model), mjx.put_data(model, data)
        site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, prism.node_name[-1])
        length = jnp.array(model.tendon_lengthspring)

        def end(
            log: Any, given: Any = given, start: Any = start, length: Any = length, site: int = site
        ) -> Any:
            own = given.replace(tendon_lengthspring=length.at[0].multiply(jnp.exp(log)))

            def step(state: Any, _: Any) -> tuple[Any, None]:
                after = mjx.step(own, state)
                return jax.tree.map(lambda a, b: jnp.asarray(b, jnp.asarray(a).dtype), state, after), None

            last, _ = jax.lax.scan(step, start, None, length=round(T_END / 1e-3))
            return mjx.forward(own, last).site_xpos[site, 0]

        run, slope = jax.jit(end), jax.jit(lambda x, end=end: jax.jvp(end, (x,), (1.0,))[1])
        began = time.perf_counter()
        found = float(slope(0.0))
        compiled = time.perf_counter() - began
        own = (float(run(1e-6)) - float(run(-1e-6))) / 2e-6
        taken = time_in_turns({"mjx": lambda slope=slope: float(slope(0.0))}, 3)["mjx"]  # type: ignore[misc]
        rows.append((name, f"{found:.3f}", f"{own:.3f}", f"{1e3 * taken:.0f}", f"{compiled:.0f}"))
    head = ("MJX", "derivative to one number", "its own differences", "CPU [ms]", "compiled in [s]")
    return table_text(head, rows)


def build_diffrax(prism: Structure) -> dict[str, tuple[Callable[[], FloatArray], float]]:
    """Return gradients by diffrax of the same equations, with contacts by `where`, and seconds to compile."""
    import diffrax
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    ground, ends = prism.ground, jnp.array(prism.connectivity)
    assert ground is not None
    bars, cables = np.flatnonzero(prism.is_rigid), np.flatnonzero(prism.tension_only)
    mass = np.diag(prism.node_mass)
    for e in bars:
        i, j = prism.connectivity[e]
        part = prism.member_mass[e] / 6.0
        mass[[i, j], [i, j]] += 2.0 * part
        mass[[i, j], [j, i]] += part
    masses, weight = (
        jnp.array(np.kron(mass, np.eye(3))),
        jnp.array(mass @ np.tile([0.0, 0.0, -GRAVITY], (6, 1))),
    )
    spring, damping = jnp.array(prism.spring_constant[cables]), jnp.array(prism.damping[cables])
    rest, rigid, soft = jnp.array(prism.rest_length[cables]), jnp.array(bars), jnp.array(cables)

    def rate(time: Any, state: Any, logs: Any) -> Any:
        q, v, s = state[:18].reshape(6, 3), state[18:36].reshape(6, 3), state[36:].reshape(6, 2)
        span, speed = q[ends[:, 1]] - q[ends[:, 0]], v[ends[:, 1]] - v[ends[:, 0]]
        length = jnp.linalg.norm(span, axis=1)
        stretch = length[soft] - rest * jnp.exp(logs[:9])
        pull = spring * stretch + damping * (span * speed).sum(axis=1)[soft] / length[soft]
        tension = jnp.where((stretch > 0.0) & (pull > 0.0), pull, 0.0)
        force = weight
        along = tension[:, None] * span[soft] / length[soft][:, None]
        force = force.at[ends[soft, 0]].add(along).at[ends[soft, 1]].add(-along)
        depth = -q[:, 2]
        press = jnp.where(depth > 0.0, ground.stiffness * jnp.exp(logs[9]) * depth, 0.0)
        press = press * jnp.maximum(0.0, 1.0 - ground.dissipation * v[:, 2])
        trial = ground.stick_stiffness * s + ground.stick_damping * v[:, :2]
        size = jnp.sqrt((trial**2).sum(axis=1) + 1e-300)
        limit = ground.friction * jnp.exp(logs[10]) * press
        friction = trial * jnp.minimum(1.0, limit / size)[:, None]
        force = force.at[:, 2].add(press).at[:, :2].add(-friction)
        rows = jnp.zeros((3, 6, 3)).at[jnp.arange(3), ends[rigid, 0]].add(-span[rigid])
        rows = rows.at[jnp.arange(3), ends[rigid, 1]].add(span[rigid]).reshape(3, 18)
        matrix = jnp.block([[masses, rows.T], [rows, jnp.zeros((3, 3))]])
        right = jnp.concatenate([force.reshape(-1), -(speed[rigid] ** 2).sum(axis=1)])
        fall = jnp.linalg.solve(matrix, right)[:18]
        slide = (friction - ground.stick_stiffness * s) / ground.stick_damping
        return jnp.concatenate([v.reshape(-1), fall, slide.reshape(-1)])

    start = jnp.concatenate([jnp.array(prism.node_position).reshape(-1), jnp.zeros(30)])

    def end(logs: Any, adjoint: Any) -> Any:
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(rate),
            diffrax.Dopri8(),
            0.0,
            T_END,
            1e-3,
            start,
            logs,
            stepsize_controller=diffrax.PIDController(rtol=1e-8, atol=1e-10, dtmax=0.01),
            max_steps=100_000,
            adjoint=adjoint,
            saveat=diffrax.SaveAt(t1=True),
        )
        return found.ys[-1][15]

    at, found = jnp.zeros(NUMBERS), {}
    kinds = {
        "diffrax, Dopri8 at 1e-08, forward": jax.jacfwd(lambda p: end(p, diffrax.ForwardMode())),
        "diffrax, Dopri8 at 1e-08, adjoint": jax.grad(lambda p: end(p, diffrax.RecursiveCheckpointAdjoint())),
    }
    for name, function in kinds.items():
        compiled = jax.jit(function)
        began = time.perf_counter()
        compiled(at).block_until_ready()
        seconds = time.perf_counter() - began
        found[name] = (lambda f=compiled: np.asarray(f(at).block_until_ready()), seconds)  # type: ignore[misc]
    return found


if __name__ == "__main__":
    main()
