"""Tensions with every cable in tension."""

import numpy as np
import pytest

from tensegrity_codegen.runtime.analysis.certificate import find_certificate
from tensegrity_codegen.runtime.analysis.prestress import find_prestress
from tensegrity_codegen.runtime.analysis.rank import find_rank
from tests.cases import thorough
from tests.runtime.analysis.plain import Plain, icosahedron, make_plain, prism


def is_feasible(structure: Plain) -> bool:
    found = find_rank(structure.matrix)
    prestress = find_prestress(found.selfstress, structure.is_cable)
    proof = find_certificate(structure.matrix, structure.is_cable, rank=found)
    if not prestress.is_found:
        assert proof is not None
        assert proof.is_verified
    return prestress.is_found


def test_prism_in_closed_form() -> None:
    """Equal radii: side cables to ring cables as 2 sin(pi/p) r to the length of a side cable's plan."""
    structure = prism(3, np.radians(150))
    found = find_prestress(find_rank(structure.matrix).selfstress, structure.is_cable)
    assert found.is_found
    bar, ring, side = found.tension[0], found.tension[3], found.tension[9]
    np.testing.assert_allclose(found.tension, [bar] * 3 + [ring] * 6 + [side] * 3, rtol=1e-12)
    length = np.linalg.norm(np.diff(structure.position[structure.pairs], axis=1)[:, 0], axis=1)
    density = found.tension / length
    assert density[0] == pytest.approx(-density[9], rel=1e-12)  # vertical forces balance
    assert density[3] == pytest.approx(density[9] / np.sqrt(3), rel=1e-12)
    assert found.largest_force == pytest.approx(1.0)
    assert found.least_tension == pytest.approx(ring)


def test_icosahedron_in_closed_form() -> None:
    """Cables of one force density, bars -3/2 of it."""
    structure = icosahedron()
    found = find_prestress(find_rank(structure.matrix).selfstress, structure.is_cable)
    np.testing.assert_allclose(found.tension[:6], -1.0, rtol=1e-12)
    np.testing.assert_allclose(found.tension[6:], np.sqrt(3 / 8) / 1.5, rtol=1e-12)


@pytest.mark.parametrize("p", [3, *thorough(4, 5, 6)])
def test_range_of_twists_of_the_mirrored_prism(p) -> None:
    """All cables are in tension for twists between 90 + 180/p and 270 - 180/p degrees, and only there."""
    low, high = np.radians([90 + 180 / p, 270 - 180 / p])
    for end, inward in ((low, 1.0), (high, -1.0)):
        inner, outer = end + inward * 0.02, end - inward * 0.02
        for _ in range(18):
            middle = (inner + outer) / 2
            if is_feasible(prism(p, middle, mirrored=True)):
                inner = middle
            else:
                outer = middle
        assert abs(inner - end) < 3e-7
    for twist in np.linspace(low + 1e-6, high - 1e-6, 7):
        assert is_feasible(prism(p, twist, mirrored=True))
    for twist in np.radians([10, 60, 89 + 180 / p, 271 - 180 / p, 300, 350]):
        assert not is_feasible(prism(p, twist, mirrored=True))


def test_prism_without_them_at_one_twist_alone() -> None:
    """Within 6e-6 rad, where the singular value counts as zero."""
    for turn in (0.0, 1e-7, -1e-7):
        assert is_feasible(prism(3, np.radians(150) + turn))
    for turn in (1e-5, -1e-5, 1e-3, np.radians(10), np.radians(60)):
        assert not is_feasible(prism(3, np.radians(150) + turn))


def test_largest_least_tension_and_symmetry() -> None:
    """Of many optimal tensions those of least norm have the structure's symmetry."""
    for p in (3, 4, 6):
        structure = prism(p, np.radians(180), mirrored=True)
        basis = find_rank(structure.matrix).selfstress
        found = find_prestress(basis, structure.is_cable)
        group = found.tension.reshape(-1, p)
        np.testing.assert_allclose(group, group[:, :1] * np.ones(p), atol=2e-6)
        np.testing.assert_allclose(structure.matrix @ found.tension, 0.0, atol=1e-12)
        for x in np.random.default_rng(p).normal(size=(200, len(basis))):
            other = found.tension + 0.2 * x @ basis
            least = (other / np.abs(other).max())[structure.is_cable].min()
            assert least <= found.least_tension * (1 + 2e-6)


def test_two_cables_that_hold_a_weight() -> None:
    """A node on two cables, loaded: their tensions follow from the load, with either sign of it."""
    structure = make_plain([[0, 0, 0], [-1, 0, 1], [1, 0, 1]], [], [(0, 1), (0, 2)])
    matrix = structure.matrix[:3]  # the other nodes are anchored
    found = find_rank(matrix)
    assert (found.rank, len(found.selfstress)) == (2, 0)
    for weight, feasible in ((-2.0, True), (2.0, False)):
        tension, left = found.find_tension(np.array([0.0, 0.0, weight]))
        assert left < 1e-14
        result = find_prestress(found.selfstress, structure.is_cable, load_tension=tension)
        assert result.is_found is feasible
        np.testing.assert_allclose(result.tension, -weight / np.sqrt(2), rtol=1e-12)


def test_loads_on_a_net_of_four_cables() -> None:
    """Guys to four sides: a load along x slackens one of them without prestress, and none with it."""
    structure = make_plain(
        [[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], [], [(0, 1), (0, 2), (0, 3), (0, 4)]
    )
    matrix = structure.matrix[:2]
    found = find_rank(matrix)
    tension, _ = found.find_tension(np.array([3.0, 0.0]))
    result = find_prestress(found.selfstress, structure.is_cable, load_tension=tension)
    assert result.is_found
    np.testing.assert_allclose(matrix @ result.tension, [3.0, 0.0], atol=1e-12)
    # The least largest force is 3 N; with twice that the least tension is 3 N.
    assert result.least_tension == pytest.approx(3.0, rel=2e-6)
    assert result.largest_force == pytest.approx(6.0, rel=2e-6)


def test_without_cables_no_sign_matters() -> None:
    square = make_plain(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [(0, 1), (1, 2), (2, 3), (3, 0), (0, 2), (1, 3)], []
    )
    found = find_rank(square.matrix)
    result = find_prestress(found.selfstress, square.is_cable)
    assert result.is_found
    assert result.least_tension == np.inf
    assert np.abs(result.tension).max() == pytest.approx(1.0)
