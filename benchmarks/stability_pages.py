"""Run `stability` for the example scenes and write the figures of docs/stability.md.

python benchmarks/stability_pages.py [--ntrt 3Prism.yaml] [--out output/stability] [--t-end 0.1] [--limit 2]
                                     [--budget 540] [--only prism planar] [--write]

Each scene has a page of its own in a folder of its own, and --budget seconds by the clock. A second run
resumes: it keeps finished cases and runs the others. The common prism is imported from tables that this
script writes, and structures of the NASA Tensegrity Robotics Toolkit from the files that --ntrt names.
"""

import argparse
import csv
import json
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from harness.turns import EXAMPLES, ROOT, find_about, markdown_head, markdown_row, publish

from tensegrity_codegen.studies.stability.judge import VERDICTS
from tensegrity_codegen.studies.stability.page import WORDS
from tests.common_prism import BARS, PLACES, STRINGS, span

PAGE = "stability.md"
SCENES = ("prism", "planar", "icosahedron", "tower")
# The example prism: file -> what stands behind the kind of its cables, and at its end.
VARIANTS = {
    "standing": (
        "damping = 2",
        "[ground]\nstiffness = 2e4\nrestitution = { value = 0.5, speed = 1 }\nfriction = 0.5",
    ),
    "yielding": ("yield_force = 12\nhardening = 0.1", ""),
    "viscous": ("relaxation_time = 0.02\nrelaxed_fraction = 0.5", ""),
}
MOST_WRONG = 40  # listed one by one


def main() -> None:
    """Run the scenes and write the document."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--ntrt", type=Path, nargs="*", default=[], help="structure files to import")
    parser.add_argument("--out", type=Path, default=ROOT / "output" / "stability")
    parser.add_argument("--t-end", type=float, default=0.1, help="end of each motion [s]")
    parser.add_argument("--limit", type=float, default=2.0, help="CPU time a run [s]")
    parser.add_argument("--budget", type=float, default=540.0, help="time by the clock a scene [s]")
    parser.add_argument("--only", nargs="*", help="names of scenes; all if not given")
    parser.add_argument("--write", action="store_true", help=f"write docs/{PAGE}")
    words = parser.parse_args()
    words.out.mkdir(parents=True, exist_ok=True)
    scenes = {name: EXAMPLES / f"{name}.toml" for name in SCENES}
    scenes |= {name: write_variant(words.out, name) for name in VARIANTS}
    scenes |= {"common_prism": import_common_prism(words.out)}
    scenes |= {file.stem: import_file(words.out, file.stem, file) for file in words.ntrt}
    chosen = {name: scene for name, scene in scenes.items() if not words.only or name in words.only}
    found = {name: run_scene(scene, words) for name, scene in chosen.items()}
    own = [row for data in found.values() for row in data["rows"] if row["is_own"]]
    publish(PAGE, describe_own(own), write_figures(found), find_about(__doc__), write=words.write)


def write_variant(folder: Path, name: str) -> Path:
    """Return a scene of VARIANTS; on the ground its nodes are free."""
    cable, end = VARIANTS[name]
    text = (EXAMPLES / "prism.toml").read_text(encoding="utf-8")
    text = text.replace('name = "prism"', f'name = "{name}"').replace(
        'kind = "cable"', f'kind = "cable"\n{cable}'
    )
    if end:
        text = text.replace('anchor_bottom = "z"', "")
    path = folder / f"{name}.toml"
    path.write_text(f"{text}\n{end}\n", encoding="utf-8")
    return path


def import_common_prism(folder: Path) -> Path:
    """Return the scene of the common prism: rigid bars, imported from tables."""
    nodes, members = folder / "common_prism_nodes.csv", folder / "common_prism_members.csv"
    rows = [[f"n{k}", *map(repr, map(float, place))] for k, place in enumerate(PLACES)]
    write_table(nodes, ("node", "x", "y", "z"), rows)
    bars = [["bar", f"n{i}", f"n{j}", "", "", "1.0"] for i, j in BARS]
    cables = [["cable", f"n{i}", f"n{j}", repr(0.95 * float(span(i, j))), "100.0", ""] for i, j in STRINGS]
    heads = ("kind", "node_i", "node_j", "rest_length", "spring_constant", "mass")
    write_table(members, heads, [*bars, *cables])
    return import_file(folder, "common_prism", nodes, members)


def write_table(path: Path, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Write a table."""
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([heads, *rows])


def import_file(folder: Path, name: str, *sources: Path) -> Path:
    """Return the scene that the verb import makes of some files."""
    scene = folder / f"{name}.toml"
    run("import", *map(str, sources), "--out", str(scene), "--overwrite", "--json")
    return scene


def run_scene(scene: Path, words: argparse.Namespace) -> dict[str, Any]:
    """Return what the verb stability says about a scene, with its own name first."""
    options = ("--t-end", str(words.t_end), "--limit", str(words.limit), "--budget", str(words.budget))
    data = run(
        "stability", str(scene), *options, "--out", str(words.out / scene.stem), "--overwrite", "--json"
    )
    (rows,) = data["scenes"].values()
    result: dict[str, Any] = {**data, "rows": rows}
    return result


def run(*words: str) -> dict[str, Any]:
    """Return the JSON of a verb; its progress goes to stderr. Exit code 3 tells of a wrong result."""
    command = [sys.executable, "-m", "tensegrity_codegen", *words]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode not in (0, 3):
        raise SystemExit(f"{' '.join(words)} ended with code {done.returncode}: {done.stdout}")
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def write_figures(found: dict[str, dict[str, Any]]) -> str:
    """Return the figures in Markdown."""
    first = next(iter(found.values()))
    limits = first["limits"]
    own = {name: [row for row in data["rows"] if row["is_own"]] for name, data in found.items()}
    given = {row["verdict"] for rows in own.values() for row in rows}
    used = [verdict for verdict in VERDICTS if verdict in given or verdict in ("survived", "wrong")]
    shown = ", ".join(WORDS[verdict] for verdict in used)
    lines = [
        f"<!-- site: bars scene: {shown} -->",
        "",
        f"Each motion lasts {first['t_end']:g} s. A run may take {limits['run']:g} s of CPU time, one for a "
        f"reference {limits['reference']:g} s, a scene {limits['total']:g} s by the clock.",
        "",
        'Our methods. "Stated bound" and "positions" say of how many right results velocities are judged '
        "by the bound that the run states, or not at all.",
        "",
    ]
    lines.append(markdown_head("scene", *(WORDS[verdict] for verdict in used), "stated bound", "positions"))
    for name, rows in own.items():
        counts, rules = Counter(r["verdict"] for r in rows), Counter(r["rule"] for r in rows)
        lines.append(markdown_row(name, *(counts[v] for v in used), rules["told"], rules["positions"]))
    lines += ["", "Other programs, all scenes together.", ""]
    lines += peer_lines([row for data in found.values() for row in data["rows"] if not row["is_own"]])
    lines += ["", *wrong_lines(found)]
    return "\n".join(lines).rstrip() + "\n"


def describe_own(rows: Sequence[dict[str, Any]]) -> str:
    """Return how many results of our methods are wrong, and what became of their other runs."""
    counts = Counter(row["verdict"] for row in rows)
    checked = counts["survived"] + counts["wrong"]
    others = [
        f"{WORDS[verdict]} {counts[verdict]:,}"
        for verdict in VERDICTS
        if counts[verdict] and verdict not in ("survived", "wrong")
    ]
    rest = f"; of {len(rows):,} runs the others are: {', '.join(others)}" if others else ""
    return f"{counts['wrong']:,} of {checked:,} checked results of our methods are wrong{rest}"


def peer_lines(rows: list[dict[str, Any]]) -> list[str]:
    """Return the table of verdicts by peer."""
    used = [verdict for verdict in VERDICTS if any(row["verdict"] == verdict for row in rows)]
    lines = [markdown_head("program", *(WORDS[verdict] for verdict in used))]
    for name in dict.fromkeys(row["contender"] for row in rows):
        counts = Counter(row["verdict"] for row in rows if row["contender"] == name)
        lines.append(markdown_row(name, *(counts[verdict] for verdict in used)))
    return lines


def wrong_lines(found: dict[str, dict[str, Any]]) -> list[str]:
    """Return the wrong results of our methods one by one."""
    wrong = [
        (name, row)
        for name, data in found.items()
        for row in data["rows"]
        if row["is_own"] and row["verdict"] == "wrong"
    ]
    if not wrong:
        return []
    lines = ["Results that our methods call good and that are wrong (error over tolerance, ten allowed):", ""]
    lines.append(markdown_head("scene", "case", "method", "error"))
    for name, row in wrong[:MOST_WRONG]:
        error = "" if row["error"] is None else f"{row['error']:.2g}"
        lines.append(markdown_row(name, f"{row['group']}: {row['case']}", row["contender"], error))
    return lines


if __name__ == "__main__":
    main()
