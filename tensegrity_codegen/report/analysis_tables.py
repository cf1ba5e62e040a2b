"""An analysis in tables for the terminal."""

import math

import numpy as np
from rich.table import Table
from rich.text import Text

from tensegrity_codegen.report.tables import add_row, new_table
from tensegrity_codegen.runtime.analysis.analysis import Analysis
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.member_limits import MEMBER_CHECKS
from tensegrity_codegen.structure.structure import Structure

Subject = Structure | BodySystem

# Limits, and the heads of their columns.
HEADS = {
    "least_tension": "least tension",
    "most_tension": "most tension",
    "yield_stress": "yield",
    "buckling": "buckling",
}


def analysis_table(found: Analysis, name: str) -> Table:
    """Return a table of what was found: counts, gap, tensions, stability."""
    table = new_table(f"{name}: analysis", "what", "value")
    table.show_header = False
    for row in describe_counts(found):
        add_row(table, *row)
    return table


def describe_counts(found: Analysis) -> tuple[tuple[str, str], ...]:
    """Return what was found as rows of two texts: counts, gap, tensions, stability."""
    rank = found.rank
    below = "none counts as zero" if math.isnan(rank.below) else f"{rank.below:.3g}"
    stiffness = f"{found.smallest_eigenvalue:.6g} N/m"
    if found.stiffness.is_neutral and found.is_balanced:
        stiffness = f"0 within rounding ({stiffness})"
    return (
        ("coordinates, members", f"{rank.n_coordinates}, {rank.n_members}"),
        ("rank of the equilibrium matrix", f"{rank.rank} of {rank.largest_rank}"),
        ("singular values at the gap", f"{rank.above:.3g} | {below}"),
        ("gap; tolerance, times the largest", f"{rank.gap:.3g}; {rank.tolerance:g}"),
        ("self-stresses", str(found.n_selfstress)),
        ("rigid motions", str(found.n_rigid_motions)),
        ("mechanisms", str(found.n_mechanisms)),
        ("all cables in tension", _describe_prestress(found)),
        ("stiffness of mechanisms by tensions", _describe_stability(found)),
        ("smallest eigenvalue of the stiffness", stiffness),
        ("largest residual at present", f"{found.residual:.3g} N; largest force {found.largest_force:.6g} N"),
    )


def analysis_members_table(found: Analysis, subject: Subject) -> Table:
    """Return a table of the members: tensions found and present, and the part used of each limit."""
    limited = [name for name in MEMBER_CHECKS if not np.isnan(found.members.use[name]).all()]
    known = not np.isnan(found.members.stress).all()
    columns = {"prestress": "right", "tension\n[N]": "right"}
    columns |= {"stress\n[MPa]": "right", "buckling\nfactor": "right"} if known else {}
    columns |= {f"{HEADS[name]}\nused [%]": "right" for name in limited}
    table = new_table(f"{subject.name}: members", "member", **columns)
    shown = found.prestress
    if not shown.is_found and found.load_prestress is not None:
        shown = found.load_prestress
    for e, name in enumerate(subject.member_name):
        cells = [f"{shown.tension[e]:+.5f}", f"{found.member_tension[e]:+.5g}"]
        if known:
            cells += [_number(found.members.stress[e] / 1e6), _number(found.members.buckling_factor[e])]
        cells += [_number(100 * found.members.use[limit][e]) for limit in limited]
        add_row(table, name, *cells)
    return table


def certificate_table(found: Analysis, subject: Subject) -> Table | None:
    """Return the displacements of the nodes that prove that there are no tensions; None without a proof."""
    proof, motion = found.certificate, found.certificate_displacement
    if proof is None or motion is None or not proof.is_verified:
        return None
    letters = ["xyz"[axis] for axis in subject.axes]
    title = f"{subject.name}: displacements that prove it, for a largest shortening of 1"
    table = new_table(title, "node", **dict.fromkeys(letters, "right"))
    for n, name in enumerate(subject.node_name):
        add_row(table, name, *(f"{motion[n, axis]:+.9f}" for axis in subject.axes))
    table.caption = Text(
        f"{len(proof.shortening)} cables shorten by {proof.least_shortening:.9g} to 1; all bars and the "
        f"other cables change by {proof.error:.1e} at most"
    )
    table.caption_justify = "left"
    return table


def modes_table(found: Analysis, name: str) -> Table | None:
    """Return the first natural frequencies; None without masses."""
    if found.modes is None or not len(found.modes.frequency):
        return None
    table = new_table(f"{name}: modes at present", "mode", **{"frequency [Hz]": "right", "note": "left"})
    for k, (frequency, rate) in enumerate(zip(found.modes.frequency, found.modes.growth_rate, strict=True)):
        note = f"unstable, grows by {rate:.4g} 1/s" if rate else "" if frequency else "no stiffness"
        add_row(table, str(k + 1), f"{frequency:.5g}", note)
    return table


def _describe_prestress(found: Analysis) -> str:
    if not len(found.prestress.tension) or math.isinf(found.prestress.least_tension):
        return "needed by no member"
    if found.prestress.is_found:
        part = found.prestress.least_tension / found.prestress.largest_force
        return f"yes, at least {part:.4g} of the largest member force"
    if found.load_prestress is not None and found.load_prestress.is_found:
        return f"under the loads, at least {found.load_prestress.least_tension:.4g} N"
    return "no"


def _describe_stability(found: Analysis) -> str:
    value = found.stability.smallest_eigenvalue
    return "no mechanism" if math.isinf(value) else f"{value:.4g} of the largest force density"


def _number(value: float) -> str:
    return "" if math.isnan(value) else "-" if math.isinf(value) else f"{value:.4g}"
