"""The interface of operations of a sweep: needs of a library, results, how a chunk is computed."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from types import UnionType
from typing import TYPE_CHECKING, Any, ClassVar, Union, get_args, get_origin, get_type_hints

from tensegrity_codegen.system.errors import DuplicateNameError, check_choice

if TYPE_CHECKING:  # options are read without NumPy and without the libraries of the analyses
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from tensegrity_codegen.analyses.cases.quantities import CaseArguments, Outcomes
    from tensegrity_codegen.analyses.cases.scene_case import SceneCase
    from tensegrity_codegen.pipeline.analyses import Needs
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.scene.schema.schema import Scene
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.manifest import Manifest
    from tensegrity_codegen.tables.request import ModelRequest

SAME: Any = object()  # a default that is no other
COORDINATE = "coordinate"
LIMIT_USE = "limit_use"
LIMIT_USE_RESULT = (
    "float64",
    "1",
    "Largest part that a member uses of its limits, of Euler's load and of 1 % strain; above 1: exceeded.",
)


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

    def full_of_nan(self, count: int) -> "NDArray[Any]":
        """Return the array of `count` cases that all failed: NAN, or -1 for whole numbers."""
        import numpy as np

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

    arrays: "Mapping[str, NDArray[Any]]"
    status: "NDArray[np.int8]"
    messages: tuple[str, ...]

    @property
    def is_good(self) -> "NDArray[np.bool_]":
        """Whether the results of each case are there, (count,)."""
        from tensegrity_codegen.analyses.cases.statuses import is_good

        return is_good(self.status)


def build_result(
    arrays: "Mapping[str, NDArray[Any]]", status: "NDArray[np.int8]", messages: Iterable[str]
) -> TaskResult:
    """Return the result of a chunk, rows of cases that failed being NAN, -1 in whole numbers."""
    import numpy as np

    from tensegrity_codegen.analyses.cases.statuses import is_good

    is_bad = ~is_good(status)
    kept = dict(arrays)
    if is_bad.any():
        for name, array in arrays.items():
            kept[name] = array.copy()
            kept[name][is_bad] = np.nan if array.dtype.kind == "f" else -1
    return TaskResult(kept, status, tuple(messages))


@dataclass(frozen=True)
class Option:
    """An option of an analysis, in the annotation of its field.

    help: what it is, in the command line, the sweep and the documents.
    flag: of an option without a value: its name in a sweep, and the value of the field that it stands for.
    word: its name on the command line and in sweeps, where it is not that of the field.
    parameter: its name in messages of the library, where it is not that of the field.
    least: smallest value of a whole number.
    in_verb, in_sweep: whether the verb of the analysis, and the sweep, have it.
    verb_default: default in the verb, where it is another than in sweeps; `...`: it must be stated.
    name, type, default: of the field, which `AnalysisRecord.list_options` fills in.
    """

    help: str
    flag: tuple[str, Any] | None = None
    word: str = ""
    parameter: str = ""
    least: int | None = None
    in_verb: bool = True
    in_sweep: bool = True
    verb_default: Any = SAME
    name: str = ""
    type: Any = str
    default: Any = None

    @property
    def argument(self) -> str:
        """Its argument of the command line: its own name, that of its flag, or its word."""
        return self.flag[0] if self.flag else self.word or self.name

    @property
    def kind(self) -> type:
        """Its type, int, float or str, of values that are read from a text."""
        types = get_args(self.type) if get_origin(self.type) in (Union, UnionType) else (self.type,)
        return next((kind for kind in (int, float) if kind in types), str)


@dataclass(frozen=True)
class ResultFile:
    """A file that the verb of an analysis can write.

    name: of the option; endings: allowed, such as ``".toml"``.
    draws: whether pictures are drawn in it; may_be_scene: whether it may replace the scene.
    key: of its path in the JSON; None: its name; empty: the result names it elsewhere.
    is_list: whether the option may be repeated; its value is a list then.
    """

    name: str
    endings: tuple[str, ...]
    help: str
    draws: bool = False
    may_be_scene: bool = False
    key: str | None = None
    is_list: bool = False


class Result(ABC):
    """The answer for one case: a record with everything that is known of it."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences about what may be unexpected."""
        return ()

    @property
    def failure(self) -> str:
        """Sentence that is said after an answer that is not what was asked for; else empty."""
        return ""

    @property
    def is_good(self) -> bool:
        """Whether the answer is what was asked for: exit code 0, else 3."""
        return not self.failure

    @property
    def is_beyond(self) -> bool:
        """Whether members exceed limits or buckle, which `--strict` refuses."""
        return False

    def write(self, name: str, path: "Path", *, overwrite: bool) -> bool:
        """Write the file of an option, before the answer is printed; return whether it was written."""
        raise NotImplementedError(name)

    @abstractmethod
    def as_dict(self) -> dict[str, Any]:
        """Return the answer, JSON-ready, the status among it; paths of files are added."""

    @abstractmethod
    def describe(self) -> list[Any]:
        """Return the answer for a reader: sentences and tables."""


@dataclass(frozen=True)
class AnalysisRecord(ABC):
    """An analysis: its options, and its answer for one scene.

    One module of `analyses/` defines each as its `ANALYSIS`. Its fields with an `Option` in their annotations
    are its options by every door: Python, the verb, the sweep. The docstring of a record with a verb is the
    help of the verb.
    """

    name: ClassVar[str]  # of the verb, and as in `--do NAME`
    has_verb: ClassVar[bool] = True  # whether the command line has a verb of this name, for one case
    # Of records whose verb is made from them: its place in `--help`, what it takes besides the options, what
    # it writes.
    verb_order: ClassVar[int | None] = None
    takes: ClassVar[tuple[str, ...]] = ()  # of "load", "input", "flags", "strict"
    files: ClassVar[tuple[ResultFile, ...]] = ()

    @property
    def settles(self) -> bool:
        """Whether the equilibrium is looked for first."""
        return True

    def check_files(self, paths: "Mapping[str, Any]") -> None:
        """Raise InvalidValueError where options and files do not belong together.

        paths: of the files that are asked for, by their options; a list where an option may be repeated.
        """
        return

    def prepare_structure(self, structure: "Subject") -> "Subject":
        """Return the structure whose inputs the command states, such as one with further actuators."""
        return structure

    def solve(self, case: "SceneCase") -> Result:
        """Return the answer for one scene; raises what its steps raise."""
        raise NotImplementedError(self.name)

    @classmethod
    def list_options(cls) -> tuple[Option, ...]:
        """Return its options in their order."""
        hints = get_type_hints(cls, include_extras=True)
        options = []
        for item in fields(cls):
            stated = [part for part in get_args(hints[item.name]) if isinstance(part, Option)]
            if stated:
                type_ = get_args(hints[item.name])[0]
                options.append(
                    replace(
                        stated[0],
                        parameter=stated[0].parameter or item.name,
                        name=item.name,
                        type=type_,
                        default=item.default,
                    )
                )
        return tuple(options)


@dataclass(frozen=True)
class CaseAnalysis(AnalysisRecord):
    """An analysis that serves many cases too: one object serves all, and processes hand it on by pickling.

    keep: what is kept of each case of a sweep; empty for the usual results.
    """

    keep: tuple[str, ...] = ()

    success_phrase: ClassVar[str] = "are ok"  # what is said of good cases, as in "12 of 12 cases converged"
    needs_scene: ClassVar[bool] = False  # whether a case needs the unchanged scene too, see `prepared`

    @property
    def analyses(self) -> tuple[str, ...]:
        """Names of the analyses that are done, as of `compile_scene`."""
        return (self.name,)

    @property
    def not_checked(self) -> str:
        """What the verb says of one case and the sweep does not compute, and what to keep for it; or ""."""
        return ""

    def prepared(self, scene: "str | Path | Mapping[str, Any] | Scene") -> "CaseAnalysis":
        """Return the operation with what it makes of the unchanged scene once, before all cases."""
        return self

    def check_keep(self, results: Iterable[str]) -> None:
        """Raise UnknownNameError or DuplicateNameError where something else, or one thing twice, is kept."""
        for name in self.keep:
            check_choice(name, results, f"result of {self.name}", f"keep {name!r}")
        if len(set(self.keep)) < len(self.keep):
            raise DuplicateNameError("kept twice", where="keep", given=", ".join(self.keep))

    @abstractmethod
    def needs(self, structure: "Subject", request: "ModelRequest") -> "Needs":
        """Return what the operation needs of a library besides what the scene requests.

        Raises InvalidValueError, UnknownNameError: something that cannot be kept; FormulationError: the
        structure or its formulation does not serve the operation.
        """

    @abstractmethod
    def outputs(self, manifest: "Manifest") -> tuple[Output, ...]:
        """Return what is kept of each case, in the order of the stored arrays; raises as `needs`."""

    @abstractmethod
    def compute(
        self, model: "CompiledModel", case_arguments: "CaseArguments", outcomes: "Outcomes", threads: int
    ) -> "Mapping[str, NDArray[Any]]":
        """Return the arrays of a chunk of cases by the names of outputs, and note how each case ended."""

    def run(
        self, model: "CompiledModel", arguments: Mapping[str, Any], count: int, *, threads: int = 1
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
        from tensegrity_codegen.analyses.cases.quantities import read_case_arguments

        case_arguments = read_case_arguments(model, arguments, count)
        outcomes = case_arguments.outcomes()
        arrays = self.compute(model, case_arguments, outcomes, threads)
        return build_result(arrays, outcomes.codes, outcomes.messages)

    def describe(self) -> dict[str, Any]:
        """Return name and options, JSON-ready; two operations with the same description do the same."""
        return {"do": self.name, "keep": list(self.keep), **self.options}

    @property
    def options(self) -> dict[str, Any]:
        """Values of its options in sweeps by name."""
        return {item.name: getattr(self, item.name) for item in self.list_options() if item.in_sweep}

    @classmethod
    def list_sweep_options(cls) -> tuple[Option, ...]:
        """Return the options that a sweep has."""
        return tuple(item for item in cls.list_options() if item.in_sweep)
