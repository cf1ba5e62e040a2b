"""Live pages in a browser: size of the file, time of our scripts a frame, frames a second.

python benchmarks/live_pages.py [--ntrt 3Prism.yaml SuperBall.yaml TetrahedralSpine.yaml] [--seconds 8]
                                [--only net] [--width 1400] [--out output/live_pages] [--write]

Simulates each scene with the command line, writes its page with `show`, plays it in chromium while the
camera turns, and prints a table. Structures of the NASA Tensegrity Robotics Toolkit are
imported from the files that --ntrt names; without them two shipped scenes take their place.

- Page's thread: processor time of the page's own thread a frame, scripts, layout, all.
- Update: of it the new state (positions, tensions, colours) by the clock, median and 99 %.
- Frames a second are shown while the motion plays and the camera turns; frame is the time between them.
- Drawing: processor time of the browser's graphics process a frame. Without a graphics card it rasterises the
  picture and puts the page together by software.
- Pixels of the moving picture, a pixel of the page; 1 is all, slow pictures have fewer.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from harness.turns import EXAMPLES, ROOT, draw_bars, find_about, publish, table_text

from tests.report.driver import Tab, running_browser

SIDE = 70  # nodes of a side of the net
TOWER = """\
name = "tower"
gravity = [0, 0, -9.81]
[classes.bar]
kind = "bar"
spring_constant = 2e4
[classes.cable]
kind = "cable"
spring_constant = 500
prestress = 10
damping = 2
[shape]
kind = "tower"
stages = 100
radius = 0.2
height = 0.5
node_mass = 0.05
anchor_bottom = true
"""
NET = """\
name = "net"
gravity = [0, 0, -9.81]
[classes.rope]
kind = "cable"
spring_constant = 400
rest_length = 0.98
damping = 0.5
[nodes]
{nodes}
[members]
{members}
"""
MOTIONS = {"tower": ("0.5", "100"), "net": ("0.5", "100")}  # t_end [s], samples
USUAL = ("2", "200")
HEADS = (
    *("page", "members", "samples", "file [MB]", "page's thread [ms]", "update [ms]", "update 99 % [ms]"),
    *("frames a second", "frame [ms]", "frame 99 % [ms]", "drawing [ms]", "pixels"),
)


def main() -> None:
    """Write the pages and measure them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--ntrt", type=Path, nargs="*", default=[], help="structure files to import")
    parser.add_argument("--out", type=Path, default=ROOT / "output" / "live_pages")
    parser.add_argument("--seconds", type=float, default=8.0, help="seconds that each page plays")
    parser.add_argument("--width", type=int, default=1400, help="width of the window [px]")
    parser.add_argument("--only", nargs="*", help="names of scenes; all if not given")
    parser.add_argument("--write", action="store_true", help="write into docs/answers_measured.md")
    words = parser.parse_args()
    words.out.mkdir(parents=True, exist_ok=True)
    scenes = {
        name: path for name, path in write_scenes(words).items() if not words.only or name in words.only
    }
    rows = []
    for name, scene in scenes.items():
        page = write_page(name, scene, words.out)
        with running_browser() as browser:
            tab = Tab(browser, words.width, 860, "light")
            rows.append({"scene": name, "bytes": page.stat().st_size} | measure(tab, page, words.seconds))
        print(json.dumps(rows[-1]), flush=True)
    cells = [list_cells(row) for row in rows]
    worst = min(cells, key=lambda row: float(row[7]))
    finding = (
        f"Pages play at {worst[7]} to {max(float(row[7]) for row in cells):g} frames a second without a "
        "graphics "
        f"card (least: {worst[0]}, {worst[1]} members)"
    )
    bars = draw_bars(HEADS[0], HEADS[7])
    publish(
        "answers_measured.md", finding, bars, table_text(HEADS, cells), find_about(__doc__), write=words.write
    )


def write_scenes(words: argparse.Namespace) -> dict[str, Path]:
    """Return scene files by name."""
    scenes: dict[str, Path] = {}
    for file in words.ntrt:
        scenes[file.stem] = words.out / f"{file.stem}.toml"
        run("import", file, "--out", scenes[file.stem], "--overwrite")
    if not scenes:
        scenes = {name: EXAMPLES / f"{name}.toml" for name in ("prism", "icosahedron")}
    for name, text in (("tower", TOWER), ("net", write_net())):
        scenes[name] = words.out / f"{name}.toml"
        scenes[name].write_text(text, encoding="utf-8")
    return scenes


def write_net(side: int = SIDE) -> str:
    """Return the scene of a net that hangs at its edge; cables between anchored nodes are left out.

    side: nodes of a side; the net has 2 (side - 1) (side - 2) cables.
    """
    last = side - 1
    nodes = []
    for k in range(side * side):
        x, y = divmod(k, side)
        if x in (0, last) and y in (0, last):
            continue  # no cable joins a corner
        rest = ", anchored = true" if {x, y} & {0, last} else ", mass = 0.05"
        nodes.append(f"n{k} = {{ position = [{x}, {y}, 0]{rest} }}")
    pairs = [(k, k + 1) for k in range(side * side) if (k + 1) % side and 0 < k // side < last]
    pairs += [(k, k + side) for k in range(side * last) if 0 < k % side < last]
    members = [f'c{e} = {{ class = "rope", nodes = ["n{i}", "n{j}"] }}' for e, (i, j) in enumerate(pairs)]
    return NET.format(nodes="\n".join(nodes), members="\n".join(members))


def write_page(name: str, scene: Path, folder: Path) -> Path:
    """Simulate a scene and write its live page; what was written before is kept."""
    motion, page = folder / f"{name}.npz", folder / f"{name}.html"
    t_end, samples = MOTIONS.get(name, USUAL)
    if not motion.exists():
        run("simulate", scene, "--t-end", t_end, "--samples", samples, "--out", motion)
    run("show", scene, "--trajectory", motion, "--out", page, "--modes", "0", "--overwrite")
    return page


def run(*words: object) -> None:
    """Run a verb of the command line; a failure ends the program."""
    command = [sys.executable, "-m", "tensegrity_codegen", *map(str, words)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(done.stderr)


def measure(tab: Tab, page: Path, seconds: float) -> dict[str, Any]:
    """Return what one page took."""
    tab.open(page)
    tab.ask("tensegrity.measure(3)")  # shaders are compiled, pages of memory touched
    graphics = find_graphics(tab.browser.process.pid)
    tab.send("Performance.enable", timeDomain="threadTicks")
    tab.ask("tensegrity.play()")
    step = "{ tensegrity.orbit(0.01, 0, 1); requestAnimationFrame(turn); }"
    tab.ask(f"(() => {{ const turn = () => {step}; turn(); }})()")
    pause = "new Promise(done => setTimeout(done, {}))"
    tab.ask(pause.format(3000))  # shapes and pixels suit the machine by then
    tab.ask("tensegrity.forgetTimes()")
    before, drawn_before = read_metrics(tab), read_processor_time(graphics)
    tab.ask(pause.format(round(1000 * seconds)))
    after, drawn_after, timing = (
        read_metrics(tab),
        read_processor_time(graphics),
        tab.ask("tensegrity.timing"),
    )
    count = len(timing["frames"])
    busy = 1000 * (after["TaskDuration"] - before["TaskDuration"])
    return {
        "members": tab.ask("tensegrity.names.members.length"),
        "frames": tab.ask("tensegrity.frames"),
        "script": busy / max(count, 1),
        "update": np.percentile(timing["update"], [50, 99]).tolist(),
        "frame": np.percentile(timing["frames"], [50, 99]).tolist(),
        "rate": 1000 * count / sum(timing["frames"]),
        "draw": 1000 * (drawn_after - drawn_before) / max(count, 1),
        "ratio": timing["ratio"],
    }


def find_graphics(browser: int) -> psutil.Process:
    """Return the graphics process of a browser."""
    for process in psutil.Process(browser).children(recursive=True):
        if "--type=gpu-process" in process.cmdline():
            return process
    raise SystemExit("the browser has no graphics process")


def read_processor_time(process: psutil.Process) -> float:
    """Return the processor time of a process [s]."""
    times = process.cpu_times()
    return times.user + times.system


def read_metrics(tab: Tab) -> dict[str, float]:
    """Return durations of the page's thread [s of processor time]."""
    return {item["name"]: item["value"] for item in tab.send("Performance.getMetrics")["metrics"]}


def list_cells(row: dict[str, Any]) -> tuple[str, ...]:
    """Return the cells of a page in the table of the documentation."""
    (update, slow_update), (frame, slow_frame) = row["update"], row["frame"]
    return (
        *(row["scene"], f"{row['members']:,}", str(row["frames"]), f"{row['bytes'] / 1e6:.2f}"),
        *(f"{row['script']:.1f}", f"{update:.1f}", f"{slow_update:.1f}", f"{row['rate']:.0f}"),
        *(f"{frame:.0f}", f"{slow_frame:.0f}", f"{row['draw']:.0f}", f"{row['ratio']:.2g}"),
    )


if __name__ == "__main__":
    main()
