"""Counts of self-stresses and motions without a model, against those of an analysis."""

import numpy as np
import pytest

from tensegrity_codegen.runtime.analysis.analyse import analyse
from tensegrity_codegen.runtime.analysis.rank import count_freedom
from tests.random_structures import make_structure
from tests.reference import ReferenceModel
from tests.runtime.build import cable
from tests.runtime.build import make_structure as make_chain

WANTS = dict.fromkeys(
    ("gravity", "damping", "loads", "velocity", "anchors", "bar_mass", "inputs", "slack"), False
)


@pytest.mark.parametrize("axes", [(0, 1, 2), (0, 2), (1,)])
@pytest.mark.parametrize("anchors", [True, False])
def test_counts_are_those_of_an_analysis(axes: tuple[int, ...], anchors: bool) -> None:
    for seed in range(2):
        structure = make_structure(np.random.default_rng(seed), 7, axes, WANTS | {"anchors": anchors})
        found, counted = analyse(ReferenceModel(structure)), count_freedom(structure)
        assert counted is not None
        assert counted.n_selfstress == len(found.rank.selfstress)
        assert counted.n_mechanisms == found.mechanism.shape[2]
        assert counted.n_rigid_motions == found.rigid_motion.shape[2]


def test_a_structure_of_thousands_of_members_is_not_counted() -> None:
    chain = make_chain([[k, 0, 0] for k in range(1502)], [cable(k, k + 1, 1.0) for k in range(1501)])
    assert count_freedom(chain) is None
