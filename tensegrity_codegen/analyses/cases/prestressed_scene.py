"""`analyse --prestress`: the scene with the self-stress that was found, at the size that the user states."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    InvalidValueError,
    NonFiniteError,
    UnknownNameError,
    suggest,
)
from tensegrity_codegen.system.summaries import count_names

if TYPE_CHECKING:
    from tensegrity_codegen.runtime.analysis.analyse import Analysis
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.request import ModelRequest

PRESTRESS = "--prestress"
LEAST_WORD = "least"
NO_FORCE = 1e-10  # of the largest force: a member of the self-stress with less has none
BALANCE_TOLERANCE = 1e-6  # of the largest force: residual up to which the written scene is in balance

LOOSE = 0.01  # of the largest tension of cables: with less a cable is as good as slack


@dataclass(frozen=True)
class Prestressed:
    """A scene with the prestress found, as it was read back: tensions [N] and the largest residual [N].

    warning: that the shape is only near one with prestress, and which cables hardly have any; empty for none.
    """

    tension: FloatArray
    residual: float
    note: str
    warning: str


def write_prestressed(
    subject: "Subject",
    request: "ModelRequest",
    analysis: "Analysis",
    coordinate: FloatArray | None,
    text: str,
    out: Path,
    *,
    overwrite: bool,
) -> Prestressed | None:
    """Write the scene whose member tensions are the self-stress found; None if there is none."""
    # At the equilibrium `coordinate` (n_coordinates,), by default the positions of the scene.
    from tensegrity_codegen.pipeline.compile_scene import load_scene
    from tensegrity_codegen.scene.describe import describe_subject
    from tensegrity_codegen.scene.write import write_scene

    shape = analysis.prestress.tension
    name, force = _read_size(text, subject)
    if not analysis.prestress.is_found or not shape.any():
        return None
    tension = shape * _find_scale(subject, shape, name, force)
    moved = _move(subject, analysis, coordinate)
    length = _find_length(moved, analysis)
    rest_length = moved.require_rest_length(length, tension, "a smaller --prestress, or a stiffer member")
    settled = moved.with_changes(rest_length=rest_length)
    document = describe_subject(settled, request)
    reloaded, _ = load_scene(document)
    stored = np.where(
        _find_rigid(reloaded), tension, reloaded.compute_static_tension(_find_length(reloaded, analysis))
    )
    residual = _find_residual(analysis, stored)
    largest = float(np.abs(stored).max())
    # What singular values that count as zero leave: the shape is rounded, the rest lengths are not at fault.
    inherent = _find_residual(analysis, tension)
    if residual > inherent + BALANCE_TOLERANCE * largest:
        raise ConvergenceError(
            "rest lengths cannot hold this prestress in balance within rounding",
            evidence={"residual": residual, "largest_force": largest},
            where=PRESTRESS,
            hint="members may be very stiff for so little force: more prestress, or a smaller stiffness",
        )
    warnings = _list_loose(subject, stored)
    if residual > BALANCE_TOLERANCE * largest:
        warnings.append(
            f"{out} is near balance only, {residual:.3g} N off with a largest force of {largest:.3g} N, for "
            f"its shape is rounded: `equilibrium {out} --out SETTLED.toml` moves the nodes into balance"
        )
    write_scene(document, out, overwrite=overwrite)
    return Prestressed(stored, residual, _describe_choice(analysis), "; and ".join(warnings))


def _list_loose(subject: "Subject", tension: FloatArray) -> list[str]:
    """Return a sentence about cables that have next to no prestress beside the others; empty for none."""
    cables = subject.tension_only & (tension < LOOSE * tension[subject.tension_only].max(initial=0.0))
    if not cables.any():
        return []
    rows = np.flatnonzero(cables)[np.argsort(tension[cables], kind="stable")].tolist()
    names = count_names([subject.member_name[e] for e in rows])
    return [
        f"the prestress written leaves cables with less than {100 * LOOSE:g} % of the largest tension, as "
        f"rounded positions may: {tension[rows[0]]:.3g} N and more in {names}; a small load slackens them: "
        "give these a prestress of their own in the scene and settle it, or move nodes so that they pull more"
    ]


def _read_size(text: str, subject: "Subject") -> tuple[str, float]:
    """Return the name to which the force belongs, "" for the cable with most tension, and the force [N]."""
    name, _, number = text.rpartition("=")
    if name and name != LEAST_WORD and name not in subject.member_name:
        raise UnknownNameError(
            "unknown member",
            where=PRESTRESS,
            given=name,
            allowed=f"a member, or {LEAST_WORD}",
            hint=suggest(name, subject.member_name),
        )
    try:
        force = float(number)
    except ValueError:
        raise InvalidValueError(
            "not a force",
            where=PRESTRESS,
            given=text,
            allowed="FORCE, least=FORCE or MEMBER=FORCE, a force in N",
            hint="--prestress 100",
        ) from None
    if not math.isfinite(force):
        raise NonFiniteError("not a finite force", where=PRESTRESS, given=text, allowed="a number in N")
    is_member = name in subject.member_name
    if force == 0 or (force < 0 and not is_member):
        raise InvalidValueError(
            "a prestress without tension",
            where=PRESTRESS,
            given=text,
            allowed="above 0 N" if not is_member else "a force that is not 0, negative for compression",
            hint="the unit is N",
        )
    return name, force


def _find_scale(subject: "Subject", shape: FloatArray, name: str, force: float) -> float:
    """Return the factor by which the self-stress has the force that was stated."""
    if name in subject.member_name:
        member_force = float(shape[subject.member_name.index(name)])
        if abs(member_force) <= NO_FORCE * np.abs(shape).max():
            raise InvalidValueError(
                "the member has no force in the prestress found",
                where=PRESTRESS,
                given=name,
                allowed="a member with a force",
                hint=f"state that of {subject.member_name[int(np.abs(shape).argmax())]}",
            )
        if member_force * force < 0 and subject.tension_only.any():
            kind = "tension" if member_force > 0 else "compression"
            raise InvalidValueError(
                f"the member is in {kind} in the prestress found",
                where=PRESTRESS,
                given=f"{name}={force:g}",
                allowed="above 0" if member_force > 0 else "below 0",
                hint=f"--prestress {name}={-force:g}",
            )
        return force / member_force
    cables = shape[subject.tension_only]
    if not len(cables):
        size = float(np.abs(shape).min() if name == LEAST_WORD else np.abs(shape).max())
    else:
        size = float(cables.min() if name == LEAST_WORD else cables.max())
    if size <= NO_FORCE * np.abs(shape).max():
        raise InvalidValueError(
            "a member has no force in the prestress found",
            where=PRESTRESS,
            given=name,
            hint="--prestress 100",
        )
    return force / size


def _move(subject: "Subject", analysis: "Analysis", coordinate: FloatArray | None) -> "Subject":
    """Return the structure in the configuration that was analysed."""
    if coordinate is None:
        return subject
    if isinstance(subject, BodySystem):
        return subject.with_changes(coordinate=coordinate, velocity=0 * subject.velocity)
    return subject.with_changes(node_position=analysis.node_position, node_velocity=0 * subject.node_velocity)


def _find_length(subject: "Subject", analysis: "Analysis") -> FloatArray:
    """Return the member lengths [m]; those of nodes by the positions that are written."""
    if isinstance(subject, Structure):
        return subject.member_length()
    return analysis.member_length


def _find_rigid(subject: "Subject") -> NDArray[np.bool_]:
    """Return which members are rigid bars, whose force does not follow from their length."""
    rigid: NDArray[np.bool_] = (subject.spring_constant == 0) & (subject.axial_stiffness == 0)
    return rigid


def _find_residual(analysis: "Analysis", tension: FloatArray) -> float:
    """Return the largest component of A t [N], by the whole singular value decomposition of A."""
    rank = analysis.rank
    n = rank.largest_rank
    left_vectors = np.hstack([rank.left, rank.free_motion])[:, :n]
    right_vectors = np.vstack([rank.right, rank.selfstress])[:n]
    return float(np.abs(left_vectors @ (rank.singular_value * (right_vectors @ tension))).max(initial=0.0))


def _describe_choice(analysis: "Analysis") -> str:
    """Return a sentence about the choice among self-stresses, and about loads."""
    count = analysis.n_selfstress
    if count == 1:
        sentence = "the only self-stress"
    else:
        sentence = (
            f"of {count} self-stresses the combination whose least cable tension is largest (where that does "
            "not stiffen all mechanisms: one that does)"
        )
    if analysis.is_loaded:
        sentence += "; it does not balance the loads: `equilibrium` finds the shape under both"
    return sentence
