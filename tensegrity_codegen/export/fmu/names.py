"""Names of variables in the structured convention of the standard."""

import re
from collections.abc import Sequence

from tensegrity_codegen.system.errors import InvalidNameError

PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
QUOTED = re.compile(r"[A-Za-z0-9_!#$%&()*+,\-./:;<>=?@\[\]^{}|~ ]")


def join_names(quantity: str, parts: Sequence[str | int]) -> str:
    """Return the name of an entry: "member_tension.bar1"; numbers are indices from 1: "law.bar1[2]"."""
    words = [quantity, *(quote_name(part) for part in parts if isinstance(part, str))]
    numbers = [str(part + 1) for part in parts if isinstance(part, int)]
    return ".".join(words) + (f"[{','.join(numbers)}]" if numbers else "")


def quote_name(name: str) -> str:
    """Return a name as an identifier of the standard, in quotes where it is none by itself.

    Raises InvalidNameError for a name that is empty or has characters that the standard does not allow.
    """
    if PLAIN.fullmatch(name):
        return name
    letters = []
    for letter in name:
        if letter in "'\"\\":
            letters.append("\\" + letter)
        elif QUOTED.fullmatch(letter):
            letters.append(letter)
        else:
            raise InvalidNameError(
                "this name cannot be the name of a variable of an FMU",
                where="export fmu",
                given=name,
                allowed="printable ASCII characters",
            )
    if not letters:
        raise InvalidNameError("a name is empty", where="export fmu", given=name, allowed="a name")
    return f"'{''.join(letters)}'"
