"""What holds for the equilibrium of any structure, checked with the reference."""

import numpy as np
import pytest
from hypothesis import given

from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.structure.structure import Structure
from tests.cases import draws
from tests.random_structures import structures
from tests.reference import ReferenceModel


@pytest.mark.thorough
@draws(8)
@given(structures())
def test_a_found_equilibrium_balances_and_lies_no_higher(structure: Structure) -> None:
    model = ReferenceModel(structure)
    found = find_equilibrium(model, raise_on_failure=False)
    start = {"velocity": np.zeros(int(model.free.sum()))}
    at = {**start, "coordinate": found.coordinate}
    if found.status == "no_equilibrium":
        free_axes = [k for k, axis in enumerate(structure.axes) if not structure.node_anchored[:, axis].any()]
        total = model.compute("node_force", **start).sum(axis=0)[free_axes]
        assert np.abs(total).max() > 1e-6
        return
    assert found.status == "converged"
    residual = np.zeros((structure.n_nodes, len(structure.axes)))
    residual.ravel()[model.free] = model.compute("node_residual", **at)
    largest = np.abs(model.compute("member_tension", **at)).max()
    unstressed = 64 * np.finfo(float).eps * model.compute("tangent_stiffness", **at).diagonal().max(initial=0)
    bound = max(1e-9 * largest, unstressed * found.member_length.max())
    assert np.linalg.norm(residual, axis=1).max() <= bound
    before = model.compute("potential_energy", **start)
    assert model.compute("potential_energy", **at) <= before + 1e-12 * (1 + abs(before))
    assert found.smallest_eigenvalue > -1e-6
