"""Targets of speed and size: what was required, what was measured, and whether the target is met."""

import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from peers import casadi_c, casadi_vm

from harness import ensemble
from harness.ours import BATCH
from harness.session import Row, Session
from harness.sizes import LARGEST
from harness.tools import CompileFailed, Tools

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


FORCE, JACOBIAN = "node_force", "tangent_stiffness"
UNROLLED, MAP = f"{casadi_c.UNROLLED} (gcc)", f"{casadi_c.MAP} (gcc)"


@dataclass(frozen=True)
class Line:
    """The target, what was measured, and whether the target is met (None: not measured, see `measured`)."""

    asked: str
    measured: str
    holds: bool | None


@dataclass(frozen=True)
class Evidence:
    """All that lines are judged by.

    large: stages -> what large_scene.py printed.
    """

    session: Session
    floor: Floor | None
    large: Mapping[int, Mapping[str, Any]]

    def own(self, structure: str, quantity: str, *, batch: bool = False) -> list[Row]:
        """Return our timed rows by native flags: of the emitter that `auto` takes where there is one."""
        rows = [
            row
            for row in self.session.rows
            if (row.structure, row.quantity, row.side) == (structure, quantity, "ours")
            and row.ns is not None
            and "native" in row.name
            and (", batch of" in row.name) == batch
        ]
        emitter = self.session.chosen.get((structure, quantity))
        of_auto = [row for row in rows if row.name.split(" (")[0].split(",")[0] == emitter]
        return rows if batch or not of_auto else of_auto

    def best(self, structure: str, quantity: str, *, batch: bool = False) -> Row | None:
        """Return the fastest of them."""
        rows = self.own(structure, quantity, batch=batch)
        return min(rows, key=lambda row: row.ns or 0.0) if rows else None

    def missing(self, text: str, structure: str) -> Line:
        """Return the line for what none of our emitters did at that structure, if it was measured at all."""
        measured = any(row.structure == structure for row in self.session.rows)
        return Line(text, "no emitter of ours serves it" if measured else "", False if measured else None)

    def times(self, structure: str, quantity: str, name: str, other: str) -> float | None:
        """Return how many times faster `name` is than `other`, median over rounds."""
        timing = self.session.timings.get((structure, quantity), {})
        if name not in timing or other not in timing:
            return None
        return timing[name].times_faster_than(timing[other])


def judge(evidence: Evidence) -> list[Line]:
    """Return all lines, in the order of the page."""
    return [line for part in PARTS for line in part(evidence)]


def _ratios(e: Evidence) -> Iterator[Line]:
    asked = (
        ("prism", FORCE, UNROLLED, 3, False),
        ("icosahedron", FORCE, UNROLLED, 3, False),
        ("tower100", FORCE, UNROLLED, 20, False),
        ("tower1000", FORCE, MAP, 10, False),
        ("prism", FORCE, UNROLLED, 8, True),
        ("prism", JACOBIAN, UNROLLED, 2, False),
        ("tower100", JACOBIAN, casadi_vm.UNROLLED, 40, False),
    )
    for structure, quantity, other, wanted, batch in asked:
        members = next((r.members for r in e.session.rows if r.structure == structure), 0)
        what = f"batch of {BATCH}, a structure" if batch else quantity
        size = f"{members:,} members, " if members else ""
        text = f"{structure.rstrip('0123456789')}, {size}{what}: {wanted} times {other}"
        line = _ratio(e, text, (structure, quantity, other, wanted, batch))
        yield line if members else Line(text, "", None)


def _ratio(e: Evidence, text: str, asked: tuple[str, str, str, float, bool]) -> Line:
    structure, quantity, other, wanted, batch = asked
    own = e.best(structure, quantity, batch=batch)
    if own is None:
        return Line(text, "no emitter of ours serves it", False)
    names = [row.name for row in e.own(structure, quantity, batch=batch)]
    found = {name: e.times(structure, quantity, name, other) for name in names}
    known = {name: times for name, times in found.items() if times is not None}
    if not known:
        return Line(text, f"{other} was not measured", None)
    shown = "; ".join(f"{times:.1f} {name}" for name, times in sorted(known.items(), key=lambda i: -i[1])[:2])
    return Line(text, shown, max(known.values()) >= wanted)


def _floor_share(e: Evidence) -> Iterator[Line]:
    own = e.best("prism", FORCE, batch=True)
    if own is None or own.ns is None or e.floor is None or not e.floor.member:
        text = "prism, batch of 8: at least 60 % of the measured floor"
        yield Line(text, "no batch or no floor measured", None if own else False)
        return
    kinds = (("level 1 cache", e.floor.cached), ("registers alone", e.floor.member))
    for kind, floors in kinds:
        shares = {way: 100 * ns * own.members / own.ns for way, ns in floors.items()}
        text = f"prism, batch of 8: at least 60 % of the floor, {kind}"
        shown = ", ".join(
            f"{shares[way]:.0f} % of {way} ({ns:.2f} ns a member)" for way, ns in floors.items()
        )
        yield Line(text, f"{shown}; {own.ns:.1f} ns by {own.name}", min(shares.values()) >= 60)


def _jacobian_a_member(e: Evidence) -> Iterator[Line]:
    own = e.best("tower100", JACOBIAN)
    text = "tower, 903 members, Jacobian: at most 25 ns a member"
    if own is None or own.ns_member is None:
        yield e.missing(text, "tower100")
    else:
        yield Line(text, f"{own.ns_member:.1f} ns by {own.name}", own.ns_member <= 25)


def _largest(e: Evidence) -> Iterator[Line]:
    sizes = sorted(e.large)
    asked = (
        "scene to loaded library within 15 s",
        "at most 1.5 GB, all processes",
        "code within 10 % of 1,000's",
    )
    if len(sizes) < 2 or any("error" in e.large[k] for k in sizes):
        reason = next((e.large[k]["error"] for k in sizes if "error" in e.large[k]), "not measured")
        yield from (Line(f"100,002 members: {text}", reason, None if not sizes else False) for text in asked)
    else:
        small, large = e.large[sizes[0]], e.large[sizes[-1]]
        wanted = ", ".join(large["quantities"])
        peak = large["peak"]
        code = large["code_bytes"] / small["code_bytes"] - 1
        yield Line(
            f"100,002 members: {asked[0]}", f"{large['seconds']:.1f} s for {wanted}", large["seconds"] <= 15
        )
        shown = f"{peak / 1e9:.2f} GB" if peak else "not reported by this system"
        yield Line(f"100,002 members: {asked[1]}", shown, peak <= 1.5e9 if peak else None)
        shown = f"{large['code_bytes']} against {small['code_bytes']} bytes, {100 * code:+.1f} %"
        yield Line(f"100,002 members: {asked[2]}", shown, abs(code) <= 0.1)
    yield _constant_time(e)


def _constant_time(e: Evidence) -> Line:
    text = "100,002 members: time a member within 2 times that of 903 members"
    small, large = e.best("tower100", FORCE), e.best(LARGEST, FORCE)
    if small is None or large is None or not small.ns_member or not large.ns_member:
        return e.missing(text, LARGEST)
    ratio = large.ns_member / small.ns_member
    return Line(text, f"{small.ns_member:.2f} to {large.ns_member:.2f} ns, {ratio:.2f} times", ratio <= 2)


def _many_states(e: Evidence) -> Iterator[Line]:
    """Rates of many states beside every peer, best of ours first; the target: faster than all of them."""
    names = {row.structure for row in e.session.rows if ensemble.MANY in row.structure}
    for structure in sorted(names) or [f"{ensemble.STRUCTURE}{ensemble.MANY}{ensemble.COUNT}"]:
        for quantity in ensemble.QUANTITIES:
            rows = [r for r in e.session.rows if (r.structure, r.quantity) == (structure, quantity) and r.ns]
            own = sorted((r for r in rows if r.side == "ours"), key=lambda r: r.ns or 0.0)[:1]
            peers = [r for r in rows if r.name in ensemble.PEERS]
            text = f"{structure}, {quantity}: states a second and core beside {len(ensemble.PEERS)} peers"
            if not own or len(peers) < len(ensemble.PEERS):
                missing = sorted(set(ensemble.PEERS) - {r.name for r in peers})
                yield Line(text, f"not measured: {', '.join(missing)}" if own else "", None)
                continue
            shown = "; ".join(f"{1e9 / (r.ns or 1.0):,.0f} {r.name}" for r in [*own, *peers])
            yield Line(text, shown, all((own[0].ns or 0.0) < (r.ns or 0.0) for r in peers))


def _compile(e: Evidence) -> Iterator[Line]:
    rows = [
        row for quantity in (FORCE, JACOBIAN) for row in e.own("tower1000", quantity) if row.compile_seconds
    ]
    text = "tower, 9,003 members: compiled in 2 s"
    if not rows:
        yield e.missing(text, "tower1000")
        return
    worst = max(rows, key=lambda row: row.compile_seconds or 0.0)
    shown = f"at most {worst.compile_seconds:.2f} s ({worst.quantity}, {worst.name})"
    yield Line(text, shown, (worst.compile_seconds or 0.0) <= 2)


def _agreement(e: Evidence) -> Iterator[Line]:
    text = "all emitters, builds and batches within 4 units in the last place of the largest term, node_force"
    found = {key[0]: units for key, units in e.session.units.items()}
    if not found:
        yield Line(text, "not measured", None)
        return
    shown = ", ".join(f"{units:.1f} {name}" for name, units in found.items())
    yield Line(text, shown, max(found.values()) <= 4)
    unequal = e.session.unequal
    text = "reference builds of all emitters equal to CasADi's virtual machine, bit for bit"
    shown = f"{sum(unequal.values())} values differ, {len(unequal)} comparisons of structure and quantity"
    yield Line(text, shown, not any(unequal.values()) if unequal else None)


PARTS: Sequence[Callable[[Evidence], Iterator[Line]]] = (
    _ratios,
    _floor_share,
    _jacobian_a_member,
    _largest,
    _compile,
    _agreement,
    _many_states,
)
