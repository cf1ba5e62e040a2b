"""Lines of C that are too long go on in the next: statements at commas and operators, comments at spaces."""

import re

LONGEST = 120  # characters in a line of generated C
INDENT = "    "

# Where a statement can go on in the next line: behind a comma or an opening bracket, before an operator.
BREAK = re.compile(r"(?<=, )|(?<=\()(?=[\w(*&-])| (?=[-+*/<>?:|&=!]{1,2} )")
TRAILING = re.compile(r" +(?=\n)")
STRING = re.compile(r'"(?:[^"\\]|\\.)*"|/\*.*?\*/')


def wrap_lines(text: str) -> str:
    """Return C text in which no line is longer than LONGEST, nor ends in a space.

    Statements break at commas and operators, comments at spaces, strings nowhere. Macros go on with a
    backslash.
    """
    if " \n" in text:
        text = TRAILING.sub("", text)
    lines = text.split("\n")
    if max(map(len, lines)) <= LONGEST:
        return text
    found: list[str] = []
    is_comment = False
    for line in lines:
        opens = line.rfind("/*") > line.rfind("*/")
        if len(line) <= LONGEST:
            found.append(line)
        elif is_comment or line.lstrip().startswith("/*"):
            found += _wrap_comment(line)
        else:
            found += _wrap_statement(line)
        is_comment = opens or (is_comment and "*/" not in line)
    return "\n".join(found)


def _wrap_comment(line: str) -> list[str]:
    lead = line[: len(line) - len(line.lstrip())]
    star = f"{lead}{'' if line.lstrip().startswith('*') else ' '}* "
    found, rest = [], line
    while len(rest) > LONGEST:
        place = rest.rfind(" ", len(star), LONGEST + 1)
        if place < 0:
            break
        found.append(rest[:place].rstrip())
        rest = star + rest[place + 1 :]
    return [*found, rest]


def _wrap_statement(line: str) -> list[str]:
    last = " \\" if line.endswith("\\") else ""
    ending = " \\" if line.startswith("#define") else last
    line = line.removesuffix("\\").rstrip()
    lead = line[: len(line) - len(line.lstrip())] + INDENT
    found, rest = [], line
    while len(rest) + len(ending) > LONGEST:
        place = _find_break(rest, len(lead), LONGEST - len(ending))
        if place is None:
            break
        found.append(rest[:place].rstrip() + ending)
        rest = lead + rest[place:].lstrip()
    return [*found, rest + last]


def _find_break(line: str, first: int, last: int) -> int | None:
    """Return the last place up to `last` at which a line can break, outside of strings and comments."""
    closed = [match.span() for match in STRING.finditer(line)]
    places = [
        match.end()
        for match in BREAK.finditer(line)
        if first < match.end() and len(line[: match.end()].rstrip()) <= last
    ]
    places += [start for start, _ in closed if first < start <= last and line[start - 1] == " "]
    free = [place for place in places if not any(start < place < end for start, end in closed)]
    return max(free, default=None)
