"""Linear models with rigid bars: pendulums by hand, and stiff bars in the limit."""

import numpy as np
import pytest

from tensegrity_codegen.runtime.linear.linearize import linearize, linearize_quantities
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.statics.equilibrium import equilibrium_quantities, find_equilibrium
from tensegrity_codegen.structure.structure import Structure
from tests.models import load
from tests.reference import ReferenceModel
from tests.runtime.build import bar, cable, make_structure
from tests.runtime.rigid_reference import stiffened

DOWN = (0.0, 0.0, -9.81)


def compile_rigid(structure: Structure) -> CompiledModel:
    formulation = "rigid_bar"
    quantities = (*linearize_quantities(formulation, with_inputs=False), *equilibrium_quantities(formulation))
    return load(structure, *quantities, formulation=formulation)


def test_a_pendulum_swings_alike_at_rest_and_on_its_way_through() -> None:
    """theta'' = -(g/l) sin theta has the same linear model wherever theta = 0, whatever theta'."""
    structure = make_structure(
        [[0, 0, 0], [0, 0, -2]], [bar(0, 1, 2.0, 0.0)], anchored={0: "xz"}, axes="xz", gravity=DOWN
    )
    model = compile_rigid(structure)
    swing = np.sqrt(9.81 / 2.0) / (2 * np.pi)
    for velocity in ([0.0, 0.0], [1.5, 0.0]):
        found = linearize(model, velocity=velocity)
        assert found.natural_frequency == pytest.approx([swing], rel=1e-12)
        assert found.variation.shape == (4, 2)
        assert found.spectrum.zero_eigenvalues == 0
    raised = np.array([np.sin(1.0), -np.cos(1.0)]) * 2
    found = linearize(model, coordinate=raised)
    assert found.natural_frequency == pytest.approx([swing * np.sqrt(np.cos(1.0))], rel=1e-12)


def test_rigid_bars_vibrate_as_stiff_ones_do_without_their_own_vibration() -> None:
    place = [[0, 0, 0], [1, 0, 0], [2, 0.2, 0], [2, 0, 2], [0, 0, 2]]
    length = [float(np.linalg.norm(np.subtract(place[i], place[i + 1]))) for i in range(2)]
    members = [bar(0, 1, length[0], 0.0), bar(1, 2, length[1], 0.0, mass=0.7)]
    members += [cable(2, 3, 1.5, 60.0, damping=0.3), cable(1, 4, 1.8, 50.0)]
    structure = make_structure(place, members, anchored={0: "xyz", 3: "xyz", 4: "xyz"}, gravity=DOWN)
    model = compile_rigid(structure)
    settled = find_equilibrium(model)
    found = linearize(model, coordinate=settled.coordinate, velocity=0 * settled.coordinate)
    stiff = ReferenceModel(stiffened(structure, 1e8))
    exact = linearize(stiff, coordinate=find_equilibrium(stiff).coordinate)
    assert found.natural_frequency.size == exact.natural_frequency.size - 2
    size = found.natural_frequency.size
    np.testing.assert_allclose(found.natural_frequency, exact.natural_frequency[:size], rtol=1e-4)
    np.testing.assert_allclose(found.damping_ratio, exact.damping_ratio[:size], rtol=1e-4, atol=1e-9)
    at_rest = found.A @ found.variation
    kept = found.variation @ np.linalg.pinv(found.variation.toarray()) @ at_rest
    assert np.abs(kept - at_rest).max() < 1e-9 * np.abs(at_rest).max()
