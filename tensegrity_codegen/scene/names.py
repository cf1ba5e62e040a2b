"""Names that are safe in C, C++, file names and shells, and the way places in a scene are written."""

import json
import re
from collections import Counter
from collections.abc import Iterable, Sequence

from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidNameError,
    UnknownKeyError,
    UnknownNameError,
    name_list,
    suggest,
)

NAME_PATTERN = "^[A-Za-z][A-Za-z0-9_]{0,62}$"
NAME_RULE = "a letter, then up to 62 letters, digits or _; no C or C++ keyword"
MAX_KNOWN = 40  # known keys that an error lists

_BARE = re.compile(r"[A-Za-z0-9_-]{1,63}")
_NAME = re.compile(NAME_PATTERN[1:-1])

# Keywords of C23 and C++23 (those that a name here could equal: none with a leading underscore).
_KEYWORDS = """
alignas alignof and and_eq asm auto bitand bitor bool break case catch char char8_t char16_t char32_t
class co_await co_return co_yield compl concept const consteval constexpr constinit const_cast
continue decltype default delete do double dynamic_cast else enum explicit export extern false float
for friend goto if inline int long mutable namespace new noexcept not not_eq nullptr
operator or or_eq private protected public register reinterpret_cast requires restrict return short
signed sizeof static static_assert static_cast struct switch template this thread_local throw true try
typedef typeid typename typeof typeof_unqual union unsigned using virtual void volatile wchar_t while
xor xor_eq
"""
KEYWORDS = frozenset(_KEYWORDS.split())
# Stems of files beside the generated NAME.c, and files that `make` would make of NAME.c.
BESIDE = ("example", "makefile", "gnumakefile")
# Names that Windows reserves for devices, whatever their ending.
DEVICES = ("con", "prn", "aux", "nul", *(f"{port}{k}" for port in ("com", "lpt") for k in range(1, 10)))
# Headers of C and C++, which a folder with NAME.h would hide from a compiler that looks there.
_HEADERS = """
assert complex ctype errno fenv float inttypes iso646 limits locale malloc math memory poll pthread
regex sched search semaphore setjmp signal stdalign stdarg stdatomic stdbit stdbool stdckdint stddef
stdint stdio stdlib stdnoreturn string strings tgmath threads time uchar unistd wchar wctype windows
"""
HEADERS = tuple(_HEADERS.split())
FILE_NAMES = (*BESIDE, *DEVICES, *HEADERS)
FILE_NAME_PROBLEM = "the name is taken by a file beside the generated code, a header of C, or Windows"
FILE_NAME_RULE = (
    f"{NAME_RULE}; not {', '.join(BESIDE)}, which are files beside the generated code; "
    "not con, prn, aux, nul, com1 to com9, lpt1 to lpt9, which Windows reserves for devices; "
    f"not {', '.join(HEADERS)}, which are headers of C"
)


def is_name(text: str) -> bool:
    """Return whether `text` can name a thing: it matches NAME_PATTERN and is no keyword."""
    return _NAME.fullmatch(text) is not None and text not in KEYWORDS


def check_name(text: str, where: str = "") -> None:
    """Raise InvalidNameError unless `text` can name a thing."""
    if not isinstance(text, str) or not is_name(text):
        keyword = isinstance(text, str) and text in KEYWORDS
        problem = "the name is a keyword of C or C++" if keyword else "not a valid name"
        hint = f"rename it, for example {text}_1" if keyword else ""
        raise InvalidNameError(problem, where=where, given=text, allowed=NAME_RULE, hint=hint)


def is_scene_name(text: str) -> bool:
    """Return whether `text` can name a scene, and the files NAME.c and NAME.h beside the others."""
    return is_name(text) and text.lower() not in FILE_NAMES


def check_scene_name(text: str, where: str = "") -> None:
    """Raise InvalidNameError unless `text` can name a scene and the files that are generated of it."""
    check_name(text, where)
    if not is_scene_name(text):
        hint = f"rename it, for example {text}_scene"
        raise InvalidNameError(FILE_NAME_PROBLEM, where=where, given=text, allowed=FILE_NAME_RULE, hint=hint)


def check_names(names: Sequence[str], what: str, where: str = "") -> None:
    """Raise InvalidNameError or DuplicateNameError unless all `names` are valid and differ."""
    location = key_path(where, what)
    for name in names:
        check_name(name, location)
    if len(set(names)) < len(names):
        value, allowed = next(name for name, count in Counter(names).items() if count > 1), "each name once"
        raise DuplicateNameError(f"two {what} under one name", where=location, given=value, allowed=allowed)


def check_known(name: str, known: Iterable[str], problem: str, allowed: str, *place: str | int) -> None:
    """Raise UnknownNameError for a name that is not `known`; place: the file and keys of it, see key_path."""
    if name not in known:
        hint = suggest(name[:80], known)
        location = key_path(str(place[0]), *place[1:])
        raise UnknownNameError(problem, where=location, given=name[:80], allowed=allowed, hint=hint)


def unknown_key(key: str, known: Iterable[str], where: str, problem: str = "unknown key") -> UnknownKeyError:
    """Return the error for a key of a table that is not `known`, with similar ones as its hint."""
    key, names = key[:80], list(known)
    hint = suggest(key, names)
    return UnknownKeyError(problem, where=where, given=key, allowed=name_list(names, MAX_KNOWN), hint=hint)


def key_path(where: str, *parts: str | int) -> str:
    """Return the place of a key: `key_path("a.toml", "nodes", "a1", "mass")` is "a.toml: nodes.a1.mass"."""
    path = ""
    for key in parts:
        if isinstance(key, int):
            path += f"[{key}]"
        elif key:
            shown = key if _BARE.fullmatch(key) else json.dumps(key if len(key) < 64 else key[:60] + "…")
            path += f".{shown}" if path else shown
    return ": ".join(piece for piece in (str(where), path) if piece)


def describe_pieces(first_nodes: Sequence[str]) -> str:
    """Return the warning of pieces that no members join, by the first node of each."""
    count, names = len(first_nodes), name_list(first_nodes)
    return f"the structure is in {count} unconnected pieces, that begin at nodes {names}"
