"""Content hashes: the same structure and request give the same hash, on every machine."""

import dataclasses
import functools
import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.request import ModelRequest

# Fields of a structure and a request that count only if they hold something.
ONLY_IF_ANY = (
    *("law_parameter", "inner_radius", "driven", "ground", "collision", "columns", "directions"),
    *("gain", "ring_nodes", "sliding", "bodies", "stick_arm", "copies"),
)
# Fields of a structure that no library depends on; expansion is in its inputs, and so are actuators, but for
# their lag.
NOT_IN_CODE = ("actuators", "sensors", "limits", "thermal_expansion", "is_large", "notes")
PLAIN_TYPES = frozenset({bool, int, str})


def hash_scene(structure: Structure | BodySystem, request: ModelRequest) -> str:
    """Return the sha256 of a structure and a request, 64 hexadecimal digits."""
    content = {"structure": _plain(structure), "request": _plain(request)}
    return hash_text(json.dumps(content, sort_keys=True, separators=(",", ":")))


def hash_structure(structure: Structure | BodySystem) -> str:
    """Return the sha256 of a structure alone, 64 hexadecimal digits."""
    return hash_text(json.dumps(_plain(structure), sort_keys=True, separators=(",", ":")))


def hash_request(request: ModelRequest) -> str:
    """Return the sha256 of a request, 64 hexadecimal digits."""
    return hash_text(json.dumps(_plain(request), sort_keys=True, separators=(",", ":")))


def hash_text(*texts: str) -> str:
    """Return the sha256 of texts, each told apart from its neighbours by its length."""
    digest = hashlib.sha256()
    for text in texts:
        data = text.encode("utf-8")
        digest.update(str(len(data)).encode("ascii") + b":" + data)
    return digest.hexdigest()


@functools.cache
def hash_package(*folders: Path) -> str:
    """Return the sha256 of every source file below `folders`, so that a changed generator is noticed."""
    digest = hashlib.sha256()
    for folder in folders:
        for name in _list_sources(folder):
            with open(os.path.join(folder, name), "rb") as file:  # noqa: PTH118, PTH123 - half of pathlib's time
                data = file.read()
            path = name.replace(os.sep, "/").encode("utf-8")
            digest.update(b"%d:%s%d:" % (len(path), path, len(data)))
            digest.update(data)
    return digest.hexdigest()


@functools.cache
def hash_package_state(*folders: Path) -> str:
    """Return the sha256 of names, sizes and times of every source file below `folders`.

    It takes a quarter of the time of hash_package, and differs between copies of the same files.
    """
    states = []
    for folder in folders:
        for name in _list_sources(folder):
            status = os.stat(os.path.join(folder, name))  # noqa: PTH116, PTH118 - half of pathlib's time
            states.append(f"{name} {status.st_size} {status.st_mtime_ns} {status.st_ctime_ns}")
    return hash_text(*map(str, folders), *states)


def _list_sources(folder: Path) -> list[str]:
    """Return the names of the source files below a folder, relative to it."""
    top, paths = len(str(folder)) + 1, list[str]()
    for folder_path, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if name != "__pycache__"]
        sources = (name for name in names if name.endswith((".py", ".j2", ".c", ".h")))
        paths += [os.path.join(folder_path[top:], name) for name in sources]  # noqa: PTH118
    return sorted(paths)


def _is_empty(value: Any) -> bool:
    return value is None or value is False or (hasattr(value, "__len__") and not len(value))


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        lagging = getattr(value, "lagging_actuators", {})
        late = {
            "lagging": [
                _plain((actuator.name, actuator.rate, actuator.time_constant))
                for actuator in lagging.values()
            ]
        }
        return (late if lagging else {}) | {
            name: _plain(field_value)
            for name, field_value in fields.items()
            if name not in NOT_IN_CODE and not (name in ONLY_IF_ANY and _is_empty(field_value))
        }
    if isinstance(value, np.ndarray):
        data = np.ascontiguousarray(value)
        little = data.astype(data.dtype.newbyteorder("<"))
        return [str(little.dtype.str), list(data.shape), hashlib.sha256(little.tobytes()).hexdigest()]
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        plain = PLAIN_TYPES.issuperset(map(type, value))  # names and indices, of which there are many
        return list(value) if plain else [_plain(element) for element in value]
    if isinstance(value, float):
        return value.hex()
    return value
