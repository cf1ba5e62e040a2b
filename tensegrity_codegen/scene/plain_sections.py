"""The long and plain sections of a scene file, read as JSON: several times as fast as TOML in Python.

A section is plain if every line of it is `name = { key = value, ... }` with bare keys and with values that
TOML and JSON write alike: numbers, true, false, short texts without escapes, lists of these. So importers
write the nodes and members of a scene. All else, and every doubt, is left to the TOML reader.
"""

import json
import re
from typing import Any

LEAST_LENGTH = 100_000  # characters of a file for which it pays
_SECTIONS = ("nodes", "members")

_KEY = r"[A-Za-z0-9_-]{1,64}+"
_NUMBER = r"-?+(?:0|[1-9][0-9]{0,40}+)(?:\.[0-9]{1,40}+)?+(?:[eE][+-]?+[0-9]{1,4}+)?+"
_SCALAR = rf'(?:{_NUMBER}|"[A-Za-z0-9_.-]*+"|true|false)'
_LIST = rf"\[ *+{_SCALAR}(?: *+, *+{_SCALAR}){{0,15}}+ *+\]"
_PAIR = rf"{_KEY} *+= *+(?:{_SCALAR}|{_LIST})"
_LINE = rf"{_KEY} *+= *+\{{ *+{_PAIR}(?: *+, *+{_PAIR})*+ *+\}}"
_PLAIN = re.compile(rf"(?:(?:{_LINE})?+[ \t]*+\r?+\n)*+")
_ASSIGNED = re.compile(rf"({_KEY}) *+= *+")


def cut_plain_sections(text: str) -> tuple[str, dict[str, dict[str, Any]]]:
    """Return a scene's text without the lines of its plain sections, and what these lines state.

    The headers stay, and empty lines in the place of the others, so that the TOML reader finds a section
    that is there twice, and names lines by their numbers.
    """
    found: dict[str, dict[str, Any]] = {}
    if len(text) < LEAST_LENGTH or '"""' in text or "'''" in text:  # a long text could hold anything
        return text, found
    for name in _SECTIONS:
        header = re.compile(rf"^\[{name}\][ \t]*\r?\n", re.MULTILINE)
        headers = list(header.finditer(text)) if f"[{name}]" in text else []
        if len(headers) != 1:
            continue
        start = headers[0].end()
        match = _PLAIN.match(text, start)
        end = match.end() if match else start
        table = _read_table(text[start:end]) if text[end : end + 1] in ("", "[") else None
        if table:
            found[name] = table
            text = text[:start] + "\n" * text.count("\n", start, end) + text[end:]
    return text, found


def _read_table(lines: str) -> dict[str, Any] | None:
    """Return what plain lines state, None where a name or key stands twice or they are not plain after all.

    Python 3.11.2 matches possessive groups wrongly, so that _PLAIN lets `1.` and lists in lists through.
    """
    rows = [line for line in _ASSIGNED.sub(r'"\1":', lines).split("\n") if not line.isspace() and line]
    try:
        table: dict[str, dict[str, Any]] = json.loads("{" + ",".join(rows) + "}")
    except ValueError:
        return None
    whole = len(table) + sum(map(len, table.values())) == lines.count("=") and len(table) == len(rows)
    return table if whole else None
