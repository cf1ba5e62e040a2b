"""Whether two states of the code compute the same numbers, bit by bit, with the reference flags.

python benchmarks/same_bits.py BEFORE AFTER [--random 200] [--first 0]

BEFORE and AFTER are two checkouts. Each one computes, in a process of its own, the quantities of the shipped
and of random scenes at their start and at a random state, motions by every method, equilibria and linear
models. The random scenes are written as TOML by this script, the same for both. Prints what differs, and by
how much; exit code 1 if anything does.
"""

import argparse
import contextlib
import io
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from harness.turns import EXAMPLES

SHIPPED = ("icosahedron", "lin_prism", "planar", "prism", "prism12", "svd_tower", "tower", "two_nodes")
SHAPES = ("elastic", "rigid", "distances", "planar")
EMITTERS = ("unrolled", "table")
METHODS = ("rk853", "rk54", "radau", "rk4", "auto")
QUANTITIES = ("member_length", "member_tension", "total_energy", "acceleration")
STATIC = ("node_residual", "tangent_stiffness", "potential_energy")


def write_random_scene(folder: Path, number: int) -> Path:
    """Write the random scene of a number: nodes on a sphere, bars across, cables between neighbours."""
    rng = np.random.default_rng([7, number])
    shape = SHAPES[number % len(SHAPES)]
    axes = "xz" if shape == "planar" else "xyz"
    count = int(rng.integers(4, 10))
    direction = rng.standard_normal((count, len(axes)))
    position = np.round(direction / np.linalg.norm(direction, axis=1)[:, None], 6)
    pairs = [(i, j) for i in range(count) for j in range(i) if np.ptp(position[[i, j]], axis=0).max() > 0.05]
    rng.shuffle(pairs)
    bars = _choose_bars(pairs, rigid=shape == "rigid", most=count // 2)
    cables = [pair for pair in pairs if tuple(pair) not in {tuple(bar) for bar in bars}][: 3 * count]
    formulation = {"rigid": "rigid_bar", "distances": "node_distance"}.get(shape, "node_position")
    static = shape != "distances"
    emitter = EMITTERS[number // 4 % len(EMITTERS)]
    lines = [
        f'name = "random_{number}"',
        f'axes = "{axes}"',
        f"gravity = {[0] * (len(axes) - 1) + [-9.81 * int(rng.integers(2))]}",
        "[model]",
        f'formulation = "{formulation}"',
        f"quantities = {json.dumps([*QUANTITIES, *(STATIC if static else ())])}",
        'integrators = ["rk4", "rk54", "rk853"]',
        *([f'emitter = "{emitter}"'] if formulation == "node_position" else []),
        "[classes.strut]",
        'kind = "bar"',
        *(["radius = 0.01", "density = 2700"] if shape != "distances" else []),
        *([] if shape == "rigid" else [f"spring_constant = {float(10 ** rng.uniform(3, 6)):.6g}"]),
        "[classes.rope]",
        'kind = "cable"',
        f"spring_constant = {float(rng.uniform(50, 500)):.6g}",
        f"damping = {float(rng.uniform(0, 2)) * int(rng.integers(2)):.6g}",
        "[nodes]",
        *(
            _node(rng, index, place, anchored=index < 2 and shape != "rigid")
            for index, place in enumerate(position)
        ),
        "[members]",
        *(f'bar{k} = {{ class = "strut", nodes = ["n{i}", "n{j}"] }}' for k, (i, j) in enumerate(bars)),
        *(_cable(rng, k, position[[i, j]], i, j) for k, (i, j) in enumerate(cables)),
    ]
    path = folder / f"random_{number}.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _choose_bars(pairs: list[Any], *, rigid: bool, most: int) -> list[Any]:
    """Return the pairs of nodes that get a bar; rigid bars share no node."""
    chosen: list[Any] = []
    used: set[int] = set()
    for i, j in pairs:
        if len(chosen) < most and not (rigid and used & {int(i), int(j)}):
            chosen.append((i, j))
            used |= {int(i), int(j)}
    return chosen


def _node(rng: np.random.Generator, index: int, place: Any, *, anchored: bool) -> str:
    if anchored:
        return f"n{index} = {{ position = {place.tolist()}, anchored = true }}"
    mass = round(float(rng.uniform(0.1, 2.0)), 6)
    return f"n{index} = {{ position = {place.tolist()}, mass = {mass} }}"


def _cable(rng: np.random.Generator, index: int, ends: Any, i: int, j: int) -> str:
    """Return one cable; one in five starts slack."""
    length = float(np.linalg.norm(ends[0] - ends[1]))
    rest = round(length * float(rng.uniform(0.8, 1.05)), 6)
    return f'cable{index} = {{ class = "rope", nodes = ["n{i}", "n{j}"], rest_length = {rest} }}'


def compute_scene(path: Path, number: int, folder: Path) -> dict[str, Any]:
    """Return all numbers of a scene by name; a text in place of what ended in an error."""
    from tensegrity_codegen import compile_scene

    found: dict[str, Any] = {}
    try:
        model = compile_scene(path)
    except Exception as error:
        return {"compile": type(error).__name__}
    rng = np.random.default_rng([8, number])
    coordinate = model.nominal("coordinate")
    moved = coordinate + 0.01 * rng.standard_normal(coordinate.shape)
    for name in model.quantities:
        for state, changed in (("start", {}), ("moved", {"coordinate": moved})):
            try:
                value = model.compute(name, **changed)
            except Exception as error:
                found[f"{name} {state}"] = type(error).__name__
                continue
            found[f"{name} {state}"] = value.toarray() if hasattr(value, "toarray") else np.asarray(value)
    method = METHODS[number % len(METHODS)]
    step = ["--step", "0.001"] if method == "rk4" else []
    motion = ["simulate", path, "--t-end", "0.05", "--samples", "6", "--method", method, *step]
    for verb in (motion, ["equilibrium", path], ["linearize", path]):
        found |= run_verb(verb, folder)
    return found


def run_verb(verb: list[Any], folder: Path) -> dict[str, Any]:
    """Return the exit code and the arrays or the text that a verb of the command line writes."""
    from tensegrity_codegen.cli.app import main

    name = str(verb[0])
    out = folder / f"{name}.{'toml' if name == 'equilibrium' else 'npz'}"
    out.unlink(missing_ok=True)
    sys.argv = ["tensegrity-codegen", *map(str, verb), "--json", "--out", str(out)]
    code: Any = 0
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        try:
            main()
        except SystemExit as error:
            code = error.code or 0
    found: dict[str, Any] = {f"{name} exit code": str(code)}
    if out.exists() and out.suffix == ".npz":
        with np.load(out, allow_pickle=False) as file:
            found |= {f"{name} {key}": file[key] for key in file.files if file[key].dtype.kind in "fiub"}
    elif out.exists():
        found[name] = out.read_text(encoding="utf-8")
    return found


def write_results(out: Path, count: int, first: int) -> None:
    """Compute everything with the checkout that Python finds first, and write it to a file."""
    results: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scenes = [EXAMPLES / f"{name}.toml" for name in SHIPPED]
        scenes += [write_random_scene(folder, number) for number in range(first, first + count)]
        for number, scene in enumerate(scenes):
            found = compute_scene(scene, number, folder)
            results |= {f"{scene.stem}: {key}": value for key, value in found.items()}
            print(f"{number + 1} of {len(scenes)}: {scene.stem}", file=sys.stderr, flush=True)
    np.savez(out, **{key: np.asarray(value) for key, value in results.items()})


def compare_results(before: Path, after: Path) -> int:
    """Print what differs between two files; return how many arrays and texts do."""
    with np.load(before) as old, np.load(after) as new:
        names = sorted(set(old.files) | set(new.files))
        differ = 0
        for name in names:
            if name not in old.files or name not in new.files:
                print(f"{name}: only {'before' if name in old.files else 'after'}")
                differ += 1
                continue
            a, b = old[name], new[name]
            if a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes():
                continue
            differ += 1
            comparable = a.shape == b.shape and a.dtype.kind == b.dtype.kind == "f" and a.size
            print(f"{name}: {f'by {np.abs(a - b).max():.3g}' if comparable else f'{a!s:.60} | {b!s:.60}'}")
        errors = sum(old[name].dtype.kind == "U" and "exit code" not in name for name in old.files)
    print(f"{len(names)} arrays and texts, {errors} of them texts; {differ} differ")
    return differ


def main() -> None:
    """Compute with both checkouts and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--random", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="number of the first random scene")
    parser.add_argument("--write", action="store_true", help=argparse.SUPPRESS)
    words = parser.parse_args()
    if words.write:
        write_results(words.after, words.random, words.first)
        return
    with tempfile.TemporaryDirectory() as name:
        files = []
        for label, tree in (("before", words.before), ("after", words.after)):
            files.append(Path(name) / f"{label}.npz")
            command = [sys.executable, __file__, "--write", tree, files[-1]]
            command += ["--random", words.random, "--first", words.first]
            more = {"PYTHONPATH": str(tree.resolve()), "XDG_CACHE_HOME": str(Path(name) / f"cache-{label}")}
            subprocess.run([str(word) for word in command], check=True, env=os.environ | more)
        sys.exit(1 if compare_results(*files) else 0)


if __name__ == "__main__":
    main()
