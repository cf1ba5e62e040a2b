"""The motion with rigid bars as a series in time: each derivative is that of the one before along it."""

import casadi as ca
import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.arguments import SymbolicArguments
from tensegrity_codegen.symbolic.node_coordinates import NodeCoordinates
from tensegrity_codegen.symbolic.rigid_motion import BarConstraints, RigidMotion
from tests.cases import draws
from tests.random_structures import structures
from tests.symbolic.test_rigid_bar import make_rigid

FEW = draws(6)


@given(structures(most_nodes=9), st.integers(0, 2**32 - 1))
@FEW
def test_each_derivative_is_that_of_the_one_before(structure: Structure, seed: int) -> None:
    rigid = make_rigid(structure, seed)
    arguments = SymbolicArguments(rigid, {})
    nodes = NodeCoordinates(rigid, arguments)
    bars = [int(e) for e in np.flatnonzero(rigid.is_rigid)]
    motion = RigidMotion(nodes, BarConstraints(rigid, bars, nodes.map, nodes.inverse_mass))
    assume(np.linalg.cond(value_of(motion.matrix, arguments)) < 1e4)
    q, v = (arguments.symbols[name] for name in ("coordinate", "velocity"))

    def along(values: ca.SX) -> ca.SX:
        return ca.jtimes(values, ca.vertcat(q, v), ca.vertcat(v, motion.motion(0)))

    pairs = [(motion.motion(1), along(motion.motion(0)))]
    pairs += [(ca.vertcat(*motion.tensions(n + 1)), along(ca.vertcat(*motion.tensions(n)))) for n in (0, 1)]
    for found, expected in pairs:
        first, second = value_of(found, arguments), value_of(expected, arguments)
        assume(np.isfinite(second).all())
        assert np.abs(first - second).max() < 1e-8 * (np.abs(second).max() + 1.0)


def value_of(expression: ca.SX, arguments: SymbolicArguments) -> np.ndarray:
    """Return the value at the scene's own state."""
    items = arguments.ordered()
    function = ca.Function("f", [item.symbol for item in items.values()], [ca.densify(expression)])
    return np.array(function(*[item.nominal for item in items.values()]))
