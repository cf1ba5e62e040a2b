"""An analysis as JSON-ready data, as arrays and in tables for the terminal."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tensegrity_codegen.report.long_table import LongTable, add_row, new_table, rank_rows
from tensegrity_codegen.report.number_text import format_short
from tensegrity_codegen.report.tables import classes_table, rank_members
from tensegrity_codegen.runtime.analysis.analyse import Analysis
from tensegrity_codegen.runtime.analysis.certificate import Certificate
from tensegrity_codegen.runtime.analysis.prestress import Prestress
from tensegrity_codegen.runtime.model.arrays import write_arrays
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.member_limits import MEMBER_CHECKS
from tensegrity_codegen.structure.outline import hide_bodies
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.summaries import describe_count

if TYPE_CHECKING:
    from rich.table import Table


def describe_analysis(
    analysis: Analysis, member_name: Sequence[str], node_name: Sequence[str]
) -> dict[str, Any]:
    """Return an analysis as one JSON-ready object, members and nodes by name."""
    rank = analysis.rank
    sizes = ("rank", "largest_rank", "n_coordinates", "n_members", "gap", "tolerance", "rounding", "warning")
    return {
        **_pick(analysis, "status", "message", "n_selfstress", "n_rigid_motions", "n_mechanisms", "parts"),
        "rank": {**_pick(rank, *sizes, "singular_value"), "above_gap": rank.above, "below_gap": rank.below},
        "prestress": _describe_prestress(analysis.prestress, member_name),
        "load_prestress": _describe_prestress(analysis.load_prestress, member_name),
        "certificate": _describe_certificate(
            analysis.certificate, analysis.certificate_displacement, member_name, node_name
        ),
        "load_certificate": _describe_certificate(
            analysis.load_certificate, analysis.load_certificate_displacement, member_name, node_name
        ),
        "prestress_stability": _pick(analysis.stability, "is_stable", "smallest_eigenvalue", "eigenvalue"),
        **_pick(analysis, "is_loaded", "load_note", "is_balanced", "residual", "largest_force"),
        "smallest_eigenvalue": analysis.smallest_eigenvalue,
        "neutral_motions": analysis.stiffness.neutral_motions,
        "modes": analysis.modes and _pick(analysis.modes, "frequency", "growth_rate", "n_rigid", "n_total"),
        "member_length": _name(member_name, analysis.member_length),
        "member_tension": _name(member_name, analysis.member_tension),
        "limits": _describe_limits(analysis, member_name),
        "warnings": analysis.warnings,
    }


def write_analysis(
    analysis: Analysis, path: Path, member_name: Sequence[str], node_name: Sequence[str], *, overwrite: bool
) -> None:
    """Write the arrays of an analysis to an .npz file, whole or not at all; OutputError."""
    arrays: dict[str, Any] = {
        "node_name": np.array(node_name, dtype=str),
        "member_name": np.array(member_name, dtype=str),
        **_pick(
            analysis, "node_position", "member_length", "member_tension", "rigid_motion", "mechanism", "load"
        ),
        **_pick(analysis.rank, "singular_value", "selfstress"),
        "rank": np.array(analysis.rank.rank),
        "prestress": analysis.prestress.tension,
        "member_stress": analysis.members.stress,
        "buckling_factor": analysis.members.buckling_factor,
    }
    if analysis.load_prestress is not None:
        arrays["load_prestress"] = analysis.load_prestress.tension
    for name, proof, motion in (
        ("certificate", analysis.certificate, analysis.certificate_displacement),
        ("load_certificate", analysis.load_certificate, analysis.load_certificate_displacement),
    ):
        if proof is not None:
            arrays |= {f"{name}_displacement": motion, f"{name}_elongation": proof.elongation}
    if analysis.modes is not None:
        arrays |= _pick(analysis.modes, "frequency", "growth_rate") | {"mode_shape": analysis.modes.shape}
    write_arrays(path, arrays, overwrite=overwrite)


def _pick(record: Any, *names: str) -> dict[str, Any]:
    return {name: getattr(record, name) for name in names}


def _describe_prestress(prestress: Prestress | None, member_name: Sequence[str]) -> dict[str, Any] | None:
    if prestress is None:
        return None
    facts = _pick(prestress, "is_found", "least_tension", "largest_force")
    return facts | {"tension": _name(member_name, prestress.tension)}


def _describe_certificate(
    proof: Certificate | None, motion: FloatArray | None, member_name: Sequence[str], node_name: Sequence[str]
) -> dict[str, Any] | None:
    if proof is None or motion is None:
        return None
    return {
        **_pick(proof, "is_verified", "least_shortening", "error", "load_work"),
        "shortening": [member_name[e] for e in proof.shortening],
        "largest_bar_change": proof.bar_change,
        "largest_cable_lengthening": proof.cable_lengthening,
        "displacement": _name(node_name, motion),
        "elongation": _name(member_name, proof.elongation),
    }


def _describe_limits(analysis: Analysis, member_name: Sequence[str]) -> dict[str, Any]:
    return {
        **analysis.members.as_dict(member_name),
        "least_bar_distance": None
        if analysis.bar_distance is None
        else float(analysis.bar_distance.min(initial=np.inf)),
    }


def _name(names: Sequence[str], values: FloatArray) -> dict[str, Any]:
    return dict(zip(names, np.asarray(values).tolist(), strict=True))


def describe_analysis_finding(analysis: Analysis) -> str:
    """Return whether the structure is stable and by what, mechanisms, lowest frequency, exceeded limits."""
    if analysis.status == "infeasible":
        assert analysis.certificate is not None
        count = len(analysis.certificate.shortening)
        return (
            f"No prestress exists: {describe_count(count, 'cable')} can only be slack, for a motion shortens "
            f"{'them' if count != 1 else 'it'}, lengthens no cable and changes no bar"
        )
    if analysis.status == "undecided":
        return (
            "Undecided: within rounding neither a prestress with every cable in tension is found nor a proof "
            f"that there is none ({describe_count(analysis.n_selfstress, 'self-stress', 'self-stresses')}, "
            f"rank {analysis.rank.rank} of {analysis.rank.largest_rank})"
        )
    findings = [_describe_unstable(analysis) if analysis.status == "unstable" else _describe_stable(analysis)]
    findings += (
        [describe_modes(analysis)] if analysis.modes is not None and len(analysis.modes.frequency) else []
    )
    findings += analysis.members.describe()
    return "; ".join(findings)


def describe_modes(analysis: Analysis) -> str:
    """Return the lowest natural frequency, or the number of unstable modes with the fastest growth."""
    assert analysis.modes is not None
    growing = int((analysis.modes.growth_rate > 0.0).sum())
    if growing:
        rate = format_short(float(analysis.modes.growth_rate.max()))
        modes = describe_count(growing, "unstable mode")
        return f"{modes} at the present tensions, the fastest grows by {rate} 1/s"
    frequency = analysis.modes.frequency[analysis.modes.frequency > 0.0]
    without = int((analysis.modes.frequency == 0.0).sum())
    lacking = f", {describe_count(without, 'mode')} without stiffness" if without else ""
    if not len(frequency):
        return f"no natural frequency{lacking}"
    return f"lowest natural frequency {format_short(float(frequency.min()))} Hz{lacking}"


def _describe_stable(analysis: Analysis) -> str:
    """Return the reason of the shape's stability: self-stress or loads, and mechanisms that they stiffen."""
    count = analysis.n_mechanisms
    stiffened = f"{describe_count(count, 'mechanism')}, stiffened by tensions" if count else "no mechanism"
    selfstress, loaded = analysis.prestress, analysis.load_prestress
    if not len(selfstress.tension) or math.isinf(selfstress.least_tension):
        return f"Stable without cables that need tension: {stiffened}"
    if selfstress.is_found:
        kinds = describe_count(analysis.n_selfstress, "self-stress", "self-stresses")
        percent = format_short(100 * selfstress.least_tension / selfstress.largest_force)
        ratio = f"at least {percent} % of the largest force"
        return f"Stable: {kinds}, every cable in tension ({ratio}); {stiffened}"
    assert loaded is not None
    tension = format_short(loaded.least_tension)
    return f"Stable under its loads, which can tighten every cable to {tension} N or more; {stiffened}"


def _describe_unstable(analysis: Analysis) -> str:
    """Return which stiffness is missing: that of mechanisms, or that at the present tensions."""
    if not analysis.stability.is_stable:
        return f"Unstable: {analysis.describe_loose()}".replace("-", "−")
    return (
        "Unstable at the present tensions: the smallest eigenvalue of the stiffness is "
        f"{format_short(analysis.smallest_eigenvalue)} N/m"
    )


Subject = Structure | BodySystem

# Names of the limits in tables.
LIMIT_NAMES = {
    "least_tension": "least tension",
    "most_tension": "most tension",
    "yield_stress": "yield stress",
    "buckling": "buckling",
}


def analysis_table(analysis: Analysis, name: str) -> "Table":
    """Return a table of the findings: counts, gap, tensions, stability."""
    table = new_table(f"{name}: analysis", "what", "value")
    table.show_header = False
    for row in describe_counts(analysis):
        add_row(table, *row)
    return table


def describe_counts(analysis: Analysis) -> tuple[tuple[str, str], ...]:
    """Return the findings as rows of two texts: counts, gap, tensions, stability."""
    rank = analysis.rank
    below = "none counts as zero" if math.isnan(rank.below) else f"{rank.below:.3g}"
    stiffness = f"{analysis.smallest_eigenvalue:.6g} N/m"
    if analysis.stiffness.is_neutral and analysis.is_balanced:
        stiffness = f"0 within rounding ({stiffness})"
    is_rigid = math.isinf(analysis.stability.smallest_eigenvalue)
    held = "no mechanism" if is_rigid else analysis.least_stiffness
    gap = "none" if math.isinf(rank.gap) else f"{rank.gap:.3g}"
    return (
        ("coordinates, members", f"{rank.n_coordinates}, {rank.n_members}"),
        ("rank of the equilibrium matrix", f"{rank.rank} of {rank.largest_rank}"),
        ("singular values at the gap", f"{rank.above:.3g} | {below}"),
        ("gap; tolerance, times the largest", f"{gap}; {rank.tolerance:g}"),
        ("self-stresses", str(analysis.n_selfstress)),
        ("rigid motions", str(analysis.n_rigid_motions)),
        ("mechanisms", str(analysis.n_mechanisms)),
        ("all cables in tension", _summarise_prestress(analysis)),
        ("stiffness of mechanisms by tensions", held),
        ("smallest eigenvalue of the stiffness", stiffness),
        (
            "largest residual at present",
            f"{analysis.residual:.3g} N; largest force {analysis.largest_force:.6g} N",
        ),
    )


def analysis_members_table(analysis: Analysis, subject: Subject) -> LongTable:
    """Return a table of the members: tensions found and present, and the part used of each limit."""
    subject = hide_bodies(subject) if isinstance(subject, Structure) else subject
    checks, count = analysis.members, len(subject.member_name)
    limited = [name for name in MEMBER_CHECKS if not np.isnan(checks.use[name]).all()]
    has_stress = not np.isnan(checks.stress).all()
    heads = [
        "member",
        "prestress",
        "tension\n[N]",
        *(["stress\n[MPa]", "buckling\nfactor"] if has_stress else []),
    ]
    heads += [f"{LIMIT_NAMES[name]}\nused [%]" for name in limited]
    shown = analysis.prestress
    if not shown.is_found and analysis.load_prestress is not None:
        shown = analysis.load_prestress

    tension, present = shown.tension[:count], analysis.member_tension[:count]

    def describe(e: int) -> list[str]:
        cells = [subject.member_name[e], f"{tension[e]:+.5f}", f"{present[e]:+.5g}"]
        if has_stress:
            cells += [_number(checks.stress[e] / 1e6), _number(checks.buckling_factor[e])]
        return cells + [_number(100 * checks.use[limit][e]) for limit in limited]

    return LongTable(
        f"{subject.name}: members", tuple(heads), f"f{'r' * (len(heads) - 1)}", count,
        describe, "members", rank_members(subject, tension, checks),
        short=classes_table(
            subject, {"prestress": tension, "tension\n[N]": present}, tension, checks,
        ),
    )  # fmt: skip


def certificate_table(analysis: Analysis, subject: Subject) -> LongTable | None:
    """Return the displacements of the nodes that prove that there are no tensions; None without a proof."""
    proof, motion = analysis.certificate, analysis.certificate_displacement
    if proof is None or motion is None or not proof.is_verified:
        return None
    subject = hide_bodies(subject) if isinstance(subject, Structure) else subject
    axes, motion = list(subject.axes), motion[: len(subject.node_name)]
    size = np.linalg.norm(motion[:, axes], axis=1)
    return LongTable(
        f"{subject.name}: proof that no self-stress tightens all cables, for a largest shortening of 1",
        ("node", *("xyz"[axis] for axis in axes)),
        f"f{'r' * len(axes)}",
        len(subject.node_name),
        lambda n: [subject.node_name[n], *(f"{motion[n, axis]:+.9f}" for axis in axes)],
        "nodes",
        (("largest displacement", rank_rows(-size)),),
        f"{len(proof.shortening)} cables shorten by {proof.least_shortening:.9g} to 1; all bars and the "
        f"other cables change by {proof.error:.1e} at most",
    )


def modes_table(analysis: Analysis, name: str) -> LongTable | None:
    """Return the first natural frequencies; None without masses."""
    modes = analysis.modes
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


def _summarise_prestress(analysis: Analysis) -> str:
    if not len(analysis.prestress.tension) or math.isinf(analysis.prestress.least_tension):
        return "needed by no member"
    if analysis.prestress.is_found:
        fraction = analysis.prestress.least_tension / analysis.prestress.largest_force
        return f"yes, at least {fraction:.4g} of the largest member force"
    if analysis.load_prestress is not None and analysis.load_prestress.is_found:
        return (
            f"possible under the loads, with up to {analysis.load_prestress.least_tension:.4g} N in the least"
        )
    return "no"


def _number(value: float) -> str:
    return "" if math.isnan(value) else "-" if math.isinf(value) else f"{value:.4g}"
