"""`--input NAME=VALUE`: constant values of inputs and actuators."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

import typer

from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    NonFiniteError,
    UnknownNameError,
    check_choice,
)

if TYPE_CHECKING:
    from tensegrity_codegen.cli.output import Output
    from tensegrity_codegen.scene.subject import Subject


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
    """Return the values of inputs by name, and warn of rest lengths outside the ranges of actuators.

    Raises UnknownNameError, DuplicateNameError, NonFiniteError, or InvalidValueError for a text that is no
    NAME=VALUE and for a rest length that is not positive.
    """
    values: dict[str, float] = {}
    for text in texts or ():
        name, value = _read_input(text, subject)
        if name in values:
            raise DuplicateNameError(
                "an input is given twice",
                where=OPTION,
                given=text,
                allowed="each input once",
                hint=f"remove one of {name}={values[name]:g} and {text}",
            )
        values[name] = value
    output.warn(*_find_outside(values, subject))
    return values


def _read_input(text: str, subject: "Subject") -> tuple[str, float]:
    name, equals, number = (part.strip() for part in text.partition("="))
    known = [item.name for item in subject.inputs]
    if not known:
        raise UnknownNameError(
            "the scene has no inputs",
            where=OPTION,
            given=text,
            allowed="names of inputs and actuators of the scene",
            hint="state [[actuators]] or [[inputs]] in the scene",
        )
    if not equals:
        raise InvalidValueError(
            "not the value of an input",
            where=OPTION,
            given=text,
            allowed="NAME=VALUE",
            hint=f"for example {known[0]}=0.01",
        )
    check_choice(name, known, "input", OPTION)
    try:
        value = float(number)
    except ValueError:
        raise InvalidValueError(
            "the value of the input is not a number",
            where=f"{OPTION} {name}",
            given=number,
            allowed="one number, in m, K, N or N m",
        ) from None
    if not math.isfinite(value):
        raise NonFiniteError("not finite", where=f"{OPTION} {name}", given=number, allowed="a finite number")
    return name, value


def _find_outside(values: Mapping[str, float], subject: "Subject") -> list[str]:
    """Return warnings of members that these values bring outside the range of their actuator.

    Raises InvalidValueError where inputs leave a member without a positive rest length.
    """
    from tensegrity_codegen.structure.applied_inputs import add_inputs_to_rest_length

    rest_length = add_inputs_to_rest_length(subject, values)
    if (rest_length <= 0).any():
        e = int((rest_length <= 0).argmax())
        acting = [item.name for item in subject.inputs if e in item.rest_length_gain]
        raise InvalidValueError(
            f"the rest length of {subject.member_name[e]} would be {rest_length[e]:.6g} m",
            where=OPTION,
            given=", ".join(f"{name}={values[name]:g}" for name in acting if name in values),
            allowed=f"more than {-subject.rest_length[e]:.6g} m: its rest length in the scene is "
            f"{subject.rest_length[e]:.6g} m",
        )
    found = []
    for item in subject.actuators:
        least, most = item.range
        for e in item.members:
            if rest_length[e] != subject.rest_length[e] and not least <= rest_length[e] <= most:
                found.append(
                    f"the rest length of {subject.member_name[e]}, {rest_length[e]:.6g} m, is outside the "
                    f"range of actuator {item.name}, {least:g} to {most:g} m"
                )
    return found
