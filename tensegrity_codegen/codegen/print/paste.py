"""Files of plain C in `templates/c/`, as they stand in a generated source.

These files compile alone against the sample `config.h`. Where they are pasted, the generated source takes the
place of all that they include.
"""

import functools
import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

GUARD = re.compile(r"#ifndef (\w+_H)\n#define \1\n(.*)#endif\n*", re.DOTALL)
INCLUDE = re.compile(r'^#include "[^"]*"\n', re.MULTILINE)
CONDITION = re.compile(r"#if (!?)((?:WITH|METHOD)_\w+)")
NUMBER = re.compile(r"\(real\)(\d[\d.]*(?:e[+-]?\d+)?)")

# Sizes of a state and of what is kept of one, where it consists of coordinates and velocities alone.
WITHOUT_INTERNAL = {
    "N_OLD + 2 * N_STATES + N + N_STATES * METHOD_DENSE": "(8 + 2 * METHOD_DENSE) * N",
    "N_OLD + 2 * N_STATES + N": "8 * N",
    "N_OLD + 2 * N_STATES": "7 * N",
    "N_OLD + N_STATES": "5 * N",
    "2 * N_STATES": "4 * N",
    "3 * N_STATES": "6 * N",
    "N_STATES": "2 * N",
    "N_SLOPES": "N",
    "N_OLD": "3 * N",
}
STATE_SIZE = re.compile(rf"\b({'|'.join(map(re.escape, WITHOUT_INTERNAL))})\b")


def plain_c_folder(templates: Path) -> Path:
    """Return the folder of the plain C files within the folder of the templates."""
    return templates / "c"


def paste(
    context: Mapping[str, Any], file: str, settings: Mapping[str, bool] = MappingProxyType({}), **names: str
) -> str:
    """Return the text of `templates/c/<file>` for a template that calls `paste("<file>")`.

    The context names the library (`name`), its numbers (`real`, `suffix`), the `settings` that conditions
    name, here with more of them, and the `plain_c` folder. See paste_text for `names`.
    """
    words = {"scene": context["name"], **names}
    text = _read(context["plain_c"] / file)
    if not context.get("n_internal"):
        text = STATE_SIZE.sub(lambda found: WITHOUT_INTERNAL[found[0]], text)
    return paste_text(text, words, {**context["settings"], **settings}, context["real"], context["suffix"])


def paste_text(
    text: str, names: Mapping[str, str], settings: Mapping[str, bool], real: str, suffix: str
) -> str:
    """Return a file of plain C as it stands in a generated source.

    Parameters
    ----------
    text : str
        The file.
    names : mapping of str to str
        First words of identifiers and what replaces them: {"scene": "prism"} turns `scene_run` into
        `prism_run` and `SCENE_OK` into `PRISM_OK`.
    settings : mapping of str to bool
        What decides between the branches of `#if WITH_...` and `#if METHOD_...`.
    real, suffix : str
        C type of numbers, and what ends the literals of that type.

    Raises
    ------
    KeyError
        For a condition that is not among the settings.
    """
    guarded = GUARD.search(text)
    text = text if guarded is None else text[: guarded.start()] + guarded[2]
    text = _choose_branches(INCLUDE.sub("", text), settings)
    for word, replacement in names.items():
        text = re.sub(rf"\b{word}_(?=\w)", f"{replacement}_", text)
        text = re.sub(rf"\b{word.upper()}_(?=\w)", f"{replacement.upper()}_", text)
    text = NUMBER.sub(rf"\g<1>{suffix}", text)
    text = re.sub(r"\breal\b", real, text)
    return text.replace("static inline ", "static ").strip("\n") + "\n"


def _choose_branches(text: str, settings: Mapping[str, bool]) -> str:
    """Return the text with the branches that the settings choose, and without the conditions themselves."""
    kept: list[str] = []
    open_: list[bool | None] = []  # of every open condition: is this branch kept; None: not one of ours
    for line in text.splitlines():
        found, directive = CONDITION.fullmatch(line), line.split(" ")[0]
        own = bool(open_) and open_[-1] is not None
        if found:
            open_.append(settings[found[2]] != bool(found[1]))
        elif directive == "#else" and own:
            open_[-1] = not open_[-1]
        elif directive == "#endif" and own:
            open_.pop()
        else:
            if directive.startswith("#if"):
                open_.append(None)
            elif directive == "#endif":
                open_.pop()
            if False not in open_:
                kept.append(line)
    return "\n".join(kept)


@functools.cache
def _read(path: Path) -> str:
    return path.read_text(encoding="utf-8")
