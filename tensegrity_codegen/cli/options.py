"""Arguments and options that several verbs share, and how their text is read."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    NonFiniteError,
    UnknownNameError,
    check_choice,
)
from tensegrity_codegen.system.name_patterns import find_matching

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from tensegrity_codegen.cli.output import Output
    from tensegrity_codegen.scene.subject import Subject
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


@dataclass(frozen=True)
class PrintOptions:
    """How a verb with long tables prints its result."""

    all: Annotated[
        bool, typer.Option("--all", help="Print all rows of long tables, not only those that matter most.")
    ] = False
    json: JsonOption = False


@dataclass(frozen=True)
class StrictOptions(PrintOptions):
    """How a verb that compares members with their limits prints its result, and ends."""

    strict: Annotated[
        bool,
        typer.Option("--strict", help="Exit code 3 where members exceed limits or buckle, or it snapped."),
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
    """Return the three numbers of "x,y,z", or of one number for each of `axes`, with 0 on the others."""
    try:
        numbers = [float(field) for field in text.split(",")]
    except ValueError:
        numbers = []
    shorter = "" if len(axes) == 3 else f", or {','.join('xyz'[axis] for axis in axes)}"
    if len(numbers) not in (3, len(axes)):
        allowed, hint = f"three numbers, x,y,z{shorter}", "for example 0,0,-9.81" if len(axes) == 3 else ""
        raise InvalidValueError("not a vector", where=where, given=text, allowed=allowed, hint=hint)
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
    """Return loads (n_nodes, 3) [N] of "NODE=fx,fy,fz" texts, NODE a name or a pattern; loads add up."""
    import numpy as np

    loads = np.zeros((structure.n_nodes, 3))
    index = {name: node for node, name in enumerate(structure.node_name)}
    for entry in texts:
        pattern, equals, vector = entry.partition("=")
        if not equals:
            allowed, hint = "NODE=fx,fy,fz" + _own_form(structure.axes), "for example t1=0,0,-10"
            raise InvalidValueError("not a load", where=option, given=entry, allowed=allowed, hint=hint)
        allowed = "a node of the scene, or a pattern such as t*"
        nodes = find_matching(pattern.strip(), index, option, allowed)
        force = np.array(parse_vector(vector, f"{option} {pattern}", structure.axes))
        dropped = [axis for axis in range(3) if axis not in structure.axes and force[axis] != 0.0]
        if dropped:
            problem = "a load on an axis that the scene does not model"
            allowed = f"forces along {', '.join('xyz'[axis] for axis in structure.axes)}"
            raise InvalidValueError(problem, where=f"{option} {pattern}", given=vector, allowed=allowed)
        loads[nodes] += force
    return loads


def parse_member_values(texts: Sequence[str], option: str, alone: str = "") -> dict[str, float]:
    """Return NAME=VALUE texts as values by name; alone: the name of a VALUE without one."""
    return {name: values[0] for name, values in parse_member_numbers(texts, option, (1,), alone).items()}


def parse_member_numbers(
    texts: Sequence[str], option: str, counts: tuple[int, ...], alone: str = ""
) -> dict[str, list[float]]:
    """Return NAME=A,B texts as numbers by name, as many as one of `counts`."""
    numbers_by_name: dict[str, list[float]] = {}
    for entry in texts:
        name, equals, numbers = entry.partition("=")
        if alone and not equals:
            name, numbers = alone, entry
        try:
            values = [float(number) for number in numbers.split(",")]
        except ValueError:
            values = []
        if len(values) not in counts:
            forms = [f"NAME={','.join(['VALUE'] * count)}" for count in counts]
            problem, allowed = "not a value of members", " or ".join((["VALUE"] if alone else []) + forms)
            hint = "cables=" + ",".join(["100"] * counts[0])
            raise InvalidValueError(problem, where=option, given=entry, allowed=allowed, hint=hint)
        if name in numbers_by_name:
            raise DuplicateNameError("a name twice", where=option, given=name, allowed="each name once")
        numbers_by_name[name] = values
    return numbers_by_name


def read_folder(text: str) -> Path:
    """Return the folder of an option; raises typer.BadParameter for "", else the current folder."""
    if not text.strip():
        raise typer.BadParameter("a folder needs a name; the current one is '.'")
    return Path(text)


OPTION = "--input"

InputOption = Annotated[
    list[str] | None,
    typer.Option(
        OPTION,
        help="Value NAME=VALUE of an input or actuator, in m, K, N or N m; may be repeated.",
        show_default=False,
    ),
]


def read_inputs(texts: list[str] | None, subject: "Subject", output: "Output") -> dict[str, float]:
    """Return the values of inputs by name, and warn of rest lengths outside the ranges of actuators."""
    values: dict[str, float] = {}
    for entry in texts or ():
        name, value = _read_input(entry, subject)
        if name in values:
            problem, hint = "an input is given twice", f"remove one of {name}={values[name]:g} and {entry}"
            raise DuplicateNameError(problem, where=OPTION, given=entry, allowed="each input once", hint=hint)
        values[name] = value
    output.warn(*_find_outside(values, subject))
    return values


def _read_input(text: str, subject: "Subject") -> tuple[str, float]:
    name, equals, number = (field.strip() for field in text.partition("="))
    valid_names = [source.name for source in subject.inputs]
    if not valid_names:
        problem, allowed = "the scene has no inputs", "names of inputs and actuators of the scene"
        hint = "state [[actuators]] or [[inputs]] in the scene"
        raise UnknownNameError(problem, where=OPTION, given=text, allowed=allowed, hint=hint)
    if not equals:
        problem, hint = "not the value of an input", f"for example {valid_names[0]}=0.01"
        raise InvalidValueError(problem, where=OPTION, given=text, allowed="NAME=VALUE", hint=hint)
    check_choice(name, valid_names, "input", OPTION)
    try:
        value = float(number)
    except ValueError:
        problem, allowed = "the value of the input is not a number", "one number, in m, K, N or N m"
        raise InvalidValueError(problem, where=f"{OPTION} {name}", given=number, allowed=allowed) from None
    if not math.isfinite(value):
        raise NonFiniteError("not finite", where=f"{OPTION} {name}", given=number, allowed="a finite number")
    return name, value


def _find_outside(values: Mapping[str, float], subject: "Subject") -> list[str]:
    """Return warnings of members that these values bring outside the range of their actuator."""
    from tensegrity_codegen.structure.applied_inputs import add_inputs_to_rest_length

    rest_length = add_inputs_to_rest_length(subject, values)
    if (rest_length <= 0).any():
        e = int((rest_length <= 0).argmax())
        acting = [actuator.name for actuator in subject.inputs if e in actuator.rest_length_gain]
        raise InvalidValueError(
            f"the rest length of {subject.member_name[e]} would be {rest_length[e]:.6g} m",
            where=OPTION,
            given=", ".join(f"{name}={values[name]:g}" for name in acting if name in values),
            allowed=f"more than {-subject.rest_length[e]:.6g} m: its rest length in the scene is "
            f"{subject.rest_length[e]:.6g} m",
        )
    warnings = []
    for actuator in subject.actuators:
        lower, upper = actuator.range
        for e in actuator.members:
            if rest_length[e] != subject.rest_length[e] and not lower <= rest_length[e] <= upper:
                warnings.append(
                    f"the rest length of {subject.member_name[e]}, {rest_length[e]:.6g} m, is outside the "
                    f"range of actuator {actuator.name}, {lower:g} to {upper:g} m"
                )
    return warnings
