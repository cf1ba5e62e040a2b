"""Words of the codes of statuses."""

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.analyses.cases.statuses import STATUSES


def decode_statuses(codes: NDArray[np.int8]) -> tuple[str, ...]:
    """Return the words of codes (count,)."""
    return tuple(STATUSES[code] for code in codes)
