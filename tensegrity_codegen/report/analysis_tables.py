"""An analysis in tables for the terminal."""

import math

import numpy as np
from rich.table import Table

from tensegrity_codegen.report.long_table import LongTable, add_row, new_table, rank_rows
from tensegrity_codegen.report.number_text import format_short
from tensegrity_codegen.report.tables import classes_table, rank_members
from tensegrity_codegen.runtime.analysis.analysis import Analysis
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.member_limits import MEMBER_CHECKS
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.summaries import describe_count

NO_STIFFNESS = 1e-9  # of the largest force density: less is rounding


def describe_analysis_finding(found: Analysis) -> str:
    """Return whether the structure is stable and by what, mechanisms, lowest frequency, exceeded limits."""
    if found.status == "infeasible":
        assert found.certificate is not None
        count = len(found.certificate.shortening)
        return (
            f"No prestress exists: {describe_count(count, 'cable')} can only be slack, for a motion shortens "
            f"{'them' if count != 1 else 'it'}, lengthens no cable and changes no bar"
        )
    if found.status == "undecided":
        return (
            "Undecided: within rounding neither a prestress with every cable in tension is found nor a proof "
            f"that there is none ({describe_count(found.n_selfstress, 'self-stress', 'self-stresses')}, rank "
            f"{found.rank.rank} of {found.rank.largest_rank})"
        )
    parts = [_describe_unstable(found) if found.status == "unstable" else _describe_stable(found)]
    parts += [describe_modes(found)] if found.modes is not None and len(found.modes.frequency) else []
    parts += found.members.describe()
    return "; ".join(parts)


def describe_modes(found: Analysis) -> str:
    """Return the lowest natural frequency, or the number of unstable modes with the fastest growth."""
    assert found.modes is not None
    growing = int((found.modes.growth_rate > 0.0).sum())
    if growing:
        rate = format_short(float(found.modes.growth_rate.max()))
        modes = describe_count(growing, "unstable mode")
        return f"{modes} at the present tensions, the fastest grows by {rate} 1/s"
    frequency = found.modes.frequency[found.modes.frequency > 0.0]
    without = int((found.modes.frequency == 0.0).sum())
    more = f", {describe_count(without, 'mode')} without stiffness" if without else ""
    if not len(frequency):
        return f"no natural frequency{more}"
    return f"lowest natural frequency {format_short(float(frequency.min()))} Hz{more}"


def _describe_stable(found: Analysis) -> str:
    """Return what keeps the shape: self-stress or loads, and mechanisms that they stiffen."""
    count = found.n_mechanisms
    stiffened = f"{describe_count(count, 'mechanism')}, stiffened by tensions" if count else "no mechanism"
    own, loaded = found.prestress, found.load_prestress
    if not len(own.tension) or math.isinf(own.least_tension):
        return f"Stable without cables that need tension: {stiffened}"
    if own.is_found:
        kinds = describe_count(found.n_selfstress, "self-stress", "self-stresses")
        part = format_short(100 * own.least_tension / own.largest_force)
        return (
            f"Stable: {kinds}, every cable in tension (at least {part} % of the largest force); {stiffened}"
        )
    assert loaded is not None
    least = format_short(loaded.least_tension)
    return f"Stable under its loads: every cable in tension, at least {least} N; {stiffened}"


def _describe_unstable(found: Analysis) -> str:
    """Return which stiffness is missing: that of mechanisms, or that at the present tensions."""
    if not found.stability.is_stable:
        value = found.stability.smallest_eigenvalue
        size = f"a stiffness of {format_short(value)} of the largest force density"
        kind = "no stiffness" if abs(value) < NO_STIFFNESS else size
        return f"Unstable: the tensions found give {_of_mechanisms(found)} {kind}"
    return (
        "Unstable at the present tensions: the smallest eigenvalue of the stiffness is "
        f"{format_short(found.smallest_eigenvalue)} N/m"
    )


def _of_mechanisms(found: Analysis) -> str:
    count = found.n_mechanisms
    return "the only mechanism" if count == 1 else f"one of {count:,} mechanisms"


Subject = Structure | BodySystem

# Names of the limits in tables.
LIMIT_NAMES = {
    "least_tension": "least tension",
    "most_tension": "most tension",
    "yield_stress": "yield stress",
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
    value = found.stability.smallest_eigenvalue
    held = "no mechanism" if math.isinf(value) else f"{value:.4g} of the largest force density"
    return (
        ("coordinates, members", f"{rank.n_coordinates}, {rank.n_members}"),
        ("rank of the equilibrium matrix", f"{rank.rank} of {rank.largest_rank}"),
        ("singular values at the gap", f"{rank.above:.3g} | {below}"),
        ("gap; tolerance, times the largest", f"{rank.gap:.3g}; {rank.tolerance:g}"),
        ("self-stresses", str(found.n_selfstress)),
        ("rigid motions", str(found.n_rigid_motions)),
        ("mechanisms", str(found.n_mechanisms)),
        ("all cables in tension", _describe_prestress(found)),
        ("stiffness of mechanisms by tensions", held),
        ("smallest eigenvalue of the stiffness", stiffness),
        ("largest residual at present", f"{found.residual:.3g} N; largest force {found.largest_force:.6g} N"),
    )


def analysis_members_table(found: Analysis, subject: Subject) -> LongTable:
    """Return a table of the members: tensions found and present, and the part used of each limit."""
    checks = found.members
    limited = [name for name in MEMBER_CHECKS if not np.isnan(checks.use[name]).all()]
    known = not np.isnan(checks.stress).all()
    heads = ["member", "prestress", "tension\n[N]", *(["stress\n[MPa]", "buckling\nfactor"] if known else [])]
    heads += [f"{LIMIT_NAMES[name]}\nused [%]" for name in limited]
    shown = found.prestress
    if not shown.is_found and found.load_prestress is not None:
        shown = found.load_prestress

    def describe(e: int) -> list[str]:
        cells = [subject.member_name[e], f"{shown.tension[e]:+.5f}", f"{found.member_tension[e]:+.5g}"]
        if known:
            cells += [_number(checks.stress[e] / 1e6), _number(checks.buckling_factor[e])]
        return cells + [_number(100 * checks.use[limit][e]) for limit in limited]

    return LongTable(
        f"{subject.name}: members", tuple(heads), f"f{'r' * (len(heads) - 1)}", len(subject.member_name),
        describe, "members", rank_members(subject, shown.tension, checks),
        short=classes_table(
            subject, {"prestress": shown.tension, "tension\n[N]": found.member_tension}, shown.tension, checks
        ),
    )  # fmt: skip


def certificate_table(found: Analysis, subject: Subject) -> LongTable | None:
    """Return the displacements of the nodes that prove that there are no tensions; None without a proof."""
    proof, motion = found.certificate, found.certificate_displacement
    if proof is None or motion is None or not proof.is_verified:
        return None
    axes = list(subject.axes)
    size = np.linalg.norm(motion[:, axes], axis=1)
    return LongTable(
        f"{subject.name}: displacements that prove it, for a largest shortening of 1",
        ("node", *("xyz"[axis] for axis in axes)),
        f"f{'r' * len(axes)}",
        len(subject.node_name),
        lambda n: [subject.node_name[n], *(f"{motion[n, axis]:+.9f}" for axis in axes)],
        "nodes",
        (("largest displacement", rank_rows(-size)),),
        f"{len(proof.shortening)} cables shorten by {proof.least_shortening:.9g} to 1; all bars and the "
        f"other cables change by {proof.error:.1e} at most",
    )


def modes_table(found: Analysis, name: str) -> LongTable | None:
    """Return the first natural frequencies; None without masses."""
    modes = found.modes
    if modes is None or not len(modes.frequency):
        return None

    def describe(k: int) -> tuple[str, ...]:
        frequency, rate = modes.frequency[k], modes.growth_rate[k]
        note = f"unstable, grows by {rate:.4g} 1/s" if rate else "" if frequency else "no stiffness"
        return str(k + 1), f"{frequency:.5g}", note

    count = len(modes.frequency)
    return LongTable(
        f"{name}: modes at present", ("mode", "frequency [Hz]", "note"), "frl", count, describe, "modes",
        (("unstable and softest", range(count)),),
    )  # fmt: skip


def _describe_prestress(found: Analysis) -> str:
    if not len(found.prestress.tension) or math.isinf(found.prestress.least_tension):
        return "needed by no member"
    if found.prestress.is_found:
        part = found.prestress.least_tension / found.prestress.largest_force
        return f"yes, at least {part:.4g} of the largest member force"
    if found.load_prestress is not None and found.load_prestress.is_found:
        return f"under the loads, at least {found.load_prestress.least_tension:.4g} N"
    return "no"


def _number(value: float) -> str:
    return "" if math.isnan(value) else "-" if math.isinf(value) else f"{value:.4g}"
