"""Arguments and options that several verbs share, and how their text is read."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    NonFiniteError,
    UnknownNameError,
    suggest,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from tensegrity_codegen.structure.bodies import BodySystem
    from tensegrity_codegen.structure.structure import Structure


SceneArgument = Annotated[
    Path, typer.Argument(metavar="SCENE", help="Scene file (TOML).", show_default=False)
]
ScenesArgument = Annotated[list[Path], typer.Argument(metavar="SCENE...", help="Scene files.")]
PeersOption = Annotated[
    bool, typer.Option("--peers/--no-peers", help="Compare with MuJoCo, SUNDIALS and SciPy, where installed.")
]
FreshOption = Annotated[
    bool, typer.Option("--fresh", help="Use nothing of an earlier run, also where it was interrupted.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]
AllOption = Annotated[
    bool, typer.Option("--all", help="Print all rows of long tables, not only those that matter most.")
]


@dataclass(frozen=True)
class PrintOptions:
    """How a verb with long tables prints its result."""

    all: AllOption = False
    json: JsonOption = False


@dataclass(frozen=True)
class StrictOptions(PrintOptions):
    """How a verb that compares members with their limits prints its result, and ends."""

    strict: Annotated[
        bool, typer.Option("--strict", help="Exit code 3 where members exceed limits or buckle.")
    ] = False


OverwriteOption = Annotated[bool, typer.Option("--overwrite", help="Replace files that exist.")]
BatchWidthOption = Annotated[
    int | None,
    typer.Option(
        "--batch-width",
        help="Number of evaluations that batch functions process together; 0: no such functions.",
    ),
]
CompilerOption = Annotated[
    str | None,
    typer.Option("--compiler", help="C compiler: gcc, clang, zig or a command; default: the first found."),
]
FlagsOption = Annotated[
    str | None,
    typer.Option(
        "--flags",
        help="reference (bit-equal to CasADi) or native (this machine's CPU), instead of the scene's.",
    ),
]

PrecisionOption = Annotated[
    str | None, typer.Option("--precision", help="double or single, instead of the scene's.")
]


def parse_vector(text: str, where: str, axes: Sequence[int] = (0, 1, 2)) -> tuple[float, float, float]:
    """Return the three numbers of "x,y,z", or of one number for each of `axes`, with 0 on the others.

    Raises InvalidValueError or NonFiniteError.
    """
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    shorter = "" if len(axes) == 3 else f", or {','.join('xyz'[axis] for axis in axes)}"
    if len(numbers) not in (3, len(axes)):
        raise InvalidValueError(
            "not a vector",
            where=where,
            given=text,
            allowed=f"three numbers, x,y,z{shorter}",
            hint="for example 0,0,-9.81" if len(axes) == 3 else "",
        )
    if not all(math.isfinite(number) for number in numbers):
        allowed = f"three finite numbers, x,y,z{shorter}"
        raise NonFiniteError("not finite", where=where, given=text, allowed=allowed)
    vector = dict(zip(axes if len(numbers) == len(axes) else range(3), numbers, strict=True))
    return (vector.get(0, 0.0), vector.get(1, 0.0), vector.get(2, 0.0))


def _own_form(axes: Sequence[int]) -> str:
    """Return the shorter form of a load that a scene of fewer than three axes takes too."""
    return "" if len(axes) == 3 else f", or NODE={','.join('f' + 'xyz'[axis] for axis in axes)}"


def parse_loads(
    texts: list[str], structure: "Structure | BodySystem", option: str = "--load"
) -> "NDArray[np.float64]":
    """Return loads (n_nodes, 3) [N] of "NODE=fx,fy,fz" texts; several on one node add up.

    A scene of one or two axes takes one number for each of its axes too, as its file does.
    """
    import numpy as np

    loads = np.zeros((structure.n_nodes, 3))
    index = {name: node for node, name in enumerate(structure.node_name)}
    for text in texts:
        name, equals, vector = text.partition("=")
        if not equals:
            raise InvalidValueError(
                "not a load",
                where=option,
                given=text,
                allowed="NODE=fx,fy,fz" + _own_form(structure.axes),
                hint="for example t1=0,0,-10",
            )
        if name.strip() not in index:
            raise UnknownNameError(
                "unknown node",
                where=option,
                given=name,
                allowed="a node of the scene",
                hint=suggest(name, index),
            )
        force = np.array(parse_vector(vector, f"{option} {name}", structure.axes))
        dropped = [axis for axis in range(3) if axis not in structure.axes and force[axis] != 0.0]
        if dropped:
            raise InvalidValueError(
                "a load on an axis that the scene does not model",
                where=f"{option} {name}",
                given=vector,
                allowed=f"forces along {', '.join('xyz'[axis] for axis in structure.axes)}",
            )
        loads[index[name.strip()]] += force
    return loads


def parse_member_values(texts: Sequence[str], option: str, alone: str = "") -> dict[str, float]:
    """Return NAME=VALUE texts as values by name; alone: the name of a VALUE without one.

    Raises InvalidValueError or DuplicateNameError.
    """
    return {name: values[0] for name, values in parse_member_numbers(texts, option, (1,), alone).items()}


def parse_member_numbers(
    texts: Sequence[str], option: str, counts: tuple[int, ...], alone: str = ""
) -> dict[str, list[float]]:
    """Return NAME=A,B texts as numbers by name, as many as one of `counts`.

    Raises InvalidValueError or DuplicateNameError.
    """
    found: dict[str, list[float]] = {}
    for text in texts:
        name, equals, numbers = text.partition("=")
        if alone and not equals:
            name, numbers = alone, text
        try:
            values = [float(number) for number in numbers.split(",")]
        except ValueError:
            values = []
        if len(values) not in counts:
            forms = [f"NAME={','.join(['VALUE'] * count)}" for count in counts]
            raise InvalidValueError(
                "not a value of members",
                where=option,
                given=text,
                allowed=" or ".join((["VALUE"] if alone else []) + forms),
                hint="cables=" + ",".join(["100"] * counts[0]),
            )
        if name in found:
            raise DuplicateNameError("a name twice", where=option, given=name, allowed="each name once")
        found[name] = values
    return found


def read_folder(text: str) -> Path:
    """Return the folder that an option names; raises typer.BadParameter for an empty text.

    Path("") is the current folder, which a variable of a shell that is not set would fill with files.
    """
    if not text.strip():
        raise typer.BadParameter("a folder needs a name; the current one is '.'")
    return Path(text)
