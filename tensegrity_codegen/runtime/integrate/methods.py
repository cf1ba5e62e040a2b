"""The methods of integration: one record each, and what the package asks of them."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal

from tensegrity_codegen.system.errors import check_choice
from tensegrity_codegen.tables.integrators import INTEGRATORS
from tensegrity_codegen.tables.integrators.integrator import Integrator

Kind = Literal["auto", "adaptive", "fixed", "implicit", "scipy"]


@dataclass(frozen=True)
class Method:
    """A method of `simulate`.

    name: its name; those of methods in C are the names of the integrators of a library.
    kind: "auto" chooses among the others; explicit methods in C with error control ("adaptive") or a fixed
        step ("fixed"); the implicit method in C; methods of SciPy.
    sentence: what it is, for the documentation.
    order: order of its steps; 0 where it has no order of its own.
    finds_events: whether its steps end where cables go slack or taut, or a condition changes its sign.
    in_batches: whether it integrates several motions side by side.
    keeps_energy: whether its steps can end at the energy of the start.
    takes_schedule: whether inputs may change with time by a function, not by a table (profile) alone.
    scipy: SciPy's name of it.
    """

    name: str
    kind: Kind
    sentence: str
    order: int = 0
    finds_events: bool = True
    in_batches: bool = False
    keeps_energy: bool = False
    takes_schedule: bool = False
    scipy: Any = ""

    @property
    def has_fixed_step(self) -> bool:
        """Whether it takes a step, and no tolerance."""
        return self.kind == "fixed"


def _in_c(item: Integrator) -> Method:
    return Method(
        item.name,
        item.kind,
        f"{item.title} with the fixed step `step`" if item.kind == "fixed" else item.title,
        item.order,
        finds_events=item.follows_events,
        in_batches=item.in_batches,
        keeps_energy=item.keeps_energy,
    )


def _scipy(name: str, sentence: str, order: int = 0) -> Method:
    return Method(
        f"scipy_{name.lower()}",
        "scipy",
        f"SciPy's {sentence}",
        order,
        finds_events=False,
        takes_schedule=True,
        scipy=name,
    )


SCIPY_EXPLICIT = _scipy("DOP853", "explicit DOP853", 8)
SCIPY_IMPLICIT = _scipy("Radau", "implicit Radau", 5)
_ALL = (
    Method(
        "auto",
        "auto",
        "One of the others, by stiffness, damping and tolerance, with ever smaller steps until the estimated "
        "error at the samples is within the tolerance",
        keeps_energy=True,
        takes_schedule=True,
    ),
    *sorted((_in_c(item) for item in INTEGRATORS.values()), key=lambda item: item.kind),
    SCIPY_EXPLICIT,
    _scipy("RK45", "explicit RK45", 5),
    _scipy("LSODA", "LSODA"),
    SCIPY_IMPLICIT,
)
METHODS: Mapping[str, Method] = MappingProxyType({item.name: item for item in _ALL})
BATCH_METHOD = "rk853"  # of batches, where no method is named


def find_method(name: str) -> Method:
    """Return the method of that name; raises UnknownNameError."""
    check_choice(name, METHODS, "method", "method")
    return METHODS[name]


def list_methods(ability: str) -> tuple[str, ...]:
    """Return the names of the methods that have an ability: the name of a field of `Method`."""
    return tuple(name for name, item in METHODS.items() if getattr(item, ability))
