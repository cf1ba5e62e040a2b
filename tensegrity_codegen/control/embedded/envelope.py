"""The lower half of a symmetric matrix, row by row from the first entry of each row to the diagonal."""

from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.system.arrays import IntArray
from tensegrity_codegen.tables.manifest import FunctionSpec


@dataclass(frozen=True)
class Envelope:
    """Where a matrix is stored.

    Attributes
    ----------
    first : ndarray of int, shape (n,)
        First column of each row.
    row : ndarray of int, shape (n,)
        Place of the first entry of each row.
    place : ndarray of int, shape (n_entries,)
        Place of each entry that the model computes, -1 for one of the upper half.
    size : int
        Number of stored entries.
    """

    first: IntArray
    row: IntArray
    place: IntArray
    size: int


def find_envelope(spec: FunctionSpec) -> Envelope:
    """Return the envelope of a symmetric matrix that a model computes, sparse or dense."""
    n = spec.shape[0]
    if spec.pattern is not None:
        rows = spec.pattern.row.astype(np.int64)
        columns = np.repeat(np.arange(n), np.diff(spec.pattern.column_start))
    else:
        rows, columns = (part.ravel() for part in np.indices((n, n)))
    first = np.arange(n)
    lower = rows >= columns
    np.minimum.at(first, rows[lower], columns[lower])
    width = np.arange(n) - first + 1
    row = np.concatenate([[0], np.cumsum(width)[:-1]])
    place = np.where(lower, row[rows] + columns - first[rows], -1)
    return Envelope(first, row, place, int(width.sum()))
