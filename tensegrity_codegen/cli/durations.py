"""How long the passes of a command took when it ran before, so that the same command knows its time left."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from tensegrity_codegen.cli.option_names import quote_command
from tensegrity_codegen.codegen.compilation.cache_root import find_cache_root
from tensegrity_codegen.codegen.compilation.private_files import check_parents, check_private
from tensegrity_codegen.errors import TensegrityError
from tensegrity_codegen.files import replaced

__all__ = ["read_durations", "write_durations"]

FILE = "durations.json"  # in the cache folder
MOST = 300  # commands


def read_durations() -> dict[str, float]:
    """Return the time [s] of each pass of the running command when it ran before, empty if it did not."""
    return _read(find_cache_root() / FILE).get(_name_command(), {})


def write_durations(durations: Mapping[str, float]) -> None:
    """Remember the time [s] of each pass of the running command; where nothing can be written, nothing is.

    Passes that were not needed now, such as compilation, keep their time.
    """
    root, name = find_cache_root(), _name_command()
    if not root.is_dir() or not durations:
        return
    with suppress(OSError, TensegrityError):
        check_parents(root)
        check_private(root, root)
        known = _read(root / FILE)
        known[name] = known.pop(name, {}) | dict(durations)  # the latest last
        kept = dict(list(known.items())[-MOST:])
        with replaced(root / FILE) as temporary:
            temporary.write_text(json.dumps(kept), encoding="utf-8")


def _name_command() -> str:
    return hashlib.sha256(os.fsencode(f"{Path.cwd()}\n{quote_command()}")).hexdigest()[:16]


def _read(path: Path) -> dict[str, dict[str, float]]:
    """Return what the file holds in the right form; a damaged file is as good as none."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    found = data.items() if isinstance(data, dict) else ()
    return {name: _numbers(item) for name, item in found if isinstance(item, dict)}


def _numbers(item: Mapping[str, Any]) -> dict[str, float]:
    return {
        title: value for title, value in item.items() if isinstance(value, float) and 0.0 <= value < math.inf
    }
