"""Where the cache of compiled libraries is."""

import os
import tempfile
import warnings
from pathlib import Path

from platformdirs import user_cache_path

CACHE_VARIABLE = "TENSEGRITY_CODEGEN_CACHE"


class CacheFolderWarning(UserWarning):
    """The cache is not where it usually is."""


def find_cache_root() -> Path:
    """Return the cache folder of this user, which need not exist yet.

    It is the folder that TENSEGRITY_CODEGEN_CACHE names, else the user's cache folder, else (a home that may
    not be written to) a folder of this user among the temporary files.
    """
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return Path(chosen).expanduser().absolute()
    usual = user_cache_path("tensegrity_codegen").absolute()
    return usual if _may_be_written(usual) else _fallback()


def warn_of_fallback(root: Path) -> None:
    """Warn with CacheFolderWarning if `root` is the fallback among the temporary files."""
    if os.environ.get(CACHE_VARIABLE) or root != _fallback():
        return
    usual = user_cache_path("tensegrity_codegen")
    warnings.warn(
        f"the cache folder {usual} cannot be written; compiled libraries are kept in {root} for now; "
        f"set {CACHE_VARIABLE} to a folder that can be written",
        CacheFolderWarning,
        stacklevel=3,
    )


def _fallback() -> Path:
    owner = os.geteuid() if hasattr(os, "geteuid") else "user"
    return Path(tempfile.gettempdir()).absolute() / f"tensegrity_codegen_cache_{owner}"


def _may_be_written(folder: Path) -> bool:
    """Return whether a folder can be written, or made; nothing is made to find out."""
    place = folder
    while not os.path.lexists(place) and place != place.parent:
        place = place.parent
    return os.access(place, os.W_OK | os.X_OK)
