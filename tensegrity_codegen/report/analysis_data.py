"""An analysis as JSON-ready data and as arrays, with the names of nodes and members."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.analysis.analysis import Analysis
from tensegrity_codegen.runtime.analysis.certificate import Certificate
from tensegrity_codegen.runtime.analysis.prestress import Prestress
from tensegrity_codegen.runtime.model.array_file import write_arrays
from tensegrity_codegen.structure.member_limits import MEMBER_CHECKS
from tensegrity_codegen.system.arrays import FloatArray


def describe_analysis(
    found: Analysis, member_name: Sequence[str], node_name: Sequence[str]
) -> dict[str, Any]:
    """Return an analysis as one JSON-ready object, members and nodes by name."""
    rank = found.rank
    sizes = ("rank", "largest_rank", "n_coordinates", "n_members", "gap", "tolerance", "rounding", "warning")
    return {
        **_pick(found, "status", "message", "n_selfstress", "n_rigid_motions", "n_mechanisms", "parts"),
        "rank": {
            **_pick(rank, *sizes, "singular_value"),
            "above_gap": rank.above,
            "below_gap": rank.below,
        },
        "prestress": _describe_prestress(found.prestress, member_name),
        "load_prestress": _describe_prestress(found.load_prestress, member_name),
        "certificate": _describe_certificate(
            found.certificate, found.certificate_displacement, member_name, node_name
        ),
        "load_certificate": _describe_certificate(
            found.load_certificate, found.load_certificate_displacement, member_name, node_name
        ),
        "prestress_stability": _pick(found.stability, "is_stable", "smallest_eigenvalue", "eigenvalue"),
        **_pick(found, "is_loaded", "load_note", "is_balanced", "residual", "largest_force"),
        "smallest_eigenvalue": found.smallest_eigenvalue,
        "neutral_motions": found.stiffness.neutral_motions,
        "modes": found.modes and _pick(found.modes, "frequency", "growth_rate", "n_rigid", "n_total"),
        "member_length": _name(member_name, found.member_length),
        "member_tension": _name(member_name, found.member_tension),
        "limits": _describe_limits(found, member_name),
        "warnings": found.warnings,
    }


def write_analysis(
    found: Analysis,
    path: Path,
    member_name: Sequence[str],
    node_name: Sequence[str],
    *,
    overwrite: bool,
) -> None:
    """Write the arrays of an analysis to an .npz file, whole or not at all; OutputError."""
    arrays: dict[str, Any] = {
        "node_name": np.array(node_name, dtype=str),
        "member_name": np.array(member_name, dtype=str),
        **_pick(
            found, "node_position", "member_length", "member_tension", "rigid_motion", "mechanism", "load"
        ),
        **_pick(found.rank, "singular_value", "selfstress"),
        "rank": np.array(found.rank.rank),
        "prestress": found.prestress.tension,
        "member_stress": found.members.stress,
        "buckling_factor": found.members.buckling_factor,
    }
    if found.load_prestress is not None:
        arrays["load_prestress"] = found.load_prestress.tension
    for name, proof, motion in (
        ("certificate", found.certificate, found.certificate_displacement),
        ("load_certificate", found.load_certificate, found.load_certificate_displacement),
    ):
        if proof is not None:
            arrays |= {f"{name}_displacement": motion, f"{name}_elongation": proof.elongation}
    if found.modes is not None:
        arrays |= _pick(found.modes, "frequency", "growth_rate") | {"mode_shape": found.modes.shape}
    write_arrays(path, arrays, overwrite=overwrite)


def _pick(item: Any, *names: str) -> dict[str, Any]:
    return {name: getattr(item, name) for name in names}


def _describe_prestress(prestress: Prestress | None, member_name: Sequence[str]) -> dict[str, Any] | None:
    if prestress is None:
        return None
    facts = _pick(prestress, "is_found", "least_tension", "largest_force")
    return facts | {"tension": _name(member_name, prestress.tension)}


def _describe_certificate(
    proof: Certificate | None,
    motion: FloatArray | None,
    member_name: Sequence[str],
    node_name: Sequence[str],
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


def _describe_limits(found: Analysis, member_name: Sequence[str]) -> dict[str, Any]:
    members = found.members
    worst = members.worst
    return {
        "is_met": not members.exceeded,
        "worst": None if worst is None else dict(zip(("member", "limit", "use"), worst, strict=True)),
        **members.as_evidence(),
        "use": {limit: _name(member_name, members.use[limit]) for limit in MEMBER_CHECKS},
        "member_stress": _name(member_name, members.stress),
        "buckling_load": _name(member_name, members.buckling_load),
        "buckling_factor": _name(member_name, members.buckling_factor),
        "least_bar_distance": None
        if found.bar_distance is None
        else float(found.bar_distance.min(initial=np.inf)),
    }


def _name(names: Sequence[str], values: FloatArray) -> dict[str, Any]:
    return dict(zip(names, np.asarray(values).tolist(), strict=True))
