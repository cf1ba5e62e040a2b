"""Hold the pinned prism at 1 kHz from Python, in real time, and print how late each turn began.

    python examples/real_time.py [--seconds 5]

Each turn takes the state of the plant, which a stepper advances by 1 ms, computes the commands of a regulator
within range and rate of the actuators, and sends them. A push of 2 N for 50 ms comes after a second.
"""

import argparse
import time
from pathlib import Path

import numpy as np

import tensegrity_codegen
from tensegrity_codegen import compile_scene, design_lqr, find_equilibrium

SCENE = Path(tensegrity_codegen.__file__).parent / "scene" / "examples" / "pinned_prism.toml"
SAMPLE = 0.001  # s
RATE = 0.1  # of the actuators, as in the scene [m/s]


def main() -> None:
    """Run the loop, then print its times and how far the prism moved."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=5.0)
    turns = round(parser.parse_args().seconds / SAMPLE)
    model = compile_scene(SCENE, for_=("equilibrium", "control", "step"))
    rest = find_equilibrium(model)
    n, inputs = len(rest.coordinate), len(model.manifest.input_name)
    gains = design_lqr(model, rest, [100.0] * n + [1.0] * n, [10.0] * inputs, sample=SAMPLE)
    gain = np.asarray(gains.K).reshape(-1, inputs, 2 * n)[0]
    stepper = model.stepper(sample=SAMPLE)
    stepper.reset(coordinate=rest.coordinate, velocity=np.zeros(n))
    goal, command = stepper.state[0].copy(), np.zeros(inputs)
    load = stepper.arguments["node_load"][0]
    late, busy, away = np.zeros(turns), np.zeros(turns), np.zeros(turns)
    begin = time.perf_counter() + SAMPLE
    for k in range(turns):
        due = begin + k * SAMPLE
        time.sleep(max(0.0, due - time.perf_counter() - 2e-4))
        while time.perf_counter() < due:  # the last 0.2 ms: sleeping wakes up too late
            pass
        started = time.perf_counter()
        load[-1] = [2.0, 0.0, 0.0] if 1.0 <= k * SAMPLE < 1.05 else 0.0
        wanted = -gain @ (stepper.state[0] - goal)
        command = np.clip(wanted, command - RATE * SAMPLE, command + RATE * SAMPLE)
        stepper.step(command)
        late[k], busy[k] = started - due, time.perf_counter() - started
        away[k] = np.abs(stepper.coordinate[0] - rest.coordinate).max()
    if stepper.status[0]:
        raise SystemExit(stepper.status_text(0))
    for name, seconds in (("turns began late by", late), ("a turn took", busy)):
        middle, high = np.quantile(seconds, [0.5, 0.99]) * 1e6
        print(f"{name}: median {middle:.0f}, 99 % {high:.0f}, most {seconds.max() * 1e6:.0f} microseconds")
    print(f"late by more than a turn: {np.count_nonzero(late > SAMPLE)} of {turns}")
    print(f"away from rest: {away.max():.2e} rad at most, {away[-1]:.2e} rad at the end")


if __name__ == "__main__":
    main()
