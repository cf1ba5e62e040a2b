"""Errors: one base class, one subclass a fault.

Every message names the given value, the allowed ones, their location, and a remedy. The class attribute
`exit_code` is the code that the command line ends with (2 bad input, 3 no convergence or unstable).
"""

import difflib
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar


class TensegrityError(Exception):
    """Base class of all errors that this package raises on purpose.

    Parameters
    ----------
    problem : str
        One sentence.
    where : str
        File and key.
    given : object
        The wrong value.
    allowed : str
        The values that are allowed.
    hint : str
        A remedy to try.

    Examples
    --------
    >>> from tensegrity_codegen import TensegrityError, load_scene
    >>> try:
    ...     load_scene("nowhere.toml")
    ... except TensegrityError as error:
    ...     print(type(error).__name__, error.exit_code)
    SceneError 2
    """

    exit_code: ClassVar[int] = 2

    def __init__(
        self, problem: str, *, where: str = "", given: Any = None, allowed: str = "", hint: str = ""
    ) -> None:
        self.problem, self.where, self.given, self.allowed, self.hint = problem, where, given, allowed, hint
        super().__init__(problem)

    def __str__(self) -> str:
        lines = [f"{self.where}: {self.problem}" if self.where else self.problem]
        if self.given is not None:
            lines.append(f"  given:   {shorten(self.given)}")
        if self.allowed:
            lines.append(f"  allowed: {self.allowed}")
        if self.hint:
            lines.append(f"  try:     {self.hint}")
        return escape_controls("\n".join(lines))

    def as_dict(self) -> dict[str, Any]:
        """Return the error as one JSON-ready object."""
        given = None if self.given is None else shorten(self.given)
        return {
            "error": type(self).__name__,
            "problem": self.problem,
            "where": self.where,
            "given": given,
            "allowed": self.allowed,
            "hint": self.hint,
        }


class SceneError(TensegrityError):
    """A scene, or a file to import, that cannot be used."""


class SceneSyntaxError(SceneError):
    """A file that is not well-formed TOML, CSV or YAML, or too large to be a scene."""


class UnknownKeyError(SceneError):
    """A key that the schema does not have."""


class UnknownNameError(SceneError):
    """A reference to a node, member, class, group, quantity or method that does not exist."""


class DuplicateNameError(SceneError):
    """Two things under one name, or two members on one pair of nodes."""


class InvalidNameError(SceneError):
    """A name that is no C identifier."""


class InvalidValueError(SceneError):
    """A value outside its range or of the wrong type."""


class NonFiniteError(InvalidValueError):
    """A NaN or an infinity in place of a finite number."""


class StructureError(SceneError):
    """Values that are fine one by one but do not make a structure."""


class FormulationError(TensegrityError):
    """A request that the chosen formulation or emitter cannot serve.

    lacking: names of the quantities that another choice of them may serve, () if another one may serve the
    structure as a whole; None if no other choice helps.
    """

    lacking: tuple[str, ...] | None = None

    def unless_chosen_otherwise(self, *lacking: str) -> "FormulationError":
        """Return the error with the word that another formulation or emitter may serve this."""
        self.lacking = lacking
        return self


class OutputError(TensegrityError):
    """A file or folder that cannot be written."""


class UnsafeCacheError(TensegrityError):
    """A cache of compiled libraries that another user may have written to."""


class ClusterError(TensegrityError):
    """A scheduler or workers that cannot be reached, or that have other versions than this process."""


class MissingExtraError(TensegrityError):
    """An optional package that is needed here and not installed."""


class MissingSourceError(TensegrityError):
    """Source text of another project that is needed here and cannot be had, or has other content."""


class CompilerMissingError(TensegrityError):
    """No C compiler was found."""


class CompileError(TensegrityError):
    """The C compiler failed; `log` keeps all that it wrote."""

    def __init__(self, problem: str, *, log: str = "", where: str = "", hint: str = "") -> None:
        super().__init__(problem, where=where, hint=hint)
        self.log = log

    def __str__(self) -> str:
        return f"{super().__str__()}\n{self.log}".rstrip()

    def as_dict(self) -> dict[str, Any]:
        """Return the error and the compiler's log as one JSON-ready object."""
        return super().as_dict() | {"log": self.log}


class LibraryError(TensegrityError):
    """A compiled library that is missing, broken, or differs from its manifest."""


class AbiMismatchError(LibraryError):
    """A compiled library made for another version of the C interface."""


MOST_ROWS = 5  # of a table in the evidence that a text shows


class ConvergenceError(TensegrityError):
    """An iteration that did not reach its tolerance; `evidence` says how far it came."""

    exit_code: ClassVar[int] = 3

    def __init__(
        self, problem: str, *, evidence: Mapping[str, Any] | None = None, where: str = "", hint: str = ""
    ) -> None:
        super().__init__(problem, where=where, hint=hint)
        self.evidence = dict(evidence or {})

    def __str__(self) -> str:
        rows = []
        for key, value in self.evidence.items():
            more = len(value) - MOST_ROWS if isinstance(value, Mapping) else 0
            shown = dict(list(value.items())[:MOST_ROWS]) if more > 0 else value
            rows.append(f"  {key}: {shown}" + (f" and {more:,} more" if more > 0 else ""))
        return "\n".join([super().__str__(), *rows])

    def as_dict(self) -> dict[str, Any]:
        """Return the error and its evidence as one JSON-ready object."""
        return super().as_dict() | {"evidence": self.evidence}


class UnstableError(ConvergenceError):
    """A time integration or an equilibrium that is unstable."""


class SingularStiffnessError(ConvergenceError):
    """An equilibrium with a motion that nothing resists, where a regular stiffness is needed."""


class InfeasibleError(ConvergenceError):
    """An equilibrium or a motion that no taut tendons can hold; `evidence` says where, when and which."""


def check_choice(given: Any, known: Iterable[str], what: str, where: str) -> None:
    """Raise UnknownNameError for a word that is not one of those known; `what`: "method", for the message."""
    known = list(known)
    if not isinstance(given, str) or given not in known:
        problem, allowed = f"unknown {what}", ", ".join(known)
        raise UnknownNameError(problem, where=where, given=given, allowed=allowed, hint=suggest(given, known))


# Words of other programs for keys of a scene and for quantities, which are not spelled alike.
SYNONYMS = {
    "stiffness": ("spring_constant", "axial_stiffness", "tangent_stiffness"),
    "k": ("spring_constant",),
    "EA": ("axial_stiffness",),
    "length": ("rest_length", "member_length"),
    "l0": ("rest_length",),
    "tension": ("prestress", "member_tension"),
    "force": ("member_tension",),
    "stress": ("member_stress",),
    "energy": ("total_energy",),
    "pretension": ("prestress",),
    "fixed": ("anchored",),
    "type": ("kind",),
    "diameter": ("radius",),
    "weight": ("mass",),
    "xyz": ("position",),
}


def name_list(names: Iterable[str], most: int = 5) -> str:
    """Return the first few names and the number of the others: "a, b, c and 4 more"."""
    names = list(names)
    more = f" and {len(names) - most:,} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def suggest(given: Any, known: Iterable[str], *, most: int = 12) -> str:
    """Return a hint for an unknown word: the closest known ones, else the list, the nearest names first."""
    given, names = str(given)[:80], sorted(known)
    close = [name for name in SYNONYMS.get(given, ()) if name in names]
    close = close or difflib.get_close_matches(given, names, n=3, cutoff=0.6)
    if close:
        return "did you mean " + " or ".join(repr(name) for name in close) + "?"
    if len(names) > most:
        names.sort(key=lambda name: -difflib.SequenceMatcher(None, given, name).ratio())
    return f"known: {name_list(map(repr, names), most)}" if names else "none are defined"


# Control characters but newline and tab, and those that turn the direction of text, as Python writes them.
_CONTROLS = {code: f"\\x{code:02x}" for code in (*range(9), *range(11, 32), *range(127, 160))}
_CONTROLS |= {
    code: f"\\u{code:04x}" for code in (0x200E, 0x200F, *range(0x202A, 0x202F), *range(0x2066, 0x206A))
}


def escape_controls(text: str) -> str:
    """Return a text of which no part, such as a name from a file, can steer the terminal that shows it."""
    return text.translate(_CONTROLS)


def describe_reason(error: BaseException) -> str:
    """Return the message of the system or Python, without the number of the system's error."""
    return getattr(error, "strerror", None) or str(error) or type(error).__name__


def shorten(value: Any, most: int = 120) -> str:
    """Return `repr(value)` cut to a readable length."""
    text = repr(value)
    return text if len(text) <= most else text[: most - 1] + "…"
