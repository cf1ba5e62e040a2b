"""Names that a text stands for: the one it is, else all those that match it as a pattern such as "top*"."""

from collections.abc import Mapping
from fnmatch import fnmatchcase

from tensegrity_codegen.system.errors import UnknownNameError, suggest


def find_matching(
    text: str, index: Mapping[str, int], where: str, allowed: str, problem: str = "unknown node"
) -> list[int]:
    """Return the rows of the names that a name or pattern stands for; raises UnknownNameError for none."""
    if text in index:
        return [index[text]]
    rows = [row for name, row in index.items() if fnmatchcase(name, text)]
    if not rows:
        hint = suggest(text[:80], index)
        raise UnknownNameError(problem, where=where, given=text[:80], allowed=allowed, hint=hint)
    return rows
