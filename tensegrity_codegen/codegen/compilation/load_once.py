"""Load a library once and compare it with its manifest.

A script, run as `python -I -S load_once.py LIBRARY NAME ABI_VERSION SCENE_HASH SYMBOL...` in a process of its
own, since a bad library may crash on loading; never imported by the package. Prints what is wrong and ends
with 1 then.
"""

import ctypes
import sys


class Description(ctypes.Structure):
    """The first fields of a library's descriptor, as templates/scene.h.j2 has them."""

    _fields_ = [
        ("abi_version", ctypes.c_int),
        ("name", ctypes.c_char * 64),
        ("scene_hash", ctypes.c_char * 65),
    ]


def main(path: str, name: str, abi_version: str, scene_hash: str, *symbols: str) -> str:
    """Return the fault of the library at `path`, "" if there is none."""
    try:
        library = ctypes.CDLL(path)
    except OSError as error:
        return str(error)
    try:
        descriptor = Description.in_dll(library, f"{name}_descriptor")
    except ValueError:
        return f"it has no symbol {name}_descriptor"
    if (descriptor.abi_version, descriptor.name.decode("ascii", "replace")) != (int(abi_version), name):
        return "it describes itself as another library"
    if descriptor.scene_hash.decode("ascii", "replace") != scene_hash:
        return "it was made from another scene"
    missing = [symbol for symbol in symbols if not hasattr(library, symbol)]
    return f"it has no symbol {', '.join(missing[:5])}" if missing else ""


if __name__ == "__main__":
    problem = main(*sys.argv[1:])
    sys.stdout.write(problem)
    sys.exit(1 if problem else 0)
