"""Statuses of cases: the words of all operations, and the numbers that stand for them in stored results."""

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.system.errors import check_choice

StatusArray = NDArray[np.int8]

# A word's place is its code in stored results: words are only ever added, at the end.
STATUSES = (
    "ok",
    "converged",
    "rounding_limited",
    "non_finite_input",
    "non_finite_result",
    "unstable",
    "no_equilibrium",
    "stalled",
    "iteration_limit",
    "work_limit",
    "at_pole",
    "not_finite",
    "inaccurate",
    "not_converged",
    "too_many_events",
    "bad_input",  # the values of this case make no scene; the message says why
    "set_aside",  # not computed: the task of this case ended the processes that ran it
    "not_solved",  # of a closed loop: a tenth of the commands are not those of a solved program
)

NOT_COMPUTED = "not_computed"  # the word of cases whose task is not finished

# The words of cases whose results are there; rows of all others are NAN.
GOOD = ("ok", "converged", "rounding_limited")

_CODE = {status: code for code, status in enumerate(STATUSES)}
_IS_GOOD = np.array([status in GOOD for status in STATUSES])


def encode_status(status: str) -> int:
    """Return the code of one word; raises UnknownNameError for a word that no operation uses."""
    if status not in _CODE:
        check_choice(status, STATUSES, "status", "status")
    return _CODE[status]


def is_good(codes: StatusArray) -> NDArray[np.bool_]:
    """Return whether each code stands for a case whose results are there."""
    good: NDArray[np.bool_] = _IS_GOOD[codes]
    return good
