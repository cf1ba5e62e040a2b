"""Finished results of long work, one line of JSON each, so that interrupted work resumes where it stopped."""

import dataclasses
import json
import math
import time
import types
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn, TypeVar, get_args, get_origin, get_type_hints

from tensegrity_codegen.system.errors import OutputError
from tensegrity_codegen.system.files import write_text


@dataclass(frozen=True)
class Resumption:
    """Results that long work takes from an earlier run.

    subject: scene or chapter.
    what: what is counted, in the plural.
    taken, total: how many are taken, and how many there are in all.
    written: when the last of them was finished, as time.time() has it [s]; None if the journal does not
        say.
    is_stale: whether an earlier run has results that are not used, since something differs.
    """

    subject: str
    what: str
    taken: int
    total: int
    written: float | None
    is_stale: bool = False

    def as_dict(self) -> dict[str, Any]:
        """Return everything in JSON's types; `written` in ISO 8601, with the offset from UTC."""
        written = None
        if self.written is not None:
            written = time.strftime("%Y-%m-%dT%H:%M:%S%z", time.localtime(self.written))
        return {
            "subject": self.subject,
            "what": self.what,
            "taken": self.taken,
            "total": self.total,
            "written": written,
        }

    def describe(self, now: float) -> str:
        """Return one sentence: "prism: 12 of 40 cases taken from the unfinished run of 19:40"; now [s]."""
        if self.is_stale:
            return (
                f"{self.subject}: results of the run{self._name_time(now)} are not used: "
                "scene, options, code, packages or machine differ"
            )
        run = "unfinished run" if self.taken < self.total else "run"
        count = f"{self.taken} of {self.total}" if self.taken < self.total else f"all {self.total}"
        sentence = f"{self.subject}: {count} {self.what} taken from the {run}{self._name_time(now)}"
        return sentence if self.taken < self.total else f"{sentence}; `fresh=True` computes them again"

    def _name_time(self, now: float) -> str:
        if self.written is None:
            return " before"
        then = time.localtime(self.written)
        is_today = then[:3] == time.localtime(now)[:3]
        return time.strftime(" of %H:%M" if is_today else " of %Y-%m-%d %H:%M", then)


Record = TypeVar("Record")


class Journal:
    """A file of named results that belong to a key.

    The key is a hash of all that a result depends on: code, scene, options, machine. Results under
    another key are not used. A line that is cut off, as the last one after `kill -9`, or whose checksum is
    wrong is not used either: those results are computed again.

    path: the file, made when the first result is kept; None keeps results in memory only.
    key: of the results.
    fresh: whether to remove the results that belong to the key.
    notice: called with the results of an earlier run.
    """

    def __init__(
        self,
        path: Path | None,
        key: str = "",
        *,
        fresh: bool = False,
        notice: Callable[[Resumption], None] | None = None,
    ) -> None:
        self.path, self.key = path, key
        self._notice = notice
        self._values: dict[str, Any] = {}
        self._times: dict[bool, float | None] = {}  # of the last line, of this key or of another
        if path is not None and path.exists():
            if not path.is_file():
                problem = "the journal is no regular file"
                raise OutputError(problem, where=str(path), hint="remove it, or choose another folder")
            self._read(path.read_text(encoding="utf-8", errors="replace"))
            if fresh:
                self._forget(path)

    def find(self, name: str) -> Any:
        """Return the result of this name in JSON's types, None if there is none."""
        return self._values.get(name)

    def store(self, name: str, value: Any) -> None:
        """Keep a result, in JSON's types, and write it down at once."""
        self._values[name] = value
        if self.path is None:
            return
        data = {"key": self.key, "name": name, "time": round(time.time(), 3), "value": value}
        line = json.dumps(data | {"crc32": _compute_checksum(data)}, allow_nan=False) + "\n"
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("ab+") as file:
            if file.tell() > 0:
                file.seek(-1, 2)
                # After a line that was cut off a new one begins.
                line = line if file.read(1) == b"\n" else f"\n{line}"
            file.write(line.encode("utf-8"))

    def announce(self, subject: str, what: str, taken: int, total: int) -> None:
        """Say how many results of an earlier run are taken, or that those of another key are not.

        subject: scene or chapter; what: what is counted, in the plural; taken, total: how many are taken, and
        how many there are in all.
        """
        is_stale = not taken and False in self._times and True not in self._times
        if self._notice is not None and (taken or is_stale):
            written = self._times.get(not is_stale)
            self._notice(Resumption(subject, what, taken, total, written, is_stale))

    def _read(self, text: str) -> None:
        for line in text.split("\n"):
            entry = _read_line(line)
            if entry is None:
                continue
            key, name, value, written = entry
            self._times[key == self.key] = written
            if key == self.key:
                self._values[name] = value

    def _forget(self, path: Path) -> None:
        """Remove the results of this key, from the file too."""
        self._values.clear()
        self._times.clear()
        lines = path.read_text(encoding="utf-8", errors="replace").split("\n")
        intact = [line for line in lines if (entry := _read_line(line)) is not None and entry[0] != self.key]
        write_text("".join(f"{line}\n" for line in intact), path, overwrite=True)


def _read_line(line: str) -> tuple[str, str, Any, float | None] | None:
    """Return key, name, value and time of a line, None for another text."""
    try:
        data = json.loads(line, parse_constant=_refuse)
        key, name, value, written = data["key"], data["name"], data["value"], data.get("time")
        if data.pop("crc32") != _compute_checksum(data):
            return None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    if not isinstance(key, str) or not isinstance(name, str):
        return None
    return key, name, value, float(written) if _is_of(float, written) else None


def _compute_checksum(data: Mapping[str, Any]) -> int:
    return zlib.crc32(json.dumps(data, sort_keys=True).encode())


def read_record(kind: type[Record], data: Any) -> Record | None:
    """Return a flat dataclass from a JSON object, None if a field is missing, unknown or of another type.

    Fields are of type str, bool, int, float, or one of these and None; numbers must be finite.
    """
    hints = get_type_hints(kind)
    if not isinstance(data, Mapping) or set(data) != {f.name for f in dataclasses.fields(kind)}:  # type: ignore[arg-type]
        return None
    if not all(_is_of(hints[name], value) for name, value in data.items()):
        return None
    return kind(**data)


def _is_of(hint: Any, value: Any) -> bool:
    if get_origin(hint) is types.UnionType:
        return any(_is_of(option, value) for option in get_args(hint))
    if hint is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and _is_finite(value)
    if hint is int:
        return isinstance(value, int) and not isinstance(value, bool)
    return isinstance(value, hint)


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond all floats
        return False


def _refuse(word: str) -> NoReturn:
    raise ValueError(f"{word} in JSON")
