"""The formats that scenes are made from, and which one given files have.

A format is a module `import_*.py` of this folder that defines its `Format` as `FORMAT`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

import numpy as np

from tensegrity_codegen.scene.formats.change_frame import UP_AXES, change_frame
from tensegrity_codegen.scene.formats.imported import ImportResult
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.system.checks import check_instance, check_path, is_number
from tensegrity_codegen.system.errors import InvalidValueError, check_choice


@dataclass(frozen=True)
class Format:
    """One format of files that describe a structure.

    title: what the files are, for people: "node and member tables (CSV)".
    sources: an example of each file that makes up one structure, in their order: ("nodes.csv",
        "members.csv").
    endings: endings of file names that the format is recognised by, in lower case; empty: any.
    read: reads the files: read(*paths, name=..., gravity=..., **options), raises SceneError.
    options: names of further arguments of `read`.
    order: place in lists of formats.
    instead: for options of other formats: what this one has in their place.
    recognises: whether the content of a file with a fitting ending is of this format; None: it is.
    """

    title: str
    sources: tuple[str, ...]
    endings: tuple[str, ...]
    read: Callable[..., ImportResult]
    options: tuple[str, ...] = ()
    order: int = 0
    instead: Mapping[str, str] = field(default_factory=dict)
    recognises: Callable[[Path], bool] | None = None

    @property
    def example(self) -> str:
        """Return the files as they stand on a command line."""
        return " ".join(self.sources)

    def fits(self, paths: Sequence[Path]) -> bool:
        """Return whether files have this format, by their number and the endings of their names."""
        endings = {path.suffix.lower() for path in paths}
        return len(paths) == len(self.sources) and (not self.endings or endings <= set(self.endings))


def find_formats() -> list[Format]:
    """Return all formats, in their order."""
    package = import_module("tensegrity_codegen.scene.formats")
    names = [entry.name for entry in iter_modules(package.__path__) if entry.name.startswith("import_")]
    formats = [import_module(f"{package.__name__}.{name}").FORMAT for name in names]
    return sorted(formats, key=lambda entry: entry.order)


def find_format(paths: Sequence[Path]) -> Format:
    """Return the format of some files: by their names, and by the content where names do not tell."""
    formats = find_formats()
    fitting = [candidate for candidate in formats if candidate.fits(paths)]
    for candidate in fitting:
        if candidate.recognises is None or candidate.recognises(paths[0]):
            return candidate
    problem = "these files have no known format"
    allowed = "; ".join(f"{candidate.example}: {candidate.title}" for candidate in formats)
    value = " ".join(str(path) for path in paths)
    raise InvalidValueError(problem, where="import", given=value, allowed=allowed)


def read_files(
    paths: Sequence[Path],
    *,
    name: str | None = None,
    gravity: Sequence[float] | None = None,
    up: str = "z",
    scale: float = 1.0,
    **options: Any,
) -> ImportResult:
    """Return the scene document that files in one of the formats describe, with notes."""
    check_instance(paths, (tuple, list), "paths", "a list of files")
    for path in paths:
        check_path(path, "paths")
    check_choice(up, UP_AXES, "axis", "up")
    if name is not None:
        check_instance(name, str, "name", "a text, or None")
    if gravity is not None:
        gravity = gravity.tolist() if isinstance(gravity, np.ndarray) else gravity
        is_vector = isinstance(gravity, list | tuple) and len(gravity) == 3
        if not is_vector or not all(is_number(value) for value in gravity):
            allowed = "three finite numbers [m/s2]"
            raise InvalidValueError("not an acceleration", where="gravity", given=gravity, allowed=allowed)
    paths = [Path(path) for path in paths]
    chosen = find_format(paths)
    stated = {key: value for key, value in options.items() if value is not None}
    for key, value in stated.items():
        if key not in chosen.options:
            titles = [candidate.title for candidate in find_formats() if key in candidate.options]
            problem = f"{chosen.title} are read without this option"
            allowed, hint = f"with {', '.join(titles)} only", chosen.instead.get(key, "")
            raise InvalidValueError(problem, where=key, given=value, allowed=allowed, hint=hint)
    if up == "z" and is_number(scale) and scale == 1.0:
        return chosen.read(*paths, name=name, gravity=gravity, **stated)
    result = chosen.read(*paths, name=name, gravity=None, **stated)
    where = str(paths[0])
    checked = parse_scene(result.document, where).to_document()
    document, notes = change_frame(checked, up, scale, where)
    if gravity is not None:
        document["gravity"] = [float(value) for value in gravity]
    return ImportResult(document, (*result.notes, *notes))
