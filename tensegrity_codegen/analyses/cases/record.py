"""Base classes of analyses, their options and results.

`SceneAnalysis`: an analysis of one scene, from which the command line makes a verb; it returns a `Result`.
`CaseAnalysis`: an analysis of many cases, of which a sweep computes chunks; it returns a `TaskResult`.
Most analyses are both. Each is the `ANALYSIS` of a module of `analyses/`.
"""

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

SAME: Any = object()  # the verb has the default of the sweep
COORDINATE = "coordinate"
LIMIT_USE = "limit_use"
LIMIT_USE_RESULT = (
    "float64",
    "1",
    "Largest part that a member uses of its limits, of Euler's load and of 1 % strain; above 1: exceeded.",
)


@dataclass(frozen=True)
class Output:
    """Description of one array of results; dims and shape omit its first axis, the cases.

    name: of the array in stored results: letters, digits and underscores.
    dims: names of the axes, such as ``("time", "member")``.
    shape: sizes of the axes.
    dtype: ``"float64"``, ``"float32"`` or ``"int32"``.
    unit: SI unit; ``"1"`` for numbers without one.
    sentence: the meaning of its numbers.
    coordinates: labels of axes, names or numbers, by the name of the axis; an axis without labels has none.
    expression: the text of `keep`, if it differs from the name.
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
    messages: a sentence for each case; empty if nothing is unusual.
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
    """Return the result of a chunk, with NAN, or -1 in whole numbers, in the rows of failed cases."""
    import numpy as np

    from tensegrity_codegen.analyses.cases.statuses import is_good

    is_bad = ~is_good(status)
    stored = dict(arrays)
    if is_bad.any():
        for name, array in arrays.items():
            stored[name] = array.copy()
            stored[name][is_bad] = np.nan if array.dtype.kind == "f" else -1
    return TaskResult(stored, status, tuple(messages))


@dataclass(frozen=True)
class Option:
    """An option of an analysis: metadata in the annotation of a field of its record.

    help: description in the command line, the sweep and the documents.
    flag: of an option without a value: its name, and the value that it gives to the field.
    argument_name: its name on the command line and in sweeps, if it differs from that of the field.
    parameter: its name in messages of the library, if it differs from that of the field.
    minimum: smallest value of a whole number.
    in_verb, in_sweep: whether the verb of the analysis, and the sweep, have it.
    verb_default: default in the verb, if it differs from that in sweeps; `...`: it must be stated.
    name, type, default: of the field; `AnalysisRecord.list_options` fills them in.
    """

    help: str
    flag: tuple[str, Any] | None = None
    argument_name: str = ""
    parameter: str = ""
    minimum: int | None = None
    in_verb: bool = True
    in_sweep: bool = True
    verb_default: Any = SAME
    name: str = ""
    type: Any = str
    default: Any = None

    @property
    def argument(self) -> str:
        """Its name on the command line: of its flag, the stated one, or that of the field."""
        return self.flag[0] if self.flag else self.argument_name or self.name

    @property
    def kind(self) -> type:
        """The type, int, float or str, of a value that is read from text."""
        types = get_args(self.type) if get_origin(self.type) in (Union, UnionType) else (self.type,)
        return next((kind for kind in (str, int, float) if kind in types), str)


@dataclass(frozen=True)
class ResultFile:
    """An option of a verb that names a file to write.

    name: of the option; endings: those allowed, such as ``".toml"``.
    draws: whether the file contains pictures; may_be_scene: whether it may replace the scene.
    key: of its path in the JSON; None: the name of the option; empty: `Result.as_dict` contains the path.
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
    """The answer of an analysis for one scene; the verb prints it, or writes its JSON."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences about unexpected properties of the answer."""
        return ()

    @property
    def failure(self) -> str:
        """The sentence that the verb prints last if the analysis failed; else empty."""
        return ""

    @property
    def is_good(self) -> bool:
        """Whether the analysis succeeded: exit code 0, else 3."""
        return not self.failure

    @property
    def is_beyond(self) -> bool:
        """Whether members exceed limits or buckle, which `--strict` refuses."""
        return False

    def write(self, name: str, path: "Path", *, overwrite: bool) -> bool:
        """Write the file of the option `name` before the answer is printed; return whether it exists."""
        raise TypeError(f"{type(self).__name__} has no file {name!r}")

    @abstractmethod
    def as_dict(self) -> dict[str, Any]:
        """Return the answer, JSON-ready, with its status; the verb adds the paths of files."""

    @abstractmethod
    def describe(self) -> list[Any]:
        """Return the answer as text: sentences and tables."""


@dataclass(frozen=True)
class AnalysisRecord(ABC):
    """An analysis: a record of its options, the fields with an `Option` in their annotations.

    The options are the same in Python, in the verb and in the sweep.
    """

    name: ClassVar[str]  # of the verb, and as in `--do NAME`

    @classmethod
    def list_options(cls) -> tuple[Option, ...]:
        """Return the options in the order of their fields."""
        hints = get_type_hints(cls, include_extras=True)
        options = []
        for option_field in fields(cls):
            name = option_field.name
            # Annotated[type, Option(...)]
            type_, *metadata = get_args(hints[name]) or (None,)
            for option in metadata:
                if isinstance(option, Option):
                    parameter = option.parameter or name
                    default = option_field.default
                    options.append(
                        replace(option, parameter=parameter, name=name, type=type_, default=default)
                    )
        return tuple(options)


@dataclass(frozen=True)
class SceneAnalysis(AnalysisRecord):
    """An analysis of one scene, with a verb in the command line; its docstring is the help of the verb."""

    verb_order: ClassVar[int]  # the verbs of `--help` are sorted by it
    takes: ClassVar[tuple[str, ...]] = ()  # further options of the verb: "load", "input", "flags", "strict"
    files: ClassVar[tuple[ResultFile, ...]] = ()  # that the verb can write

    @property
    def settles(self) -> bool:
        """Whether the analysis begins with the search for the equilibrium."""
        return True

    def check_files(self, paths: "Mapping[str, Any]") -> None:
        """Raise InvalidValueError for options and files that exclude or need each other.

        paths: of the files to write, by their options; a list for an option that may be repeated.
        """
        return

    def prepare_structure(self, structure: "Subject") -> "Subject":
        """Return the structure with the inputs that options add, such as further actuators."""
        return structure

    @abstractmethod
    def solve(self, case: "SceneCase") -> Result:
        """Return the answer for one scene."""


@dataclass(frozen=True)
class CaseAnalysis(AnalysisRecord):
    """An analysis of many cases: one record serves all of them, and processes exchange it by pickling.

    keep: names or expressions of the results that a sweep stores for each case; empty: the default ones.
    """

    keep: tuple[str, ...] = ()

    success_phrase: ClassVar[str] = "are ok"  # the end of a sentence such as "12 of 12 cases converged"
    needs_scene: ClassVar[bool] = False  # whether a case needs the unchanged scene too, see `prepared`

    @property
    def analyses(self) -> tuple[str, ...]:
        """Names of the functions that the library must serve, as in `compile_scene(for_=...)`."""
        return (self.name,)

    @property
    def not_checked(self) -> str:
        """A sentence about a check that the verb makes and the sweep omits, and how to request it; or ""."""
        return ""

    def prepared(self, scene: "str | Path | Mapping[str, Any] | Scene") -> "CaseAnalysis":
        """Return the operation with its preparation from the unchanged scene, done once before all cases."""
        return self

    def check_keep(self, results: Iterable[str]) -> None:
        """Raise UnknownNameError for an unknown result in `keep`, DuplicateNameError for a repeated one."""
        for name in self.keep:
            check_choice(name, results, f"result of {self.name}", f"keep {name!r}")
        if len(set(self.keep)) < len(self.keep):
            raise DuplicateNameError("kept twice", where="keep", given=", ".join(self.keep))

    @abstractmethod
    def needs(self, structure: "Subject", request: "ModelRequest") -> "Needs":
        """Return the functions that the operation calls, to be added to those that the scene requests.

        Raises InvalidValueError, UnknownNameError: an invalid entry of `keep`; FormulationError: the
        structure or its formulation does not serve the operation.
        """

    @abstractmethod
    def outputs(self, manifest: "Manifest") -> tuple[Output, ...]:
        """Return descriptions of the stored arrays, in their order; raises as `needs`."""

    @abstractmethod
    def compute(
        self, model: "CompiledModel", case_arguments: "CaseArguments", outcomes: "Outcomes", threads: int
    ) -> "Mapping[str, NDArray[Any]]":
        """Return the arrays (count, ...) of a chunk by the names of outputs; mark failures in `outcomes`."""

    def run(
        self, model: "CompiledModel", arguments: Mapping[str, Any], count: int, *, threads: int = 1
    ) -> TaskResult:
        """Compute a chunk of cases.

        model: a library with the functions that `needs` returns.
        arguments: ``"coordinate"``, ``"velocity"``, run-time parameters and inputs by name, each with a
            leading axis (count,), or without it if all cases share a value; by default those of the scene.
        count: number of cases.
        threads: number of threads.
        Returns one row for each case; a case that fails does not affect the others. Raises InvalidValueError,
        UnknownNameError: an argument with an unknown name or a wrong shape; LibraryError, FormulationError:
        the library does not serve the operation.
        """
        from tensegrity_codegen.analyses.cases.quantities import read_case_arguments

        case_arguments = read_case_arguments(model, arguments, count)
        outcomes = case_arguments.outcomes()
        arrays = self.compute(model, case_arguments, outcomes, threads)
        return build_result(arrays, outcomes.codes, outcomes.messages)

    def describe(self) -> dict[str, Any]:
        """Return name and options, JSON-ready; operations with equal descriptions give equal results."""
        return {"do": self.name, "keep": list(self.keep), **self.options}

    @property
    def options(self) -> dict[str, Any]:
        """Values of its options in sweeps by name."""
        return {option.name: getattr(self, option.name) for option in self.list_options() if option.in_sweep}

    @classmethod
    def list_sweep_options(cls) -> tuple[Option, ...]:
        """Return the options that a sweep has."""
        return tuple(option for option in cls.list_options() if option.in_sweep)
