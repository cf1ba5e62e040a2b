"""The part of its limits that each member uses, over a motion."""

import numpy as np

from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.limits import MEMBER_LIMITS
from tensegrity_codegen.structure.member_limits import MEMBER_CHECKS, check_members
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray

MOST = 1000.0  # of a use that is infinite, such as a tension where none is allowed


def compute_uses(
    subject: Structure | BodySystem, structure: Structure, position: FloatArray, tension: FloatArray
) -> FloatArray | None:
    """Return the largest part of a limit that each member uses; above 1 the limit is exceeded.

    Parameters
    ----------
    subject : Structure or BodySystem
        What has the limits.
    structure : Structure
        Its outline, whose first members are those of the subject.
    position : ndarray, shape (n_t, n_nodes, 3) [m]
        Positions.
    tension : ndarray, shape (n_t, n_members) [N]
        Tensions; NaN where unknown.

    Returns
    -------
    ndarray, shape (n_t, n_members), or None
        Uses, NaN for members without a limit or with an unknown tension; None where no member has a limit.
    """
    limits = subject.limits.for_members(subject.n_members)
    if not any(np.any(getattr(limits, name) != none) for name, none in MEMBER_LIMITS.items()):
        return None
    ends = structure.connectivity[: subject.n_members]
    place = position[:, ends]
    length = np.linalg.norm(place[:, :, 0] - place[:, :, 1], axis=2)
    use = check_members(subject, tension[:, : subject.n_members], length).use
    result = np.full(tension.shape, np.nan)
    result[:, : subject.n_members] = np.fmax.reduce([use[name] for name in MEMBER_CHECKS])
    limited: FloatArray = np.minimum(result, MOST)
    return limited
