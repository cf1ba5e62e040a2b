"""What the samples of a motion take in memory, and how many of them a structure may have."""

from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.manifest import Manifest

MOST_BYTES = 8 * 2**30  # of all arrays of a trajectory


def check_sample_memory(manifest: Manifest, samples: int) -> None:
    """Raise InvalidValueError where the arrays of a trajectory would exceed MOST_BYTES.

    Each sample keeps two states (of the run and of the one it is compared with), positions and velocities
    of nodes and tensions of members, all in double precision.
    """
    states = 2 * len(manifest.coordinate_name)
    row = 8 * (2 * states + 6 * len(manifest.node_name) + len(manifest.member_name))
    if samples * row > MOST_BYTES:
        raise InvalidValueError(
            "too many samples: they would not fit into memory",
            where="samples",
            given=f"{samples} samples, {samples * row / 2**30:.1f} GiB",
            allowed=f"at most {max(2, MOST_BYTES // row)} for {len(manifest.member_name)} members",
            hint="take fewer samples, or simulate in parts",
        )
