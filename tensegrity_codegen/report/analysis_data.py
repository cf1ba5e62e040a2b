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
    return {
        "status": found.status,
        "message": found.message,
        "rank": _describe_rank(found),
        "n_selfstress": found.n_selfstress,
        "n_rigid_motions": found.n_rigid_motions,
        "n_mechanisms": found.n_mechanisms,
        "parts": found.parts,
        "prestress": _describe_prestress(found.prestress, member_name),
        "load_prestress": _describe_prestress(found.load_prestress, member_name),
        "is_loaded": found.is_loaded,
        "load_note": found.load_note,
        "certificate": _describe_certificate(
            found.certificate, found.certificate_displacement, member_name, node_name
        ),
        "load_certificate": _describe_certificate(
            found.load_certificate, found.load_certificate_displacement, member_name, node_name
        ),
        "prestress_stability": {
            "is_stable": found.stability.is_stable,
            "smallest_eigenvalue": found.stability.smallest_eigenvalue,
            "eigenvalue": found.stability.eigenvalue,
        },
        "is_balanced": found.is_balanced,
        "residual": found.residual,
        "largest_force": found.largest_force,
        "smallest_eigenvalue": found.smallest_eigenvalue,
        "neutral_motions": found.stiffness.neutral_motions,
        "modes": _describe_modes(found),
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
        "node_position": found.node_position,
        "member_length": found.member_length,
        "member_tension": found.member_tension,
        "singular_value": found.rank.singular_value,
        "rank": np.array(found.rank.rank),
        "selfstress": found.rank.selfstress,
        "rigid_motion": found.rigid_motion,
        "mechanism": found.mechanism,
        "prestress": found.prestress.tension,
        "load": found.load,
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
        arrays |= {
            "frequency": found.modes.frequency,
            "growth_rate": found.modes.growth_rate,
            "mode_shape": found.modes.shape,
        }
    write_arrays(path, arrays, overwrite=overwrite)


def _describe_rank(found: Analysis) -> dict[str, Any]:
    rank = found.rank
    return {
        "rank": rank.rank,
        "largest_rank": rank.largest_rank,
        "n_coordinates": rank.n_coordinates,
        "n_members": rank.n_members,
        "above_gap": rank.above,
        "below_gap": rank.below,
        "gap": rank.gap,
        "tolerance": rank.tolerance,
        "rounding": rank.rounding,
        "warning": rank.warning,
        "singular_value": rank.singular_value,
    }


def _describe_prestress(prestress: Prestress | None, member_name: Sequence[str]) -> dict[str, Any] | None:
    if prestress is None:
        return None
    return {
        "is_found": prestress.is_found,
        "least_tension": prestress.least_tension,
        "largest_force": prestress.largest_force,
        "tension": _name(member_name, prestress.tension),
    }


def _describe_certificate(
    proof: Certificate | None,
    motion: FloatArray | None,
    member_name: Sequence[str],
    node_name: Sequence[str],
) -> dict[str, Any] | None:
    if proof is None or motion is None:
        return None
    return {
        "is_verified": proof.is_verified,
        "shortening": [member_name[e] for e in proof.shortening],
        "least_shortening": proof.least_shortening,
        "largest_bar_change": proof.bar_change,
        "largest_cable_lengthening": proof.cable_lengthening,
        "error": proof.error,
        "load_work": proof.load_work,
        "displacement": _name(node_name, motion),
        "elongation": _name(member_name, proof.elongation),
    }


def _describe_modes(found: Analysis) -> dict[str, Any] | None:
    if found.modes is None:
        return None
    return {
        "frequency": found.modes.frequency,
        "growth_rate": found.modes.growth_rate,
        "n_rigid": found.modes.n_rigid,
        "n_total": found.modes.n_total,
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
