"""Short texts of results: `repr` of at most five lines, and a table with a picture in notebooks."""

import dataclasses
import importlib
from collections.abc import Sequence, Sized
from typing import Any, Protocol

import numpy as np

from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import UnknownNameError, suggest

Fact = tuple[str, str]  # what, and its value as text

SHOWN = 4  # facts below the first line of a repr
WIDTH = 100  # characters of a line
MAX_NAMES = 4
# Loaded when a notebook shows something: the run time does not depend on pictures.
NOTEBOOK = "tensegrity_codegen.report.notebook"


class Summarised:
    """A result whose `repr` has at most five lines, and which notebooks show as a table and a picture."""

    def headline(self) -> str:
        """Return the text of a `repr` behind the name of the class."""
        status = getattr(self, "status", "")
        return status if isinstance(status, str) else ""

    def facts(self) -> list[Fact]:
        """Return the facts of the result, the most important first; by default the fields of a dataclass."""
        fields: tuple[Any, ...] = dataclasses.fields(self) if dataclasses.is_dataclass(self) else ()
        names = [field.name for field in fields]
        return [(name, _describe(getattr(self, name))) for name in names if name != "status"]

    def __repr__(self) -> str:
        title = ": ".join(piece for piece in (type(self).__name__, self.headline()) if piece)
        facts = self.facts()
        lines = [f"{name}: {value}" for name, value in facts[:SHOWN]]
        if len(facts) > SHOWN:
            lines[-1] = "; ".join(f"{name}: {value}" for name, value in facts[SHOWN - 1 :])
        return "\n  ".join(_cut(" ".join(line.split())) for line in (title, *lines))

    def _repr_html_(self) -> str:
        html: str = importlib.import_module(NOTEBOOK).build_html(self)
        return html


def count_names(names: Sequence[str]) -> str:
    """Return a number of names and the first of them: "6 (b1, b2, b3, b4, ...)"."""
    if not names:
        return "0"
    ending = ", ..." if len(names) > MAX_NAMES else ""
    return f"{len(names)} ({', '.join(names[:MAX_NAMES])}{ending})"


def describe_count(count: int, word: str, plural: str = "") -> str:
    """Return a number of things in words: "1 bar", "3,000 bars"; plural: if it differs from word + "s"."""
    return f"{count:,} {word if count == 1 else plural or word + 's'}"


def describe_number(value: float | None, unit: str = "") -> str:
    """Return a number with its unit, "-" for None."""
    return "-" if value is None else f"{value:.6g} {unit}".rstrip()


def describe_range(values: Any, unit: str = "") -> str:
    """Return the smallest and the largest finite number: "0 to 23.4 N", or both at once: "23.4 N"."""
    array = np.asarray(values, dtype=float)
    array = array[np.isfinite(array)]
    if not array.size:
        return "-"
    ends = dict.fromkeys(f"{value:.6g}" for value in (array.min(), array.max()))
    return f"{' to '.join(ends)} {unit}".rstrip()


def _describe(value: Any) -> str:
    """Return a short text of the value of a field."""
    if isinstance(value, np.ndarray):
        return str(value[()]) if value.ndim == 0 else f"{value.dtype} {value.shape}"
    if isinstance(value, float | np.floating):
        return f"{value:.6g}"
    if isinstance(value, str | bool | int) or value is None:
        return str(value)
    if isinstance(value, tuple | list) and all(isinstance(entry, str) for entry in value):
        return count_names(list(value))
    if hasattr(value, "shape") and hasattr(value, "nnz"):
        return f"sparse {value.shape}, {value.nnz} non-zeros"
    if isinstance(value, Sized):
        return f"{type(value).__name__} of {len(value)}"
    return type(value).__name__


def _cut(line: str) -> str:
    return line if len(line) <= WIDTH else line[: WIDTH - 4] + " ..."


class _Named(Protocol):
    """A record of nodes with positions and members with tensions; `...` stands for samples and motions."""

    @property
    def node_name(self) -> tuple[str, ...]: ...
    @property
    def node_position(self) -> FloatArray: ...  # (..., n_nodes, 3) [m]
    @property
    def member_name(self) -> tuple[str, ...]: ...
    @property
    def member_tension(self) -> FloatArray: ...  # (..., n_members) [N]


class ByName:
    """Positions and tensions by name, for results with the arrays of all nodes and members."""

    def position(self: _Named, node: str) -> FloatArray:
        """Return the position of a node.

        Parameters
        ----------
        node : str
            Name of the node.

        Returns
        -------
        ndarray, shape (..., 3) [m]
            Its position, at every sample where the result has samples.

        Raises
        ------
        UnknownNameError
            No node has that name; the message has similar ones.
        """
        return self.node_position[..., find_row(node, self.node_name, "node"), :]

    def tension(self: _Named, member: str) -> FloatArray:
        """Return the tension of a member.

        Parameters
        ----------
        member : str
            Name of the member.

        Returns
        -------
        float or ndarray, shape (...) [N]
            Its tension, at every sample where the result has samples.

        Raises
        ------
        UnknownNameError
            No member has that name; the message has similar ones.
        """
        return self.member_tension[..., find_row(member, self.member_name, "member")]


def find_row(name: str, names: Sequence[str], what: str) -> int:
    """Return the index of a name; raises UnknownNameError, which has similar names, where it is unknown."""
    if isinstance(name, str) and name in names:
        return names.index(name)
    problem = f"no {what} has this name"
    allowed = f"the names of the {len(names)} {what}s" if names else f"there are no {what}s"
    raise UnknownNameError(problem, where=what, given=name, allowed=allowed, hint=suggest(name, names))
