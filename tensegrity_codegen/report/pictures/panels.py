"""Diagrams over time of a simulated motion: energies, member tensions, energy drift."""

from typing import TYPE_CHECKING

import numpy as np

from tensegrity_codegen.report.pictures.palette import GRID, INK, MUTED, SEQUENCE
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.structure import Structure

if TYPE_CHECKING:
    from matplotlib.axes import Axes


TEXT_SIZE = 9.0
# Groups of at most this many members are drawn line by line, larger ones as a band around their median.
MOST_LINES = 6
# With more classes than colours, members are grouped by kind alone.
MOST_GROUPS = len(SEQUENCE)


def draw_energies(axes: "Axes", trajectory: Trajectory) -> None:
    """Draw kinetic, potential and total energy [J] over time [s].

    The potential energy counts from its least value in the run, so that its exchange with the kinetic shows.
    """
    kinetic = trajectory.kinetic_energy
    least = float(np.min(trajectory.total_energy - kinetic))
    total = trajectory.total_energy - least
    rows = (
        ("total", total, INK, "solid", 2.0),
        ("potential", total - kinetic, SEQUENCE[0], "solid", 1.4),
        ("kinetic", kinetic, SEQUENCE[1], (0.0, (5.0, 1.6)), 1.4),
    )
    for name, values, color, style, width in rows:
        axes.plot(
            trajectory.time, values, label=name, color=color, linestyle=style, linewidth=width,
            marker=_marker(trajectory), zorder=2 if name == "total" else 3,
        )  # fmt: skip
    _dress(axes, "energy [J]", legend=3)
    axes.set_title(f"potential above {least:.4g} J", loc="left", fontsize=TEXT_SIZE - 1, color=MUTED, pad=5.0)


def draw_tensions(axes: "Axes", structure: Structure, trajectory: Trajectory) -> None:
    """Draw the member tensions [N] over time [s], one colour a group of `group_members`."""
    groups = group_members(structure)
    axes.axhline(0.0, color=MUTED, linewidth=0.8, zorder=1)
    for (name, members), color in zip(groups.items(), SEQUENCE, strict=False):
        tension = trajectory.member_tension[:, members]
        known = [not np.isnan(tension[:, k]).any() for k in range(len(members))]
        if not any(known):
            continue
        tension, members = tension[:, known], [e for e, good in zip(members, known, strict=True) if good]
        label = f"{name} ({len(members)})"
        if len(members) <= MOST_LINES:
            lines = axes.plot(
                trajectory.time, tension, color=color, linewidth=1.1, marker=_marker(trajectory), zorder=3
            )
            lines[0].set_label(label)
            continue
        low, high = tension.min(axis=1), tension.max(axis=1)
        axes.fill_between(trajectory.time, low, high, color=color, alpha=0.22, linewidth=0.0, zorder=2)
        axes.plot(
            trajectory.time, np.median(tension, axis=1), color=color, linewidth=1.6, label=f"{label}, median",
            marker=_marker(trajectory), zorder=3,
        )  # fmt: skip
    _dress(axes, "member tension [N]", legend=3)


def draw_drift(axes: "Axes", structure: Structure, trajectory: Trajectory) -> None:
    """Draw the change of the total energy over the largest kinetic energy, over time [s].

    Where nothing moves, the scale is the rounding of the potential energy, as in Trajectory.energy_drift.
    """
    change = trajectory.total_energy - trajectory.total_energy[0]
    potential = float(np.max(np.abs(trajectory.total_energy - trajectory.kinetic_energy)))
    drift = change / (max(float(np.max(trajectory.kinetic_energy)), 1e-9 * potential) or 1.0)
    axes.axhline(0.0, color=MUTED, linewidth=0.8, zorder=1)
    axes.plot(trajectory.time, drift, color=SEQUENCE[2], linewidth=1.4, marker=_marker(trajectory), zorder=3)
    _dress(axes, "energy change [1]")
    axes.set_xlabel("time [s]", fontsize=TEXT_SIZE, color=INK)
    text = "change of total energy / largest kinetic energy"
    if trajectory.energy_drift is not None:
        text += f"; drift {trajectory.energy_drift:.2g}"
    elif structure.damping.any():
        text += "; damping takes energy away"
    axes.set_title(text, loc="right", fontsize=TEXT_SIZE - 1, color=MUTED, pad=3.0)


def group_members(structure: Structure) -> dict[str, list[int]]:
    """Return the members, bars first, by class and kind; by kind alone where the classes are many."""
    kinds = ["bar" if is_bar else "cable" for is_bar in structure.is_bar]
    order = sorted(range(structure.n_members), key=lambda e: kinds[e])
    fine: dict[str, list[int]] = {}
    coarse: dict[str, list[int]] = {}
    for e in order:
        name = structure.member_class[e]
        fine.setdefault(kinds[e] if name in ("", kinds[e]) else f"{kinds[e]} {name}", []).append(e)
        coarse.setdefault(f"{kinds[e]}s", []).append(e)
    return fine if len(fine) <= MOST_GROUPS else coarse


def _marker(trajectory: Trajectory) -> str:
    """Return the marker that makes short runs visible."""
    return "o" if len(trajectory.time) < 3 else ""


def _dress(axes: "Axes", name: str, *, legend: int = 0) -> None:
    """Give a diagram its grid, its name and, above it, a legend of so many columns."""
    axes.set_ylabel(name, fontsize=TEXT_SIZE, color=INK)
    axes.grid(True, color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.margins(x=0.01)
    axes.tick_params(labelsize=TEXT_SIZE - 1, colors=MUTED, length=0)
    axes.yaxis.get_offset_text().set(fontsize=TEXT_SIZE - 1, color=MUTED)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(GRID)
    if legend:
        axes.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=legend, frameon=False,
            fontsize=TEXT_SIZE - 1, labelcolor=INK, borderaxespad=0.2, handlelength=1.8,
        )  # fmt: skip
