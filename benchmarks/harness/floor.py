"""The floor of this core: what the arithmetic of a member takes at least, from small C programs."""

import subprocess
from dataclasses import dataclass
from pathlib import Path

from harness.compiled import CompileFailed
from harness.tools import Tools

# Doubles in a register; a core that lacks a width fails to compile or run it.
WIDTHS = (1, 4, 8)
FLAGS = ("-std=gnu11", "-O2", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-fPIC")

ARITHMETIC = 14  # subtractions, products and sums of one member's force beside its root
MEMBER, CACHED = "member_", "cached_"


@dataclass(frozen=True)
class Floor:
    """operation -> ns a lane, for each width that this core has."""

    lanes: dict[int, dict[str, float]]

    @property
    def member(self) -> dict[str, float]:
        """Way to the root ("sqrt_div", "rsqrt") -> least ns of a member's force, all in registers."""
        return self._least(MEMBER)

    @property
    def cached(self) -> dict[str, float]:
        """The same with node positions and forces in the level 1 cache."""
        return self._least(CACHED)

    def _least(self, prefix: str) -> dict[str, float]:
        found: dict[str, float] = {}
        for row in self.lanes.values():
            for name, ns in row.items():
                if name.startswith(prefix):
                    way = name.removeprefix(prefix)
                    found[way] = min(ns, found.get(way, ns))
        return found


def measure_floor(tools: Tools) -> Floor:
    """Return the floor measured now, by the first compiler; widths that the core lacks are left out."""
    source = Path(__file__).with_name("floor.c").read_text(encoding="utf-8")
    compiler, lanes = tools.compilers[0], {}
    for width in WIDTHS:
        command = (*compiler.command, *FLAGS, f"-DWIDTH={width}", "floor.c")
        try:
            built = tools.compilation.build({"floor.c": source}, command, version=compiler.version)
            answer = subprocess.run([built.path], capture_output=True, text=True, check=True).stdout
        except (CompileFailed, subprocess.CalledProcessError, OSError):
            continue
        rows = (line.split() for line in answer.splitlines())
        lanes[width] = {name: float(value) for name, value in rows}
    return Floor(lanes)


def from_throughput(row: dict[str, float]) -> dict[str, float]:
    """Return way -> ns a member from throughputs: arithmetic and divider overlap, Newton steps do not."""
    arithmetic = ARITHMETIC * row["fma"]
    floors = {"sqrt_div": max(arithmetic, row["sqrt"] + row["div"])}
    if "rsqrt_newton" in row:
        floors["rsqrt"] = arithmetic + row["rsqrt_newton"]
    return floors
