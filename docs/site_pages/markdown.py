"""Plain text as Markdown."""

import re

SPECIAL = re.compile(r"([\\*_<>\[\]#|$])")


def escape(text: str) -> str:
    """Return text with the characters escaped that Markdown would read; code in backticks is kept."""
    parts = re.split(r"(`[^`]*`)", text)
    parts[::2] = [SPECIAL.sub(r"\\\1", part) for part in parts[::2]]
    return "".join(parts)


def write_item(term: str, sentence: str) -> str:
    """Return one entry of a definition list."""
    return f"{term}\n: {sentence or 'No description.'}\n"
