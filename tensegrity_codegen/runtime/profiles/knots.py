"""Profiles as the C integrators read them."""

from typing import Any, TypeGuard

import numpy as np

from tensegrity_codegen.runtime.profiles.driven import DrivenArguments
from tensegrity_codegen.tables.manifest import Manifest

SLACK = 1e-12  # of the last time, by which n steps of a fixed length may end beyond it


class KnotsInC:
    """The struct that an integration in C follows, and the arrays that it points to.

    Raises KeyError for an argument that the integrators of the library do not take over time.
    """

    def __init__(self, ffi: Any, manifest: Manifest, driven: DrivenArguments) -> None:
        first = _find_places(manifest)
        pieces = driven.pieces
        time = pieces.time.copy()
        time[-1] += SLACK * abs(time[-1])
        n_pieces, rows, n_values = pieces.coefficient.shape
        self._arrays = (
            np.array([first[name] + k for name, k in driven.place], dtype=np.int32),
            time,
            np.ascontiguousarray(pieces.coefficient, dtype=np.float64),
            np.ascontiguousarray(pieces.is_kink, dtype=np.int32),
        )
        kinds = ("int[]", "double[]", "double[]", "int[]")
        names = ("place", "time", "coefficient", "is_kink")
        self._kept = [ffi.from_buffer(kind, array) for kind, array in zip(kinds, self._arrays, strict=True)]
        self.struct = ffi.new("integrator_profile *")
        self.struct.n_pieces, self.struct.degree, self.struct.n_values = n_pieces, rows - 1, n_values
        for name, pointer in zip(names, self._kept, strict=True):
            setattr(self.struct, name, pointer)


def follows_in_c(schedule: Any, manifest: Manifest) -> TypeGuard[DrivenArguments]:
    """Return whether the C integrators of a library can follow a schedule."""
    if not isinstance(schedule, DrivenArguments):
        return False
    return all(name in manifest.driven for name, _ in schedule.place)


def _find_places(manifest: Manifest) -> dict[str, int]:
    """Return where each argument begins among the numbers that can change with time."""
    found, place = {}, 0
    for name in manifest.driven:
        found[name] = place
        place += len(manifest.argument(name).nominal) if name != "pull" else 0  # which stands last
    return found
