"""Imported scenes in other axes and another unit of length: z becomes up, lengths become metres.

A change of the unit of length keeps masses and times: with metres per unit s, lengths, velocities and
accelerations are multiplied by s, and so are forces, which are mass times acceleration. Spring constants
(N/m = kg/s2) and damping constants (kg/s) keep their numbers, densities are divided by s^3, stresses by s.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from tensegrity_codegen.scene.names import key_path
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
MEMBER_POWERS = {
    "rest_length": 1,
    "prestress": 1,
    "axial_stiffness": 1,
    "density": -3,
    "radius": 1,
    "inner_radius": 1,
    "switch_elongation": 1,
    "switch_force": 1,
    "yield_elongation": 1,
    "yield_force": 1,
}
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
LARGEST_SCALE = 1e12  # densities scale by its third power


def change_frame(
    document: Mapping[str, Any], up: str = "z", scale: float = 1.0, where: str = "scene"
) -> tuple[dict[str, Any], list[str]]:
    """Return a valid scene document of nodes and members in other axes and units, and notes.

    up: the axis of the document that points up, which becomes z; scale: metres per unit of length of the
    document.
    """
    check_choice(up, UP_AXES, "axis", "up")
    if not (isinstance(scale, int | float) and 1.0 / LARGEST_SCALE <= scale <= LARGEST_SCALE):
        problem, allowed = "the value is out of range", f"{1.0 / LARGEST_SCALE:g} to {LARGEST_SCALE:g}"
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
