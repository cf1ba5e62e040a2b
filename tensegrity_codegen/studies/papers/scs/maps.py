"""SCS (30), (42): where the tower can stand symmetrically, as maps over azimuth and declination."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from tensegrity_codegen.report.number_text import format_number
from tensegrity_codegen.report.pages.diagram import TEXT_SIZE, dress_axes
from tensegrity_codegen.report.pages.page import Figure, Paragraph, Remark, Section
from tensegrity_codegen.report.pages.page_table import Table, make_table
from tensegrity_codegen.report.pages.picture import draw_picture
from tensegrity_codegen.report.pictures.canvas import INK, MUTED, SEQUENCE, new_figure
from tensegrity_codegen.studies.papers.scs.figures import (
    RegionMap,
    compare_tracking,
    compute_paper_maps,
    find_prestressable,
)
from tensegrity_codegen.studies.papers.scs.printed import PAPER_POSES
from tensegrity_codegen.studies.papers.scs.symmetry import SymmetricTower

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Patch

# Code of a region -> its name and colour: 0 taut, else the sum of 1, 2, 4 for the tendons that would push.
REGIONS = {
    0: ("all taut", SEQUENCE[2]),
    1: ("saddle", SEQUENCE[0]),
    2: ("vertical", SEQUENCE[4]),
    4: ("diagonal", SEQUENCE[3]),
    3: ("saddle, vertical", "#e69f00"),
    5: ("saddle, diagonal", SEQUENCE[1]),
    6: ("vertical, diagonal", MUTED),
    7: ("all three", INK),
}
POSES = {"(44)": ("44", "45"), "(52)": ("52", "53")}
MAP_SPAN = 120.0  # [deg], azimuths of the figures
STEP_OF_TURN = 2.0  # [deg], of the map over all azimuths
PRESTRESS_DELTA = (20.0, 30.0, 40.0, 50.0, 60.0)  # [deg]


def map_section(tower: SymmetricTower, step: float) -> Section:
    """Return the maps in steps of `step` [deg], and configurations that stand without load."""
    maps = compute_paper_maps(tower, step)
    turn = compute_paper_maps(tower, STEP_OF_TURN, 360.0)
    beyond = {name: region.feasible[:, region.alpha_deg >= MAP_SPAN].sum() for name, region in turn.items()}
    feasible = {name: 100 * float(region.feasible.mean()) for name, region in maps.items()}
    of_all = {
        name: feasible[name] * MAP_SPAN / 360.0 + 100 * float(beyond[name] / region.code.size)
        for name, region in turn.items()
    }
    return Section(
        "scs-map",
        "(30), (42)",
        "Where the tower can stand",
        "new",
        f"taut at {of_all['(44)']:.2f} % of all angles for Z = 1.111 m and −50 N, at "
        f"{of_all['(52)']:.2f} % for 1.605 m and 50 N; of those with azimuths from 0 to 120° at "
        f"{feasible['(44)']:.1f} and {feasible['(52)']:.1f} %",
        (
            Paragraph(
                "The paper finds feasible configurations by choosing angles and height until all "
                "tensions are positive. Here is where they are at the two heights of its examples, for "
                "the sign of the force there; tensions are proportional to the force. The maps show "
                "azimuths from 0 to 120°; at others some tendon would have to push."
            ),
            *(_map_figure(name, region) for name, region in maps.items()),
            Remark(
                "new",
                "The printed equilibria lie inside the green regions, (52) close to its edge: its saddle "
                "tendons carry 0.49 N. On the dashed line det(A_r) = 0 (42): tensions grow without bound "
                "under any force. Where it borders on a green region the tower can be prestressed without a "
                "force.",
            ),
            _prestress_table(tower),
        ),
    )


def _map_figure(name: str, region: RegionMap) -> Figure:
    """Return one map: regions, the contour of the determinant, and the printed equilibria."""
    figure = new_figure(4.9, 4.5)
    axes = figure.add_subplot()
    patches = _fill_regions(axes, region)
    for key in POSES[name]:
        pose = PAPER_POSES[key]
        axes.plot(pose.alpha_deg, pose.delta_deg, "o", color=INK, markersize=4.5, zorder=5)
        axes.annotate(
            pose.equation, (pose.alpha_deg, pose.delta_deg), xytext=(5, 4), textcoords="offset points",
            fontsize=TEXT_SIZE, color=INK, zorder=6,
        )  # fmt: skip
    dress_axes(axes, "azimuth α [°]", "declination δ [°]")
    axes.set(xlim=(region.alpha_deg[0], region.alpha_deg[-1]), ylim=(0, 90))
    axes.set_xticks(range(0, 121, 20))
    axes.set_yticks(range(0, 91, 15))
    figure.legend(
        handles=patches,
        loc="outside upper center", ncols=3, frameon=False, fontsize=TEXT_SIZE - 1, labelcolor=INK,
        handlelength=1.3, columnspacing=1.2,
    )  # fmt: skip
    return Figure(
        draw_picture(figure, f"scs-map-{POSES[name][0]}"),
        f"Z = {region.height:.5g} m, F₃ = {region.force:g} N".replace("-", "−")
        + ". Green: all tendons taut; other colours: which tendons would have to push. Dashed: det(A_r) = 0. "
        "Dots: printed equilibria. Empty, at 30°: bars intersect.",
        "Map of feasible configurations over azimuth and declination; the printed equilibria lie in its "
        "taut region.",
        {
            "height": region.height,
            "force": region.force,
            "alpha_deg": region.alpha_deg.tolist(),
            "delta_deg": region.delta_deg.tolist(),
            "code": region.code.tolist(),
        },
    )


def _fill_regions(axes: "Axes", region: RegionMap) -> "list[Patch]":
    """Fill each region with its colour and return the legend's patches."""
    from matplotlib.patches import Patch

    patches = []
    present = [code for code in REGIONS if (region.code == code).any()]
    for code in present:
        name, color = REGIONS[code]
        inside = np.where(region.code == code, 1.0, 0.0)
        strength = 0.6 if code == 0 else 0.38
        axes.contourf(
            region.alpha_deg, region.delta_deg, inside, levels=[0.5, 1.5], colors=[color], alpha=strength
        )
        patches.append(Patch(facecolor=color, alpha=strength, label=name))
    axes.contour(
        region.alpha_deg, region.delta_deg, np.ma.masked_invalid(region.determinant), levels=[0.0],
        colors=[INK], linestyles="dashed", linewidths=1.0,
    )  # fmt: skip
    return patches


def _prestress_table(tower: SymmetricTower) -> Table:
    """Return configurations that stand without load at the height of (44)."""
    height = PAPER_POSES["44"].height
    rows = []
    for delta in PRESTRESS_DELTA:
        if height <= tower.bar.length * math.cos(math.radians(delta)):
            continue
        for intervals in find_prestressable(tower, math.radians(delta), height):
            ratio = intervals.tension / intervals.tension[0]
            rows.append((delta, intervals.pose.in_degrees[0], *(float(value) for value in ratio[1:])))
    return make_table(
        f"Configurations at Z = {height:.5g} m that stand without load (F₃ = 0), and ratios of their "
        "tensions.",
        {"δ [°]": ".0f", "α [°]": ".4f", "T_V / T_S": ".4f", "T_D / T_S": ".4f"},
        rows,
    )


MOTIONS = {
    "with_torque": "(44) to (45), with torque",
    "zero_torque": "(52) to (53), without torque",
    "prescribed": "(52) to (53), both angles prescribed",
}
TOLERANCE, QUICK_TOLERANCE = 1e-11, 1e-7


def tracking_section(tower: SymmetricTower, quick: bool) -> Section:
    """Return how the full model follows each motion, by our controls and by (34) as printed."""
    rtol = QUICK_TOLERANCE if quick else TOLERANCE
    rows = compare_tracking(tower, rtol=rtol, samples=21 if quick else 101)
    worst = {
        name: max(row["angle_error_deg"] for row in rows if row["controls"] == name)
        for name in ("ours", "as printed")
    }
    ours, printed = (format_number(worst[name], ".0e") for name in ("ours", "as printed"))
    return Section(
        "scs-tracking",
        "(32) to (35)",
        "The full model driven by these controls",
        "differs",
        f"angles follow the plan within {ours}° with our controls, within {printed}° with (34) as printed",
        (
            Paragraph(
                "All 18 coordinates start at rest and know nothing of symmetry: the generated C is given "
                "18 rest lengths and the torque M₃ as functions of time, without feedback. How far it "
                "leaves the planned motion measures the plan. Relative tolerance of the integration "
                f"{format_number(rtol, '.0e').removeprefix('1 × ')}."
            ),
            _table(rows),
            Remark(
                "differs",
                "With (34) as printed, without the centrifugal term, the tower misses the plan by many "
                "orders more than the integration does. The paper shows no simulation of the full model.",
                ("scs-centrifugal",),
            ),
        ),
        "paper_wrong",
    )


def _table(rows: list[dict[str, Any]]) -> Table:
    cells = (
        (
            *(MOTIONS[row["motion"]], "ours" if row["controls"] == "ours" else "(34) as printed"),
            *(row[key] for key in ("angle_error_deg", "other_error", "asymmetry")),
        )
        for row in rows
    )
    heads = ("angles of the bars [°]", "coordinates of the top [rad, m]", "asymmetry of the bars [rad]")
    return make_table(
        "Largest errors over the whole motion.",
        {"motion": "", "controls": ""} | dict.fromkeys(heads, ".1e"),
        cells,
    )
