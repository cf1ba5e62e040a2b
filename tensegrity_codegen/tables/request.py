"""The request for a structure: quantities, run-time parameters, formulation with its options, emitter,
precision, compile flags."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

from tensegrity_codegen.system.checks import check_instance, check_mapping, check_names, is_whole
from tensegrity_codegen.system.errors import (
    InvalidValueError,
    UnknownKeyError,
    UnknownNameError,
    check_choice,
    suggest,
)
from tensegrity_codegen.system.pickling import reduce_fields
from tensegrity_codegen.tables.formulations import FORMULATIONS

# How many evaluations a batch function can do side by side; 0: there are no batch functions.
BATCH_WIDTHS = (0, 2, 4, 8, 16, 32, 64)

# Interfaces that a library can offer besides its C functions.
# Fields of a request that are lists of names.
LISTS = ("quantities", "integrators", "solvers", "keep", "interfaces", "driven", "columns", "directions")

INTERFACES = ("casadi", "casadi_hessian", "acados")

CHECKS = ("finite", "none")  # of arguments and results of functions

AUTO_EVENTS = ("auto",)  # events of a request: all at which a force or its slope jumps, and a condition


def complete_options(
    formulation: str, options: Mapping[str, str], where: str = "model.options"
) -> dict[str, str]:
    """Return all options of a formulation, the omitted ones at their defaults."""
    options_of_formulation = FORMULATIONS[formulation].options if formulation in FORMULATIONS else {}
    for name, value in options.items():
        if name not in options_of_formulation:
            problem = f"formulation {formulation!r} has no such option"
            allowed, hint = (
                ", ".join(options_of_formulation) or "no options",
                suggest(name, options_of_formulation),
            )
            raise UnknownKeyError(problem, where=where, given=name, allowed=allowed, hint=hint)
        if value not in options_of_formulation[name]:
            problem, allowed = (
                "not one of the words that the option allows",
                ", ".join(options_of_formulation[name]),
            )
            hint = suggest(value, options_of_formulation[name])
            raise UnknownNameError(problem, where=f"{where}.{name}", given=value, allowed=allowed, hint=hint)
    return {name: options.get(name, choices[0]) for name, choices in options_of_formulation.items()}


def check_batch_width(width: int, where: str = "model.batch_width") -> None:
    """Raise InvalidValueError, naming `where`, for a batch width that batch functions cannot have."""
    if not is_whole(width) or width not in BATCH_WIDTHS:
        allowed, hint = "a power of two from 2 to 64, or 0 for no batch functions", "8 fits most machines"
        raise InvalidValueError("not a batch width", where=where, given=width, allowed=allowed, hint=hint)


def check_interfaces(interfaces: Sequence[str], where: str = "model.interfaces") -> None:
    """Raise UnknownNameError, naming `where`, for an interface that no library can offer."""
    for name in interfaces:
        check_choice(name, INTERFACES, "interface", where)
    if "acados" in interfaces and len(set(interfaces)) > 1:
        problem = "interfaces with different integers"
        allowed, hint = '"acados" alone (int), or those of CasADi (long long)', "build two libraries"
        raise InvalidValueError(problem, where=where, given=", ".join(interfaces), allowed=allowed, hint=hint)


@dataclass(frozen=True)
class ModelRequest:
    """The requested quantities, and the options of their generation.

    Attributes
    ----------
    quantities : tuple of str
        Names of the requested quantities.
    parameters : mapping of str to tuple of int
        Run-time parameters: name -> indices of nodes or members (gravity: an empty tuple). All other values
        are constants in the C code.
    integrators, solvers : tuple of str
        Names of the integrators and solvers of the library.
    formulation : str
        Name of the formulation.
    emitter : str
        Name of the emitter, or ``"auto"``.
    options : mapping of str to str
        Options of the formulation.
    precision : str
        ``"double"`` or ``"single"``, for every number of the library.
    events : tuple of str or None
        Events at which integrators can end their steps; ``"auto"``: all at which a force or its slope jumps,
        and a condition. None: none, but all where events set internal states, or motions are differentiated.
    flags : str
        ``"reference"`` (bit-equal to CasADi's virtual machine on every machine) or ``"native"``.
    checks : str
        ``"finite"``: functions look for numbers that are not finite and say so by their status; ``"none"``:
        they do not, and hand out what comes of them. Integrators, batches and solvers always look.
    batch_width : int
        Number of evaluations that batch functions process together; 0: no batch functions.
    keep : tuple of str
        The quantities that integrators can keep constant: ``"energy"``.
    interfaces : tuple of str
        Interfaces besides the C functions: ``"casadi"``, with first derivatives, or ``"casadi_hessian"``,
        with second derivatives too; ``"acados"``, for acados.
    driven : tuple of str
        Things that profiles can change without inputs, too: ``"pull"``, a spring and a damper between one
        node and a point.
    columns : tuple of str
        The parameters by which motions are differentiated while they are integrated: run-time parameters by
        their names in `parameters`, ``"input"``; ``"coordinate"`` and ``"velocity"``, at the start.
    directions : tuple of str
        Names of derivatives of motions in place of `columns`: each along a direction of all run-time
        parameters, inputs and starts, which the arguments ``"direction"`` and ``"column"`` of a motion say.
    copies : bool
        Whether the library has functions that advance many copies by a sample, see `Stepper`.

    Raises
    ------
    InvalidValueError, UnknownNameError
        An impossible batch width or an unknown interface.

    Examples
    --------
    >>> from tensegrity_codegen import ModelRequest
    >>> ModelRequest(("member_tension", "acceleration"), integrators=("rk853",)).formulation
    'node_position'
    """

    quantities: tuple[str, ...]
    parameters: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    integrators: tuple[str, ...] = ()
    formulation: str = "node_position"
    emitter: str = "unrolled"
    options: Mapping[str, str] = field(default_factory=dict)
    solvers: tuple[str, ...] = ()
    precision: str = "double"
    events: tuple[str, ...] | None = None
    flags: str = "reference"
    checks: str = "finite"
    batch_width: int = 0
    keep: tuple[str, ...] = ()
    interfaces: tuple[str, ...] = ()
    driven: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()
    directions: tuple[str, ...] = ()
    copies: bool = False

    def __post_init__(self) -> None:
        for name in ("formulation", "emitter", "precision", "flags", "checks"):
            check_instance(getattr(self, name), str, name, "a text")
        for name in (*LISTS, *(("events",) if self.events is not None else ())):
            object.__setattr__(self, name, tuple(dict.fromkeys(check_names(getattr(self, name), name))))
        for name in ("parameters", "options"):
            mapping = check_mapping(getattr(self, name), name, "see ModelRequest")
            check_names(mapping, name)
            for key, value in mapping.items():
                check_instance(
                    value, str if name == "options" else Iterable, f"{name}.{key}", "see ModelRequest"
                )
            object.__setattr__(self, name, MappingProxyType(dict(mapping)))
        # The name of an emitter that wrote four members at a time: unrolled code has loops over members now.
        if self.emitter == "lanes":
            object.__setattr__(self, "emitter", "unrolled")
        check_choice(self.checks, CHECKS, "checks", "model.checks")
        check_batch_width(self.batch_width)
        check_interfaces(self.interfaces)

    def __reduce__(self) -> tuple[Any, ...]:
        return reduce_fields(self)

    @property
    def differentiates_motions(self) -> bool:
        """Whether motions carry derivatives, see `columns` and `directions`, or have adjoints."""
        return bool(self.columns or self.directions) or self.has_adjoint

    @property
    def has_adjoint(self) -> bool:
        """Whether gradients of motions are taken backwards: ``"adjoint_rate"`` is wanted."""
        return "adjoint_rate" in self.quantities

    def lacks_events(self, *kinds: str) -> bool:
        """Return whether integrators are wanted with other events than these kinds."""
        named = set(kinds if self.events is None else self.events)
        return bool(self.integrators) and not named & set(AUTO_EVENTS) and not named >= set(kinds)

    def wanting(
        self,
        *quantities: str,
        integrators: tuple[str, ...] = (),
        solvers: tuple[str, ...] = (),
        parameters: Mapping[str, tuple[int, ...]] | None = None,
    ) -> "ModelRequest":
        """Return the request for just these functions, with some parameters added to the present ones.

        Without interfaces: analyses do not call the library by them, and compiling them takes long.
        """
        return replace(
            self,
            quantities=quantities,
            integrators=integrators,
            solvers=solvers,
            interfaces=(),
            parameters={**self.parameters, **(parameters or {})},
        )
