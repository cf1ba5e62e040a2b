"""The interface of operations of a sweep: needs of a library, results, how a chunk is computed."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.analyses.cases.quantities import CaseArguments, Outcomes, read_case_arguments
from tensegrity_codegen.analyses.cases.statuses import is_good
from tensegrity_codegen.pipeline.analyses import Needs
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.request import ModelRequest


@dataclass(frozen=True)
class Output:
    """One array of results; its first axis, the cases, is not counted.

    name: of the array in stored results: letters, digits and underscores.
    dims: names of the axes, such as ``("time", "member")``.
    shape: sizes of the axes.
    dtype: ``"float64"``, ``"float32"`` or ``"int32"``.
    unit: SI unit; ``"1"`` for numbers without one.
    sentence: what it is.
    coordinates: labels of axes, names or numbers, by the name of the axis; an axis without labels has none.
    expression: the text that was asked for, where it is not the name.
    """

    name: str
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: str
    unit: str
    sentence: str
    coordinates: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)
    expression: str = ""

    def full_of_nan(self, count: int) -> NDArray[Any]:
        """Return the array of `count` cases that all failed: NAN, or -1 for whole numbers."""
        dtype = np.dtype(self.dtype)
        return np.full((count, *self.shape), np.nan if dtype.kind == "f" else -1, dtype=dtype)


@dataclass(frozen=True, eq=False)
class TaskResult:
    """Results of a chunk of cases.

    arrays: by the names of outputs, each (count, ...); rows of cases that failed are NAN (-1 in whole
        numbers).
    status (count,): codes of ``analyses.cases.statuses``.
    messages: a sentence for each case; empty where there is nothing to say.
    """

    arrays: Mapping[str, NDArray[Any]]
    status: NDArray[np.int8]
    messages: tuple[str, ...]

    @property
    def is_good(self) -> NDArray[np.bool_]:
        """Whether the results of each case are there, (count,)."""
        return is_good(self.status)


def build_result(
    arrays: Mapping[str, NDArray[Any]], status: NDArray[np.int8], messages: Iterable[str]
) -> TaskResult:
    """Return the result of a chunk, rows of cases that failed being NAN, -1 in whole numbers."""
    is_bad = ~is_good(status)
    kept = dict(arrays)
    if is_bad.any():
        for name, array in arrays.items():
            kept[name] = array.copy()
            kept[name][is_bad] = np.nan if array.dtype.kind == "f" else -1
    return TaskResult(kept, status, tuple(messages))


@dataclass(frozen=True)
class Option:
    """What is said of an option of an operation, in the annotation of its field.

    help: what it is, for the command line, where it is an option too.
    flag: name of the option on the command line and the value that it stands for, where it takes no value.
    in_verb: whether the verb of the operation's name has it too.
    verb_default: what that verb needs stated where this option is not, since its own default is another.
    name, kind: name and type of the field, which `AnalysisRecord.list_options` fills in.
    """

    help: str
    flag: tuple[str, Any] | None = None
    in_verb: bool = True
    verb_default: Any = None
    name: str = ""
    kind: type = str

    @property
    def argument(self) -> str:
        """Its argument of the command line: its own name, or that of its flag."""
        return self.flag[0] if self.flag else self.name


@dataclass(frozen=True)
class AnalysisRecord(ABC):
    """What is done for every case; the same object serves all cases, and processes hand it on by pickling.

    An operation is one module of `analyses/`, which defines one as its `ANALYSIS`. Its fields with
    an `Option` in their annotations are its options in Python and on the command line.

    keep: what is kept of each case; empty for the usual results of the operation.
    """

    keep: tuple[str, ...] = ()

    name: ClassVar[str]  # as in `--do NAME`
    success_phrase: ClassVar[str] = "are ok"  # what is said of good cases, as in "12 of 12 cases converged"
    has_verb: ClassVar[bool] = True  # whether the command line has a verb of this name, for one case
    needs_scene: ClassVar[bool] = False  # whether a case needs the unchanged scene too, see `prepared`

    @property
    def analyses(self) -> tuple[str, ...]:
        """Names of the analyses that are done, as of `compile_scene`."""
        return (self.name,)

    @property
    def not_checked(self) -> str:
        """What the verb says of one case and the sweep does not compute, and what to keep for it; or ""."""
        return ""

    def prepared(self, scene: str | Path | Mapping[str, Any] | Scene) -> "AnalysisRecord":
        """Return the operation with what it makes of the unchanged scene once, before all cases."""
        return self

    @abstractmethod
    def needs(self, structure: Subject, request: ModelRequest) -> Needs:
        """Return what the operation needs of a library besides what the scene requests.

        Raises InvalidValueError, UnknownNameError: something that cannot be kept; FormulationError: the
        structure or its formulation does not serve the operation.
        """

    @abstractmethod
    def outputs(self, manifest: Manifest) -> tuple[Output, ...]:
        """Return what is kept of each case, in the order of the stored arrays; raises as `needs`."""

    @abstractmethod
    def compute(
        self, model: CompiledModel, case_arguments: CaseArguments, outcomes: Outcomes, threads: int
    ) -> Mapping[str, NDArray[Any]]:
        """Return the arrays of a chunk of cases by the names of outputs, and note how each case ended."""

    def run(
        self, model: CompiledModel, arguments: Mapping[str, Any], count: int, *, threads: int = 1
    ) -> TaskResult:
        """Compute a chunk of cases.

        model: a library that has what `needs` returns.
        arguments: ``"coordinate"``, ``"velocity"``, run-time parameters and inputs by name, each with a
            leading axis (count,), or without it where all cases share a value; by default those of the scene.
        count: number of cases.
        threads: number of threads.
        Returns one row a case; a case that fails does not affect the others. Raises InvalidValueError,
        UnknownNameError: an argument that no case could have: an unknown name, a wrong shape; LibraryError,
        FormulationError: the library does not serve the operation.
        """
        case_arguments = read_case_arguments(model, arguments, count)
        outcomes = case_arguments.outcomes()
        arrays = self.compute(model, case_arguments, outcomes, threads)
        return build_result(arrays, outcomes.codes, outcomes.messages)

    def describe(self) -> dict[str, Any]:
        """Return name and options, JSON-ready; two operations with the same description do the same."""
        return {"do": self.name, "keep": list(self.keep), **self.options}

    @property
    def options(self) -> dict[str, Any]:
        """Values of its options by name."""
        return {item.name: getattr(self, item.name) for item in self.list_options()}

    @classmethod
    def list_options(cls) -> tuple[Option, ...]:
        """Return its options in their order."""
        hints = get_type_hints(cls, include_extras=True)
        found = []
        for item in fields(cls):
            stated = [part for part in get_args(hints[item.name]) if isinstance(part, Option)]
            if stated:
                kinds = get_args(get_args(hints[item.name])[0]) or get_args(hints[item.name])
                kind = next((part for part in (int, float) if part in kinds), str)
                found.append(replace(stated[0], name=item.name, kind=kind))
        return tuple(found)
