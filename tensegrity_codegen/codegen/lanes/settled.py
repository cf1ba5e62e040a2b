"""Checks for finite numbers by sums over members: no argument or result is looked at by itself.

spread = sum of d_e . d_e, pulled = sum of |t_e / l_e| over all members. Where both are below 1e200, each
force on a node is the external one and at most 1e200 times 1e100. Where a coordinate is not finite, spread
is not either.
"""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from tensegrity_codegen.symbolic.formulations.node_position import NodePosition

BOUND = "1e200"  # of spread and pulled
MOST_EXTERNAL = 1e290  # N


def is_settled(parts: NodePosition, arguments: Sequence[str]) -> bool:
    """Return whether a function of these arguments can be settled by sums over the members.

    It takes coordinates alone, each of a node that has a member, and external forces are numbers, not huge.
    """
    if list(arguments) != ["coordinate"]:
        return False
    joined = set(np.unique(parts.structure.connectivity).tolist())
    if not set(parts.map.coordinate_nodes()) <= joined:
        return False
    external = [ca.SX(value) for vector in parts.external_force for value in vector]
    return all(value.is_constant() and abs(float(value)) < MOST_EXTERNAL for value in external)
