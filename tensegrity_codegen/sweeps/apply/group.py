"""The cases that one library serves, and the arguments that it takes for them."""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.request import ModelRequest


@dataclass(frozen=True)
class AppliedCases:
    """What a library takes for some cases, and which cases are no scene.

    Attributes
    ----------
    arguments : dict of str to ndarray, shape (n_cases, ...)
        Arguments that differ from case to case, by name: ``"coordinate"`` and ``"velocity"`` at the start,
        run-time parameters, ``"input"``. Other arguments have the nominal values of the library.
    messages : tuple of str, length n_cases
        "" for a good case; else why the values of the case are no scene (status ``bad_input``). The rows of
        such cases in `arguments` are NaN.
    """

    arguments: dict[str, FloatArray]
    messages: tuple[str, ...]

    @property
    def good(self) -> NDArray[np.bool_]:
        """(n_cases,): which cases are scenes."""
        return np.array([not text for text in self.messages], dtype=np.bool_)


class Mapper(Protocol):
    """A picklable function from the values of cases to arguments."""

    def __call__(self, values: FloatArray) -> AppliedCases:
        """Return what the library takes for cases with these values, (n_cases, n_keys)."""
        ...


@dataclass(frozen=True, eq=False)
class CaseGroup:
    """The cases that one library serves.

    Attributes
    ----------
    number : int
        Place among the groups of the plan, from 0.
    hash : str
        Hash of the structure without what varies, and of the request: equal groups, equal libraries.
    structure : Structure or BodySystem
        The structure of the first good case of the group, from which the library is built.
    request : ModelRequest
        The request of the scene, with the run-time parameters that the keys need; without what operations
        need, which `Operation.needs` adds.
    rows : range or ndarray of int
        Numbers of its cases, ascending.
    mapper : Mapper
        From values to arguments.
    """

    number: int
    hash: str
    structure: Subject
    request: ModelRequest
    rows: range | NDArray[np.int64]
    mapper: Mapper = field(repr=False)

    def arguments(self, values: FloatArray) -> AppliedCases:
        """Return what the library takes for cases of this group.

        Parameters
        ----------
        values : ndarray, shape (n_cases, n_keys)
            Values of the cases, from `Cases.values` or `Cases.select`.

        Returns
        -------
        AppliedCases
            Arguments by name, and messages of the cases that are no scene.
        """
        return self.mapper(values)

    def rows_between(self, first: int, last: int) -> NDArray[np.int64]:
        """Return the numbers of its cases from first to last - 1."""
        if isinstance(self.rows, range):
            return np.arange(max(first, self.rows.start), min(last, self.rows.stop), dtype=np.int64)
        start, stop = np.searchsorted(self.rows, [first, last])
        return self.rows[start:stop]
