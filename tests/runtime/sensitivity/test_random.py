"""Sensitivities of random structures against differences of equilibria: tensions, which need no gauge."""

import numpy as np
import pytest

from tensegrity_codegen.runtime.sensitivity.sensitivity import equilibrium_sensitivity
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import SingularStiffnessError
from tests.cases import thorough
from tests.reference import ReferenceModel
from tests.runtime.build import cable, make_structure, spring

STEP = 1e-5  # of the rest lengths


def draw_structure(rng: np.random.Generator) -> Structure:
    """Return nodes in one to three dimensions, some of them held on some axes, with cables and springs."""
    count, dimensions = int(rng.integers(3, 9)), int(rng.integers(1, 4))
    axes = "xyz"[:dimensions]
    position = np.zeros((count, 3))
    position[:, :dimensions] = rng.uniform(-1, 1, (count, dimensions))
    pairs = [(i, j) for i in range(count) for j in range(i)]
    rng.shuffle(pairs)
    members = []
    for i, j in pairs[: int(rng.integers(count, 3 * count))]:
        rest = float(np.linalg.norm(position[i] - position[j]) * rng.uniform(0.7, 1.1))
        mu = float(10 ** rng.uniform(1, 3))
        law = {"mu": mu} if rng.random() < 0.5 else {"mu": 0.0, "axial": mu * rest}
        members.append((cable if rng.random() < 0.67 else spring)(int(i), int(j), rest, **law))
    held = {node: "".join(axis for axis in axes if rng.random() < 0.8) for node in rng.permutation(count)[:2]}
    pull = np.zeros(3)
    pull[dimensions - 1] = -3.0 * float(rng.random() < 0.5)
    anchored = {int(node): letters for node, letters in held.items() if letters}
    return make_structure(position, members, anchored=anchored, axes=axes, gravity=tuple(pull))


def compare(seed: int) -> float | None:
    """Return the largest error of dt/drho d over its size, None where it has no two-sided value."""
    rng = np.random.default_rng(seed)
    structure = draw_structure(rng)
    model = ReferenceModel(structure)
    start = find_equilibrium(model, tolerance=1e-13, raise_on_failure=False)
    if not start.is_found:
        return None
    try:
        found = equilibrium_sensitivity(model, start)
    except SingularStiffnessError:
        return None
    direction = rng.uniform(-1, 1, structure.n_members) * structure.rest_length
    tensions = []
    for sign in (1, -1):
        arguments = {"rest_length": structure.rest_length + sign * STEP * direction}
        changed = find_equilibrium(
            model, coordinate=start.coordinate, arguments=arguments, tolerance=1e-13, raise_on_failure=False
        )
        if found.one_sided or not changed.is_found:
            return None
        tensions.append(changed.member_tension)
    difference = (tensions[0] - tensions[1]) / (2 * STEP)
    scale = max(np.abs(difference).max(), 1e-4 * float((structure.mu * structure.rest_length).max()))
    return float(np.abs(difference - found.tension @ direction).max() / scale)


@pytest.mark.thorough
@pytest.mark.parametrize("first", [0, *thorough(100, 200, 300)])
def test_tensions_follow_as_differences_of_equilibria_say(first: int) -> None:
    count = 20 if first == 0 else 100
    errors = [error for seed in range(first, first + count) if (error := compare(seed)) is not None]
    assert len(errors) > count / 4
    assert max(errors) < 1e-4
