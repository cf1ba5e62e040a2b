"""Rows as they are measured, one line of JSON each, so that an interrupted report goes on where it was."""

from __future__ import annotations

import json
from pathlib import Path

from tensegrity_codegen.studies.work_precision.row import Row

__all__ = ["Journal"]


class Journal:
    """A file of rows below a key that says what they belong to; rows of another key are not read.

    path: the file, made when the first row is kept; a last line that was cut off is left out.
    """

    def __init__(self, path: Path, key: str) -> None:
        self.path, self.key = path, key
        self.rows: dict[tuple[str, float], Row] = {}
        for line in self._lines():
            row = Row.from_dict(line)
            self.rows[row.contender, row.setting] = row

    def find(self, contender: str, setting: float) -> Row | None:
        """Return the row that was kept, if any."""
        return self.rows.get((contender, setting))

    def keep(self, row: Row) -> None:
        """Write a row down at once."""
        self.rows[row.contender, row.setting] = row
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"key": self.key, "row": row.as_dict()}) + "\n")

    def _lines(self) -> list[dict[str, object]]:
        found = []
        try:
            text = self.path.read_text(encoding="utf-8", errors="replace")
        except FileNotFoundError:
            return []
        for line in text.splitlines():
            try:
                data = json.loads(line)
                if data["key"] == self.key:
                    found.append(data["row"])
            except (ValueError, KeyError, TypeError):
                continue
        return found
