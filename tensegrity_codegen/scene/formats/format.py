"""The formats that scenes are made from, and which one given files have.

A format is a module `import_*.py` of this folder that defines its `Format` as `FORMAT`.

Imported scenes may have other axes and another unit of length: z becomes up, lengths become metres. A change
of the unit of length keeps masses and times: with metres per unit s, lengths, velocities and accelerations
are multiplied by s, and so are forces, which are mass times acceleration. Spring constants (N/m = kg/s2) and
damping constants (kg/s) keep their numbers, densities are divided by s^3, stresses by s.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

import numpy as np

from tensegrity_codegen.scene.formats.imported import ImportResult
from tensegrity_codegen.scene.names import key_path
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.system.checks import check_instance, check_path, is_number
from tensegrity_codegen.system.errors import InvalidValueError, check_choice

# The axis of the file that points up -> for each axis of the scene: axis of the file, and sign.
UP_AXES: Mapping[str, tuple[tuple[int, float], ...]] = {
    "x": ((1, 1.0), (2, 1.0), (0, 1.0)),
    "y": ((0, 1.0), (2, -1.0), (1, 1.0)),
    "z": ((0, 1.0), (1, 1.0), (2, 1.0)),
}
LETTERS = "xyz"
# Keys that are vectors, by section.
VECTORS = {"nodes": ("position", "velocity"), "loads": ("force",), "inputs": ("direction",)}
# Powers of the unit of length in the values of a scene, by section and key; others have none.
_PROPORTIONAL = (
    *("rest_length", "prestress", "axial_stiffness", "radius", "inner_radius"),
    *("switch_elongation", "switch_force", "yield_elongation", "yield_force"),
)
MEMBER_POWERS = dict.fromkeys(_PROPORTIONAL, 1) | {"density": -3}
LIMIT_POWERS = {"least_tension": 1, "most_tension": 1, "yield_stress": -1, "clearance": 1}
POWERS: Mapping[str, Mapping[str, int]] = {
    "nodes": {"position": 1, "velocity": 1},
    "members": MEMBER_POWERS,
    "classes": MEMBER_POWERS,
    "loads": {"force": 1},
    "actuators": {"rate": 1, "range": 1},
    "sensors": {"noise": 1},
}
# Sections that have neither vectors nor lengths.
PLAIN = ("name", "model", "parameters", "groups", "interference")
CHANGED = (*POWERS, "inputs", "limits", "gravity", "axes")
MAX_SCALE = 1e12  # densities scale by its third power


def change_frame(
    document: Mapping[str, Any], up: str = "z", scale: float = 1.0, where: str = "scene"
) -> tuple[dict[str, Any], list[str]]:
    """Return a valid scene document with `up` as z and lengths times `scale` [m], and notes."""
    check_choice(up, UP_AXES, "axis", "up")
    if not (isinstance(scale, int | float) and 1.0 / MAX_SCALE <= scale <= MAX_SCALE):
        problem, allowed = "the value is out of range", f"{1.0 / MAX_SCALE:g} to {MAX_SCALE:g}"
        hint = "metres per unit of length of the file, such as 0.001 for millimetres"
        raise InvalidValueError(problem, where="scale", given=scale, allowed=allowed, hint=hint)
    for key in document:
        if key not in (*PLAIN, *CHANGED):
            problem = "a scene with this section keeps its axes and units"
            allowed = f"`up` and `scale` for scenes of {', '.join(CHANGED)}"
            hint = "import without `up` and `scale`"
            raise InvalidValueError(problem, where=key_path(where, key), allowed=allowed, hint=hint)
    changed = dict(document)
    if up != "z":
        changed = _turn(changed, UP_AXES[up])
    if scale != 1.0:
        changed = _scale(changed, float(scale))
    return changed, _note(up, scale)


def _note(up: str, scale: float) -> list[str]:
    notes = []
    if up != "z":
        signs = {1.0: "", -1.0: "-"}
        new = ", ".join(signs[sign] + LETTERS[axis] for axis, sign in UP_AXES[up])
        notes.append(
            f"{up} is up in the file: its (x, y, z) became ({new}); positions, velocities, loads, gravity, "
            "anchored axes and directions of inputs are rotated"
        )
    if scale != 1.0:
        notes.append(
            f"lengths are multiplied by {scale:g}; masses, times, spring constants and dampings keep their "
            "numbers; velocities, forces (prestress, axial stiffness, loads, limits) and the file's gravity "
            "are multiplied too"
        )
    return notes


def _turn(document: dict[str, Any], axes: Sequence[tuple[int, float]]) -> dict[str, Any]:
    """Return the document rotated."""
    modelled = [LETTERS.index(letter) for letter in document.get("axes", LETTERS)]
    turned = dict(document)
    for section, keys in VECTORS.items():
        for entry, change in _entries(turned, section):
            change({key: _turn_vector(entry[key], modelled, axes) for key in keys if key in entry})
    for entry, change in _entries(turned, "nodes"):
        if isinstance(entry.get("anchored"), str):
            change({"anchored": _turn_letters(entry["anchored"], axes)})
    if "gravity" in turned:
        turned["gravity"] = _turn_vector(turned["gravity"], modelled, axes)
    if "axes" in turned:
        turned["axes"] = _turn_letters(turned["axes"], axes)
    return turned


def _scale(document: dict[str, Any], scale: float) -> dict[str, Any]:
    """Return the document in another unit of length."""
    scaled = dict(document)
    for section, powers in POWERS.items():
        for entry, change in _entries(scaled, section):
            change({key: _multiply(entry[key], scale ** powers[key]) for key in powers if key in entry})
    if "gravity" in scaled:
        scaled["gravity"] = _multiply(scaled["gravity"], scale)
    if "limits" in scaled:
        scaled["limits"] = _scale_limits(scaled["limits"], scale)
    return scaled


def _scale_limits(limits: Mapping[str, Any], scale: float) -> dict[str, Any]:
    return {
        key: {name: _scale_limits(entry, scale) for name, entry in value.items()}
        if isinstance(value, Mapping)
        else _multiply(value, scale ** LIMIT_POWERS[key])
        if key in LIMIT_POWERS
        else value
        for key, value in limits.items()
    }


def _entries(document: dict[str, Any], section: str) -> list[tuple[Any, Any]]:
    """Return the entries of a section, each with a function that changes keys of its copy in `document`."""
    content = document.get(section)
    if not content:
        return []
    copy: Any = dict(content) if isinstance(content, Mapping) else list(content)
    document[section] = copy
    keys = list(copy) if isinstance(copy, dict) else range(len(copy))

    def changer(key: Any) -> Any:
        def change(values: Mapping[str, Any]) -> None:
            copy[key] = {**copy[key], **values}

        return change

    return [(copy[key], changer(key)) for key in keys]


def _turn_vector(
    vector: Sequence[float], modelled: Sequence[int], axes: Sequence[tuple[int, float]]
) -> list[float]:
    """Return the three numbers of a vector, which has three or one for each modelled axis, rotated."""
    components = dict(zip(modelled if len(vector) == len(modelled) else range(3), vector, strict=True))
    return [sign * float(components.get(axis, 0.0)) + 0.0 for axis, sign in axes]  # no -0.0


def _turn_letters(letters: str, axes: Sequence[tuple[int, float]]) -> str:
    return "".join(LETTERS[new] for new, (old, _) in enumerate(axes) if LETTERS[old] in letters)


def _multiply(value: Any, factor: float) -> Any:
    if isinstance(value, list | tuple):
        return [float(number) * factor for number in value]
    return float(value) * factor


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
    with result.locate_errors():
        checked = parse_scene(result.document, where).to_document()
    document, notes = change_frame(checked, up, scale, where)
    if gravity is not None:
        document["gravity"] = [float(value) for value in gravity]
    return ImportResult(document, (*result.notes, *notes), result.places)
