"""Pictures of a run: time a member over size, code and compile time over size, rates of many states."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from harness.floor import Floor
from harness.session import Row

__all__ = ["draw_all"]

OURS = ("#0b3954", "#087e8b", "#1b998b", "#6a4c93", "#c81d25", "#ff5a5f")
SIZE, DPI = (9.0, 5.6), 120


def draw_all(folder: Path, rows: Sequence[Row], floor: Floor | None) -> list[Path]:
    """Write the pictures as PNG into `folder`; return their paths, none without matplotlib."""
    try:
        import matplotlib

        matplotlib.use("agg")
        from matplotlib import pyplot
    except ImportError:
        return []
    drawn = []
    by_size = [row for row in rows if " x " not in row.structure and row.ns and _is_drawn(row)]
    for quantity in dict.fromkeys(row.quantity for row in by_size):
        chosen = [row for row in by_size if row.quantity == quantity]
        axes = _over_members(pyplot, chosen, lambda row: row.ns_member, "ns a member")
        if floor is not None and floor.member and quantity == "node_force":
            axes.axhline(min(floor.member.values()), color="black", linestyle=":", label="floor of this core")
        drawn.append(_save(pyplot, axes, f"{quantity}: time a member", folder / f"time_{quantity}.png"))
    force = [row for row in by_size if row.quantity == "node_force" and row.code_bytes]
    for title, value, unit in (
        ("code_bytes", lambda row: row.code_bytes, "bytes of instructions"),
        ("compile_seconds", lambda row: row.compile_seconds, "s to compile"),
    ):
        if force:
            axes = _over_members(pyplot, force, value, unit)
            drawn.append(_save(pyplot, axes, f"node_force: {unit}", folder / f"{title}.png"))
    ensemble = [row for row in rows if " x " in row.structure and row.ns]
    drawn += [_draw_rates(pyplot, ensemble, folder)] if ensemble else []
    return drawn


def _is_drawn(row: Row) -> bool:
    """Return whether a row is worth a line: not the reference flags, nor what only checks the baseline."""
    return "reference" not in row.name and "our expression" not in row.name


def _over_members(pyplot: Any, rows: Sequence[Row], value: Callable[[Row], float | None], unit: str) -> Any:
    """Draw one line a candidate, ours thick, over the number of members, both axes logarithmic."""
    _, axes = pyplot.subplots(figsize=SIZE)
    ours = 0
    for name in dict.fromkeys(row.name for row in rows):
        points = sorted((row.members, value(row)) for row in rows if row.name == name)
        style: dict[str, Any] = {"linewidth": 1.0, "alpha": 0.75, "linestyle": "--"}
        if next(row.side for row in rows if row.name == name) == "ours":
            style = {"linewidth": 2.2, "color": OURS[ours % len(OURS)], "linestyle": "-"}
            ours += 1
        axes.loglog(*zip(*points, strict=True), marker="o", markersize=3.5, label=name, **style)
    axes.set_xlabel("members")
    axes.set_ylabel(unit)
    axes.grid(True, which="both", alpha=0.2)
    return axes


def _draw_rates(pyplot: Any, rows: Iterable[Row], folder: Path) -> Path:
    """Draw evaluations a second of every candidate, one group a quantity."""
    listed = list(rows)
    quantities = list(dict.fromkeys(row.quantity for row in listed))
    figure, every = pyplot.subplots(1, len(quantities), figsize=(5.0 * len(quantities), 5.0))
    for axes, quantity in zip([every] if len(quantities) == 1 else every, quantities, strict=True):
        chosen = sorted((row for row in listed if row.quantity == quantity), key=lambda row: -(row.ns or 0))
        colours = [OURS[1] if row.side == "ours" else "#b0b0b0" for row in chosen]
        axes.barh([row.name for row in chosen], [1e9 / (row.ns or 1) for row in chosen], color=colours)
        axes.set_xscale("log")
        axes.set_xlabel("states a second and core")
        axes.set_title(f"{chosen[0].structure} states: {quantity}", fontsize=10)
        axes.tick_params(axis="y", labelsize=7)
    figure.tight_layout()
    path = folder / "rates.png"
    figure.savefig(path, dpi=DPI)
    pyplot.close(figure)
    return path


def _save(pyplot: Any, axes: Any, title: str, path: Path) -> Path:
    axes.set_title(title)
    axes.legend(fontsize=6.5, loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)
    axes.figure.savefig(path, dpi=DPI, bbox_inches="tight")
    pyplot.close(axes.figure)
    return path
