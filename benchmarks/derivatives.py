"""Functions of JAX beside calls of NumPy: 256 states or motions by vmap, with gradients, and steps in a loop.

python benchmarks/derivatives.py [--rounds 15] [--write]   needs jax

Times are medians of processor time over rounds that take turns, on one thread. Motions last 0.1 s at a
relative tolerance of 1e-6: by vmap each ends its steps at events, so that its result has a derivative;
simulate_batch of a library without derivatives integrates them side by side in vector lanes.
"""

import argparse
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import numpy as np
from harness.turns import (
    EXAMPLES,
    draw_bars,
    find_about,
    measure_call,
    publish,
    table_text,
    take_turns,
)

from tensegrity_codegen import Stepping, compile_scene, simulate_batch, to_jax, to_jax_motion
from tests.standing_robot import describe_robot
from tests.symbolic.test_jacobians import TRIANGLE

PAGE = "learning_measured.md"
COUNT, STEPS, T_END, RTOL = 256, 1000, 0.1, 1e-6
HEAD = ("256 at once", "NumPy [us]", "vmap [us]", "vmap over NumPy", "gradients by vmap [us]")


def measure(calls: dict[str, Callable[[], Any]], repeats: int, rounds: int) -> list[float]:
    """Return the median time of each call [s]."""
    for call in calls.values():
        call()
    runs = {name: partial(measure_call, call, repeats) for name, call in calls.items()}
    return [float(np.median(seconds)) for seconds in take_turns(runs, rounds).values()]


def show(name: str, seconds: list[float]) -> tuple[str, ...]:
    """Return a row of the table."""
    times = [f"{float(f'{1e6 * value:.3g}'):,.10g}" for value in seconds]
    return (name, *times[:2], f"{seconds[1] / seconds[0]:.2f}", times[2])


def measure_quantity(title: str, scene: Any, quantity: str, rounds: int) -> tuple[str, ...]:
    """Return the row of a quantity: compute_batch, vmap, gradients of its sum."""
    model = compile_scene(scene, for_="derivatives")
    function, draw = to_jax(model, quantity), np.random.default_rng(0)
    state = [
        nominal + 1e-3 * draw.normal(size=(COUNT, nominal.size))
        for nominal in map(model.nominal, ("coordinate", "velocity"))
    ]
    arrays = [jax.numpy.asarray(array) for array in state]
    values = jax.jit(jax.vmap(function))
    slopes = jax.jit(jax.vmap(jax.grad(lambda q, v: function(q, v).sum(), (0, 1))))
    calls = {
        "NumPy": lambda: model.compute_batch(quantity, coordinate=state[0], velocity=state[1]),
        "vmap": lambda: values(*arrays).block_until_ready(),
        "gradients": lambda: slopes(*arrays)[0].block_until_ready(),
    }
    return show(f"{quantity}, {title}", measure(calls, 20, rounds))


def measure_motion(title: str, scene: Any, rounds: int) -> tuple[str, ...]:
    """Return the row of motions: simulate_batch, vmap, gradients."""
    plain, model = (
        compile_scene(scene, for_="simulate_batch"),
        compile_scene(scene, for_="motion_derivatives"),
    )
    nominal = model.nominal("coordinate")
    starts = nominal + 1e-4 * np.random.default_rng(0).normal(size=(COUNT, nominal.size))
    motion = to_jax_motion(model, T_END, rtol=RTOL)
    values = jax.jit(jax.vmap(lambda q: motion(q)["coordinate"][-1]))
    slopes = jax.jit(jax.vmap(jax.grad(lambda q: motion(q)["coordinate"][-1].sum())))
    options = {"samples": 2, "rtol": RTOL, "stepping": Stepping(control="steps")}
    calls = {
        "NumPy": lambda: simulate_batch(plain, T_END, coordinate=starts, **options),
        "vmap": lambda: values(starts).block_until_ready(),
        "gradients": lambda: slopes(starts).block_until_ready(),
    }
    return show(f"motion of {T_END} s, {title}", measure(calls, 1, max(3, rounds // 5)))


def measure_loop(rounds: int) -> str:
    """Return the times of a loop of JAX over accelerations, and of its gradient."""
    model = compile_scene(EXAMPLES / "prism.toml", for_="derivatives")
    acceleration, start = to_jax(model, "acceleration"), jax.numpy.asarray(model.nominal("coordinate"))

    def advance(state: Any, _: Any) -> Any:
        q, v = state
        v = v + 1e-5 * acceleration(q, v)
        return (q + 1e-5 * v, v), None

    def run(q: Any) -> Any:
        return jax.lax.scan(advance, (q, 0.0 * q), None, length=STEPS)[0][0].sum()

    value, slope = jax.jit(run), jax.jit(jax.grad(run))
    calls = {
        "loop": lambda: value(start).block_until_ready(),
        "back": lambda: slope(start).block_until_ready(),
    }
    seconds = measure(calls, 1, rounds)
    once, back = (1e6 * value / STEPS for value in seconds)
    scan = "A step of the prism in `jax.lax.scan`"
    return f"{scan} takes {once:.1f} us, with the gradient of the loop {back:.1f} us."


def main() -> None:
    """Print the table; write it into the page."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--write", action="store_true")
    chosen = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    prism, robot = EXAMPLES / "prism.toml", describe_robot()
    rows = [
        measure_quantity(title, scene, quantity, chosen.rounds)
        for title, scene in (("prism", prism), ("three-rod robot on the ground", robot))
        for quantity in ("acceleration", "member_tension")
    ]
    rows += [
        measure_motion(title, scene, chosen.rounds)
        for title, scene in (("prism", prism), ("triangle on the ground", TRIANGLE))
    ]
    bars = draw_bars(HEAD[0], HEAD[3])
    parts = (bars, table_text(HEAD, rows), measure_loop(chosen.rounds), find_about(__doc__))
    publish(PAGE, describe_finding(rows), *parts, write=chosen.write)


def describe_finding(rows: Sequence[Sequence[str]]) -> str:
    """Return the least and largest ratio of quantities and of motions."""
    motions, quantities = (
        [float(row[3]) for row in rows if row[0].startswith("motion") == is_motion]
        for is_motion in (True, False)
    )
    return (
        f"By `jax.vmap` quantities take {min(quantities):g} to {max(quantities):g} times the time of NumPy's "
        f"batch, motions {min(motions):g} to {max(motions):g} times"
    )


if __name__ == "__main__":
    main()
