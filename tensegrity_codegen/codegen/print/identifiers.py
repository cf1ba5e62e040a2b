"""Names of a scene in C text: as parts of identifiers, and in comments."""

import re

# C99 tells identifiers apart by 63 characters: a longer name would not fit behind a prefix.
LONGEST_NAME = 40
IDENTIFIER = re.compile(r"[A-Za-z_]\w*", re.ASCII)
UNSAFE = re.compile(r"[^\w .,:()\-]", re.ASCII)


def name_local(prefix: str, name: str, number: int) -> str:
    """Return the name of a local variable of what has a name and a number in the scene.

    prefix: what the variable holds, such as "length"; name: name of the member or node; number: its number,
    which stands in for a name that is too long, or no identifier.
    """
    fits = len(name) <= LONGEST_NAME and IDENTIFIER.fullmatch(name)
    return f"{prefix}_{name}" if fits else f"{prefix}_{number}"


def plain_comment(text: str) -> str:
    """Return text that can stand in a C comment: every character that could end or change one is a "_"."""
    return UNSAFE.sub("_", text)
