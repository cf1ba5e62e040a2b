"""Displacements which prove that no tensions have all cables in tension."""

import numpy as np
import pytest
from scipy.optimize import linprog

from tensegrity_codegen.runtime.analysis.certificate import Certificate, check_balanced, find_certificate
from tensegrity_codegen.runtime.analysis.prestress import find_prestress
from tensegrity_codegen.runtime.analysis.rank import find_rank
from tensegrity_codegen.system.errors import InvalidValueError
from tests.cases import thorough
from tests.runtime.analysis.plain import Plain, make_plain, prism


def check_proof(structure: Plain, proof: Certificate | None, rows: int | None = None) -> Certificate:
    """Measure the certificate by lengths of the displaced structure, not by the matrix."""
    assert proof is not None
    assert proof.is_verified
    motion = np.zeros_like(structure.position)
    motion.ravel()[: len(proof.displacement)] = proof.displacement
    vector = np.diff(structure.position[structure.pairs], axis=1)[:, 0]
    change = np.diff(motion[structure.pairs], axis=1)[:, 0]
    elongation = np.sum(vector * change, axis=1) / np.linalg.norm(vector, axis=1)
    np.testing.assert_allclose(elongation, proof.elongation, atol=1e-9 * max(1, np.abs(motion).max()))
    cables = elongation[structure.is_cable]
    assert np.abs(elongation[~structure.is_cable]).max(initial=0.0) < 1e-9
    assert cables.max(initial=0.0) < 1e-9
    if proof.shortening:
        assert cables.min() == pytest.approx(-1.0)
    return proof


@pytest.mark.parametrize("turn", [160, 150.01, 140, 179, 30])
def test_all_nine_cables_of_a_prism_shorten_equally(turn) -> None:
    structure = prism(3, np.radians(turn))
    proof = check_proof(structure, find_certificate(structure.matrix, structure.is_cable))
    assert proof.shortening == tuple(range(3, 12))
    np.testing.assert_allclose(proof.elongation[3:], -1.0, atol=1e-9)
    assert proof.bar_change < 1e-10
    motion = proof.displacement.reshape(6, 3)
    assert np.abs(motion.sum(axis=0)).max() < 1e-9 * np.abs(motion).max()  # no rigid motion in it


def test_none_where_all_cables_can_be_in_tension() -> None:
    for twist in (151, 180, 209):
        structure = prism(3, np.radians(twist), mirrored=True)
        assert find_certificate(structure.matrix, structure.is_cable) is None


def test_cables_that_can_only_be_slack_are_those_that_shorten() -> None:
    """A prism with one cable more from its axis to a free node: nothing pulls at its other end."""
    base = prism(3, np.radians(150))
    position = np.vstack([base.position, [[0.3, 0.0, 0.1]]])
    bars = [tuple(pair) for pair in base.pairs[:3]]
    structure = make_plain(position, bars, [*map(tuple, base.pairs[3:]), (0, 6)])
    proof = check_proof(structure, find_certificate(structure.matrix, structure.is_cable))
    assert proof.shortening == (12,)
    assert proof.least_shortening == pytest.approx(1.0)


@pytest.mark.parametrize("seed", [*range(4), *thorough(*range(4, 30))])
def test_exactly_one_of_prestress_and_certificate(seed) -> None:
    """Random structures with random bars: the theorem of the alternative, with every cable on one side."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(4, 9))
    pairs = [(i, j) for i in range(n) for j in range(i + 1, n) if rng.random() < 0.85]
    bars = int(rng.integers(0, len(pairs)))
    order = rng.permutation(len(pairs))
    structure = make_plain(
        rng.normal(size=(n, 3)), [pairs[k] for k in order[:bars]], [pairs[k] for k in order[bars:]]
    )
    found = find_rank(structure.matrix)
    prestress = find_prestress(found.selfstress, structure.is_cable)
    proof = find_certificate(structure.matrix, structure.is_cable, rank=found)
    assert (proof is None) is (prestress.is_found or not structure.is_cable.any())
    if proof is not None:
        check_proof(structure, proof)
        # Complementary: without the cables that shorten, the others can all be in tension.
        rest = np.array([e for e in range(len(pairs)) if e not in proof.shortening], dtype=np.int64)
        part = Plain(structure.position, structure.pairs[rest], structure.is_cable[rest])
        if part.is_cable.any():
            assert find_prestress(find_rank(part.matrix).selfstress, part.is_cable).is_found


@pytest.mark.parametrize("seed", [*range(4), *thorough(*range(4, 20))])
def test_exactly_one_of_prestress_and_certificate_under_loads(seed) -> None:
    """Either all cables are in tension, or in a motion that shortens cables loads do no negative work."""
    rng = np.random.default_rng(100 + seed)
    n = int(rng.integers(4, 8))
    pairs = [(i, j) for i in range(n) for j in range(i + 1, n) if rng.random() < 0.9]
    bars = int(rng.integers(0, len(pairs)))
    structure = make_plain(rng.normal(size=(n, 3)), pairs[:bars], pairs[bars:])
    matrix = structure.matrix[: 3 * n - 6]  # the last two nodes are held
    found = find_rank(matrix)
    pull = rng.normal(size=len(pairs))
    pull[structure.is_cable] += rng.choice([0.0, 3.0])
    load = matrix @ pull
    tension, _ = found.find_tension(load)
    prestress = find_prestress(found.selfstress, structure.is_cable, load_tension=tension)
    proof = find_certificate(matrix, structure.is_cable, load=load, rank=found)
    assert (proof is None) is prestress.is_found
    if proof is None:
        np.testing.assert_allclose(matrix @ prestress.tension, load, atol=1e-9 * np.abs(load).max())
        assert prestress.tension[structure.is_cable].min() > 0
    else:
        check_proof(structure, proof)
        assert load @ proof.displacement > -1e-9 * np.linalg.norm(load) * np.linalg.norm(proof.displacement)


def test_a_weight_that_nothing_carries() -> None:
    """A node that hangs on one cable may swing: a load across it does work at constant lengths."""
    structure = make_plain([[0, 0, 0], [0, 0, 1]], [], [(0, 1)])
    matrix = structure.matrix[:3]
    sideways = np.array([2.0, 0.0, 0.0])
    assert not check_balanced(find_rank(matrix), sideways)
    proof = check_proof(structure, find_certificate(matrix, structure.is_cable, load=sideways))
    assert proof.shortening == ()
    np.testing.assert_allclose(proof.displacement, [1, 0, 0], atol=1e-12)
    assert proof.load_work == pytest.approx(2.0)
    down, up = np.array([0.0, 0.0, -5.0]), np.array([0.0, 0.0, 5.0])
    assert check_balanced(find_rank(matrix), down)
    assert find_certificate(matrix, structure.is_cable, load=down) is None
    proof = check_proof(structure, find_certificate(matrix, structure.is_cable, load=up))
    np.testing.assert_allclose(proof.displacement, [0, 0, 1], atol=1e-12)
    assert proof.load_work == pytest.approx(5.0)
    assert proof.shortening == (0,)


def test_without_loads_a_single_cable_can_only_be_slack() -> None:
    structure = make_plain([[0, 0, 0], [0, 0, 1]], [], [(0, 1)])
    proof = check_proof(structure, find_certificate(structure.matrix, structure.is_cable))
    assert proof.shortening == (0,)
    assert proof.load_work == 0.0
    assert find_certificate(structure.matrix, ~structure.is_cable) is None  # a bar needs no tension


def test_wrong_shapes_are_refused() -> None:
    structure = prism(3, 2.5)
    with pytest.raises(InvalidValueError, match="tension_only"):
        find_certificate(structure.matrix, structure.is_cable[1:])
    with pytest.raises(InvalidValueError, match="load"):
        find_certificate(structure.matrix, structure.is_cable, load=np.zeros(3))


@pytest.mark.parametrize("seed", [*range(5), *thorough(*range(5, 40))])
def test_cables_that_may_be_slack_are_in_tension_or_not(seed) -> None:
    """Farkas with t > 0 for some cables and t >= 0 for the others, against an independent linear program."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 7))
    pairs = [(i, j) for i in range(n) for j in range(i + 1, n) if rng.random() < 0.8] or [(0, 1)]
    bars = int(rng.integers(0, len(pairs)))
    structure = make_plain(rng.normal(size=(n, 3)), pairs[:bars], pairs[bars:])
    matrix, cable = structure.matrix, structure.is_cable
    required = cable & (rng.random(len(pairs)) < rng.choice([0.0, 0.3]))
    load = matrix @ rng.normal(size=len(pairs)) if seed % 4 else np.zeros(len(matrix))
    proof = find_certificate(matrix, cable, load=load, required=required)
    # Without loads tensions can be scaled: 1 stands for any least tension. With loads a small one does.
    least = 1e-4 if load.any() else 1.0
    low = np.where(required, least, np.where(cable, 0.0, -np.inf))
    bounds = np.column_stack([low, np.full(len(low), np.inf)])
    exists = linprog(np.zeros(len(low)), A_eq=matrix, b_eq=load, bounds=bounds, method="highs").status == 0
    assert (proof is not None and proof.is_verified) is not exists
    if not exists:
        assert proof is not None
        elongation = matrix.T @ proof.displacement
        assert np.abs(elongation[~cable]).max(initial=0.0) < 1e-9
        assert elongation[cable].max(initial=0.0) < 1e-9
        work = float(load @ proof.displacement)
        assert work > -1e-9
        assert work > 1e-9 or elongation[required].min() < -1e-9
