"""C text cut into its definitions, and without those that nothing exported reaches.

It is read as generated C is laid out: definitions begin at the start of a line, and a brace that opens a
function on a line of its own is closed by one.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

WORD = re.compile(r"[A-Za-z_]\w*")
QUIET = re.compile(r'/\*.*?\*/|//[^\n]*|"(?:[^"\\\n]|\\.)*"|\'(?:[^\'\\\n]|\\.)+\'', re.DOTALL)
LEAD = re.compile(r"(?:[ \t]*\n|[ \t]*/\*(?:[^*]|\*(?!/))*\*/[ \t]*\n|[ \t]*//[^\n]*\n)*")
DIRECTIVE = re.compile(r"#[ \t]*(\w+)[ \t]*(\w*)((?:/\*(?:[^*]|\*(?!/))*\*/|\\[\s\S]|[^\n\\])*)\n?")
OPENING = re.compile(rf"[;{{]|{QUIET.pattern}", re.DOTALL)
BRACE = re.compile(rf"[{{}}]|{QUIET.pattern}", re.DOTALL)
LINE_END = re.compile(r"[^\n]*\n?")
ATTRIBUTE = re.compile(r"__attribute__\s*\(\((?:[^()]|\((?:[^()]|\([^()]*\))*\))*\)\)|__declspec\([^()]*\)")
LINKAGE = re.compile(r'(?:extern "C" \{|\})[ \t]*\n')
ENUM = re.compile(r"(enum \{\n)((?:[ \t]+\w+ = [^,\n/]+,?[ \t]*(?:/\*[^\n]*\*/)?\n)+)(\};\n)")
LAST_COMMA = re.compile(r",([ \t]*(?:/\*[^\n]*\*/)?\n\};)")
# What files use of headers of the C library that not all of them need.
HEADERS = {
    "<limits.h>": ("INT_MAX", "LLONG_MAX"),
    "<string.h>": ("memcpy", "memset"),
}
STATIC_MACRO = re.compile(r"^#[ \t]*define (\w+)[^\n]*\bstatic\b", re.MULTILINE)
NAME = re.compile(r"(\w+)\s*(?:\((?!\*)|[\[;])")
NAME_OF_VALUE = re.compile(r"(\w+)\s*(?:\[[^=]*)?=")


@dataclass
class Piece:
    """A definition with the blank lines and comments before it, or what opens, parts or closes a group.

    names: what is defined; without any it stays. is_exported: whether other files can reach it. groups: the
    words of the conditions that it stands under, one list for each.
    """

    lead: str
    text: str
    kind: str = "definition"
    names: tuple[str, ...] = ()
    is_exported: bool = False
    groups: tuple[list[str], ...] = ()

    @cached_property
    def words(self) -> set[str]:
        """The identifiers in it, without comments and texts."""
        return set(WORD.findall(QUIET.sub(" ", self.text))).union(*self.groups)


def drop_unreached(source: str, reached: Iterable[str] = ()) -> str:
    """Return a C source without what its exported definitions do not reach; reached: names that others use.

    All definitions of one name stay or go together, with their comments; groups of `#if` that become empty
    go. Macros that are defined once, as nothing, go from where they stand.
    """
    pieces = list(split_definitions(source))
    defined: dict[str, list[Piece]] = {}
    for piece in pieces:
        for name in piece.names:
            defined.setdefault(name, []).append(piece)
    waiting = list(reached)
    empty = {
        name
        for name, definitions in defined.items()
        if len(definitions) == 1 and definitions[0].text == f"#define {name}\n" and name not in waiting
    }
    waiting += [word for piece in pieces if _stays(piece) for word in piece.words]
    selected: set[str] = set()
    while waiting:
        name = waiting.pop()
        if name in defined and name not in selected:
            selected.add(name)
            waiting += [word for piece in defined[name] for word in piece.words]
    text = _join(pieces, selected - empty)
    for name in empty:
        text = text.replace(f"  {name}\n", "").replace(f"{name} ", "")
    return text


def _stays(piece: Piece) -> bool:
    return piece.kind == "definition" and (piece.is_exported or not piece.names)


def _join(pieces: Iterable[Piece], reached: set[str]) -> str:
    """Return the text of what is reached, without groups in which nothing is."""
    texts: list[str] = []
    opened: list[tuple[int, int]] = []  # of each open group: texts before it, definitions before it
    count = 0
    for piece in pieces:
        if piece.kind == "definition":
            if not _stays(piece) and reached.isdisjoint(piece.names):
                texts.append("\n" * piece.lead.startswith("\n"))
                continue
            count += 1
        elif piece.kind == "open":
            opened.append((len(texts), count))
        elif piece.kind == "close":
            start, before = opened.pop()
            if count == before:
                texts[start:] = ["\n" * texts[start].startswith("\n")]
                continue
        texts += (piece.lead, piece.text)
    return LAST_COMMA.sub(r"\1", "".join(texts))


def split_definitions(source: str) -> Iterator[Piece]:
    """Give the definitions and directives of a C text in their order."""
    static = {"static", *STATIC_MACRO.findall(source)}
    groups: list[list[str]] = []
    at = 0
    while at < len(source):
        start = LEAD.match(source, at).end()  # type: ignore[union-attr]
        lead = source[at:start]
        directive = DIRECTIVE.match(source, start)
        if directive:
            at = directive.end()
            yield _read_directive(lead, directive, groups)
            continue
        linkage, enum = LINKAGE.match(source, start), ENUM.match(source, start)
        if enum:
            at = enum.end()
            yield Piece(lead, enum[1], "open")
            for line in enum[2].splitlines(keepends=True):
                yield Piece("", line, names=(WORD.search(line)[0],), groups=tuple(groups))  # type: ignore[index]
            yield Piece("", enum[3], "close")
            continue
        at = linkage.end() if linkage else _find_end(source, start)
        text = source[start:at]
        names, is_exported = ((), True) if linkage else _name(text, static)
        yield Piece(lead, text, names=names, is_exported=is_exported, groups=tuple(groups))


def _read_directive(lead: str, directive: re.Match[str], groups: list[list[str]]) -> Piece:
    word, name, text = directive[1], directive[2], directive[0]
    if word in ("if", "ifdef", "ifndef"):
        groups.append(WORD.findall(text)[1:])
        return Piece(lead, text, "open")
    if word in ("else", "elif"):
        groups[-1] += WORD.findall(text)[1:]
        return Piece(lead, text, "part")
    if word == "endif":
        groups.pop()
        return Piece(lead, text, "close")
    names = (name,) if word in ("define", "undef") else HEADERS.get(text[text.find("<") :].strip(), ())
    return Piece(lead, text, names=names, groups=tuple(groups))


def _find_end(source: str, start: int) -> int:
    """Return where the line ends on which a definition does."""
    at = start
    while True:
        opening = next((m for m in OPENING.finditer(source, at) if m[0] in ";{"), None)
        if opening is None:
            return len(source)
        at = opening.start()
        if opening[0] == "{":
            at = source.find("\n}", at) + 1 if source[at - 1] == "\n" else _match_brace(source, at)
            line_end = LINE_END.match(source, at + 1)
            if line_end is None or not QUIET.sub("", line_end[0]).strip():
                break
        else:
            break
    return LINE_END.match(source, at + 1).end()  # type: ignore[union-attr]


def _match_brace(source: str, start: int) -> int:
    depth = 0
    for match in BRACE.finditer(source, start):
        depth += (match[0] == "{") - (match[0] == "}")
        if depth == 0:
            return match.start()
    return len(source)


def _name(text: str, static: set[str]) -> tuple[tuple[str, ...], bool]:
    """Return the names that a definition has, and whether other files can reach it."""
    opening = text.partition("{")[0]
    head = ATTRIBUTE.sub(" ", QUIET.sub(" ", opening))
    words = WORD.findall(head)
    is_exported = static.isdisjoint(words) or "((used))" in opening
    if words[:1] in (["enum"], ["struct"], ["typedef"]) or words[-1:] == ["struct"]:
        body = ATTRIBUTE.sub(" ", QUIET.sub(" ", text[len(opening) :]))
        if words[0] == "enum" and body:
            return (*words[1:], *re.findall(r"(\w+)\s*(?:=[^,}]*)?[,}]", body)), False
        if words[0] == "struct":
            return (words[1],), False
        if words[:2] == ["typedef", "char"]:  # an assertion
            return (), True
        is_exported = is_exported and words[0] != "typedef"
        head = body.rpartition("}" if words[0] == "typedef" else "} ")[2] or head
    found = re.search(NAME_OF_VALUE if "=" in head else NAME, head)
    return ((found[1],), is_exported) if found and words[0] != "extern" else ((), True)
