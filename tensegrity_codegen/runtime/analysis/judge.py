"""The verdict of an analysis in words: status, message, warnings."""

import math
from collections.abc import Iterator
from dataclasses import replace

from tensegrity_codegen.runtime.analysis.analysis import Analysis
from tensegrity_codegen.runtime.analysis.configuration import Configuration
from tensegrity_codegen.scene.names import describe_pieces
from tensegrity_codegen.system.errors import name_list


def judge(found: Analysis, at: Configuration) -> Analysis:
    """Return the analysis with its status, message and warnings."""
    loaded = found.load_prestress
    exists = found.prestress.is_found or (loaded is not None and loaded.is_found)
    if not exists:
        proof = found.certificate
        status = "infeasible" if proof is not None and proof.is_verified else "undecided"
        message = _describe_proof(found, at) if status == "infeasible" else UNDECIDED
    elif not found.stability.is_stable:
        status, message = "unstable", _describe_looseness(found)
    elif found.is_balanced and found.stiffness.is_unstable:
        status = "unstable"
        message = (
            "at the present tensions the structure is in an unstable equilibrium: the smallest eigenvalue of "
            f"its stiffness is {found.smallest_eigenvalue:.6g}"
        )
    else:
        status = "stable"
        message = "; but ".join([_describe_tensions(found, at), *_find_flaws(found, at)])
    return replace(found, status=status, message=message, warnings=_find_warnings(found, at))


UNDECIDED = (
    "no tensions with every cable in tension exist beyond rounding, but the proof fails by rounding too: the "
    "configuration is next to one where they exist"
)
UNJUDGED = "the present forces are not in balance, so that stability is not judged here: settle it first"


def _describe_proof(found: Analysis, at: Configuration) -> str:
    """Return which cables can only be slack."""
    assert found.certificate is not None
    names = [at.manifest.member_name[e] for e in found.certificate.shortening]
    shown = name_list(names, 6)
    return (
        f"no self-stress has every cable in tension: without loads {shown} can only be slack, since a motion "
        f"shortens {'them' if len(names) > 1 else 'it'}, lengthens no cable and keeps the length of every bar"
    )


def _describe_looseness(found: Analysis) -> str:
    value = found.stability.smallest_eigenvalue
    kind = "no stiffness" if abs(value) < 1e-9 else f"a stiffness of {value:.3g} of the largest force density"
    return f"the tensions found give a mechanism {kind}: they do not hold the shape"


def _describe_tensions(found: Analysis, at: Configuration) -> str:
    """Return what holds the structure."""
    mechanisms = found.n_mechanisms
    held = (
        f"; they stiffen {f'all {mechanisms} mechanisms' if mechanisms > 1 else 'the only mechanism'}"
        if mechanisms
        else "; there is no mechanism"
    )
    if not at.tension_only.any():
        return f"no member needs to be in tension{held.replace('they stiffen', 'self-stresses stiffen')}"
    if not found.prestress.is_found:
        return f"the loads keep every cable in tension{held}"
    return f"self-stresses exist with every cable in tension{held}"


def _find_flaws(found: Analysis, at: Configuration) -> list[str]:
    """Return what is wrong at the present tensions of a structure that some prestress holds."""
    flaws = found.members.describe()
    if not found.is_balanced:
        return [*flaws, UNJUDGED]
    if found.stiffness.is_neutral or found.stiffness.is_unstable:
        modes = found.modes
        loose = 0 if modes is None else int((modes.frequency == 0.0).sum())
        which = (
            "a motion has" if modes is None or not loose else f"{loose} of {len(modes.frequency)} modes have"
        )
        none = ", which are zero" if found.largest_force <= at.force_floor else ""
        flaws.append(f"{which} no stiffness at the present tensions{none}")
    return flaws


def _find_warnings(found: Analysis, at: Configuration) -> tuple[str, ...]:
    """Return what a careful engineer would ask about, in sentences."""
    said = [found.rank.warning] if found.rank.warning else []
    contacts = at.problem.contacts
    if contacts is not None and (slips := contacts.bristles(at.position)[1]).any():
        feet = ", ".join(
            name for name, slip in zip(contacts.structure.contact_name, slips, strict=True) if slip
        )
        said.append(f"the feet {feet} are at the limit of friction, which holds them only across their slip")
    if at.is_absent.any():
        names = name_list(at.manifest.member_name[e] for e in at.is_absent.nonzero()[0])
        said.append(f"slack, without length and left out of all tensions: {names}")
    if len(found.parts) > 1:
        said.append(describe_pieces([part[0] for part in found.parts]))
    if found.load_note:
        said.append(f"{found.load_note}; the prestress is that without loads")
    said += [*found.members.describe(), *_describe_limits(found, at)]
    if not found.is_balanced:
        said.append(
            f"the present forces are not in balance: the largest residual is {found.residual:.3g} N, the "
            f"largest member force {found.largest_force:.3g} N"
        )
    return tuple(said)


def _describe_limits(found: Analysis, at: Configuration) -> Iterator[str]:
    """Clearance between bars, and the least stiffness."""
    limits, distance = at.structure.limits, found.bar_distance
    if distance is not None and distance.min(initial=math.inf) < limits.clearance:
        pair = int(distance.argmin())
        first, second = at.manifest.bar_pair[pair]
        yield (
            f"the bars {first} and {second} are {distance[pair]:.6g} m apart, allowed is at least "
            f"{limits.clearance:.6g} m"
        )
    if found.smallest_eigenvalue < limits.least_stiffness:
        yield (
            f"the smallest eigenvalue of the stiffness is {found.smallest_eigenvalue:.6g} N/m, allowed is at "
            f"least {limits.least_stiffness:.6g} N/m"
        )
