"""The loaded prism (Lin, Li, Ji, Che): the general bodies, compiled, against the paper's formulas and tables.

Equation numbers are the paper's. The prism is a scene; nothing of it is written by hand in the package.
"""

import numpy as np
import pytest

from tensegrity_codegen.pipeline.analyses import equilibrium_quantities
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.studies.papers.lin.tables import read_tables
from tensegrity_codegen.tables.request import ModelRequest
from tests.body_scenes import BodyEvaluator, example

# Tables 1 and 2 of LIN: spring extensions [mm] by load F_3z [N]. The tendons in the order of their columns:
COLUMNS = ("top1", "top3", "top2", "side1", "side3", "side2")
PRINTED = read_tables()
LOADS, MEASURED, COMPUTED = (PRINTED[name] for name in ("load", "measured", "computed"))
PRISM = example("lin_prism")
A, L, K, MASS, G = 0.41, 0.578, 173.2, 0.022880, 9.81
GAMMA = np.radians([90.0, 210.0, 330.0])
EVERY_NODE = tuple(range(PRISM.n_nodes))


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    request = ModelRequest((), parameters={"node_load": EVERY_NODE}, formulation="bodies")
    return build_library(PRISM, request.wanting(*equilibrium_quantities(PRISM, request))).load()


def settle(model: CompiledModel, node: str, force: tuple[float, float, float]) -> Equilibrium:
    load = np.zeros((PRISM.n_nodes, 3))
    load[PRISM.find_node(node)] = force
    return find_equilibrium(model, arguments={"node_load": load})


def extension(found: Equilibrium) -> np.ndarray:
    """Return the six extensions [mm] in the order of the paper's columns."""
    rows = [PRISM.member_name.index(name) for name in COLUMNS]
    return 1e3 * (found.member_length - PRISM.rest_length)[rows]


# --- the paper's geometry and energy ---------------------------------------------------------------


def angles(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return azimuths, elevations and coordinates of three bars at random."""
    rng = np.random.default_rng(seed)
    al, be = rng.uniform(-np.pi, np.pi, 3), rng.uniform(0.2, 1.2, 3)
    return al, be, np.stack([be, al], axis=1).ravel()


def printed_lengths(al: np.ndarray, be: np.ndarray) -> np.ndarray:
    """Return the lengths of (A.1) to (A.6): A1B2, A2B3, A3B1, then B1B2, B2B3, B3B1."""
    c, s, sixth, third = np.cos, np.sin, np.pi / 6, np.pi / 3
    squares = []
    for i in range(3):
        j = (i + 1) % 3
        squares.append(L**2 + A**2 + 2 * L * A * c(be[j]) * c(al[j] - sixth))
    for i in range(3):
        j = (i + 1) % 3
        value = 2 * L**2 + A**2 + 2 * L * A * c(be[i]) * c(al[i] + sixth)
        value += 2 * L * A * c(be[j]) * c(al[j] - sixth)
        value += 2 * L**2 * c(be[i]) * c(be[j]) * c(al[i] - al[j] + third) - 2 * L**2 * s(be[i]) * s(be[j])
        squares.append(value)
    return np.sqrt(squares)


@pytest.mark.parametrize("seed", range(3))
def test_lengths_are_those_of_the_papers_appendix(seed: int) -> None:
    # With azimuths from the outward radius of A_i; the signs are those that the scan of (A.1) to (A.6) lost.
    al, be, q = angles(seed)
    lengths = BodyEvaluator(PRISM)("member_length", coordinate=q)
    np.testing.assert_allclose(lengths, printed_lengths(al, be), rtol=1e-13)


@pytest.mark.parametrize("seed", range(3))
def test_potential_energy_is_equation_14(seed: int) -> None:
    al, be, q = angles(seed)
    lengths = printed_lengths(al, be)
    energy = K / 2 * (((lengths[:3] - 0.336) ** 2).sum() + ((lengths[3:] - 0.356) ** 2).sum())
    energy += MASS * G * L / 2 * np.sin(be).sum()
    assert BodyEvaluator(PRISM)("potential_energy", coordinate=q)[0] == pytest.approx(energy, rel=1e-6)


def test_printed_generalised_forces_drop_the_offset_of_the_azimuth() -> None:
    """(8) to (13) have al_i where al_i + g_i belongs: right for vertical loads only."""
    al, be, q = angles(4)
    evaluate = BodyEvaluator(PRISM)
    jacobian = evaluate("node_jacobian", coordinate=q).reshape(PRISM.n_nodes, 3, 6)

    def printed(i: int, force: np.ndarray, offset: float) -> list[float]:
        a, b = al[i] + offset, be[i]
        turn = -force[0] * L * np.cos(b) * np.sin(a) + force[1] * L * np.cos(b) * np.cos(a)
        rise = -force[0] * L * np.sin(b) * np.cos(a) - force[1] * L * np.sin(b) * np.sin(a)
        return [rise + force[2] * L * np.cos(b), turn]

    for i in range(3):
        top = jacobian[PRISM.find_node(f"bar{i + 1}_B")][:, 2 * i : 2 * i + 2]
        for force in np.eye(3):
            found = force @ top
            np.testing.assert_allclose(found, printed(i, force, GAMMA[i]), atol=1e-14)
            is_right = np.allclose(found, printed(i, force, 0.0), atol=1e-10)
            assert is_right == (force[2] == 1.0)


def test_bar_mass_is_that_of_the_tube_of_equation_30() -> None:
    assert [body.mass for body in PRISM.bodies[1:]] == pytest.approx([MASS] * 3, abs=1e-6)


# --- equilibria ------------------------------------------------------------------------------------


def test_equilibrium_under_own_weight(model: CompiledModel) -> None:
    found = find_equilibrium(model, coordinate=PRISM.coordinate + 0.05)
    assert found.status == "converged"
    np.testing.assert_allclose(extension(found), [32.045] * 3 + [51.781] * 3, atol=6e-4)
    angle = np.degrees(found.coordinate.reshape(3, 2))
    np.testing.assert_allclose(angle[:, 1], -165.527, atol=6e-4)
    np.testing.assert_allclose(angle[:, 0], 39.611, atol=6e-4)
    assert found.smallest_eigenvalue == pytest.approx(8.170, abs=6e-4)  # [N m], over the angles
    assert found.neutral_motions == 0


def test_equilibrium_under_10_newtons(model: CompiledModel) -> None:
    found = settle(model, "bar3_B", (0, 0, -10))
    wanted = [44.7043, 58.5089, 34.4045, 55.2701, 77.5274, 11.4843]
    np.testing.assert_allclose(extension(found), wanted, atol=6e-5)


def test_the_columns_of_the_tables_are_top_springs_first(model: CompiledModel) -> None:
    """Any other assignment of columns to springs is farther from the measurements."""
    ours = np.array([extension(settle(model, "bar3_B", (0, 0, load))) for load in LOADS[[0, 10]]])
    distance = np.abs(ours[:, None, :] - MEASURED[[0, 10]][:, :, None]).sum(axis=0)
    assert (distance.argmin(axis=1) == np.arange(6)).all()


def test_tables_1_and_2_are_met_within_the_stated_differences(model: CompiledModel) -> None:
    ours = np.array([extension(settle(model, "bar3_B", (0, 0, load))) for load in LOADS])
    assert np.abs(ours - COMPUTED).max() == pytest.approx(1.94, abs=0.005)  # [mm], Table 2
    error, printed = (np.abs(MEASURED - table) / table for table in (ours, COMPUTED))  # (31)
    assert 100 * error.mean() == pytest.approx(2.50, abs=0.005)
    assert 100 * printed.mean() == pytest.approx(2.62, abs=0.01)
    assert error.mean() < printed.mean()


def test_no_symmetrical_configuration_has_the_lengths_of_table_2() -> None:
    """(A.1) and (A.4) at equal angles: the nearest to Table 2's first row is 1.39 mm away."""
    al, be = np.meshgrid(np.radians(np.linspace(-180, 180, 1441)), np.radians(np.linspace(0, 90, 721)))
    side = np.sqrt(L**2 + A**2 + 2 * L * A * np.cos(be) * np.cos(al - np.pi / 6))
    square = 2 * L**2 + A**2 + 2 * L * A * np.cos(be) * (np.cos(al + np.pi / 6) + np.cos(al - np.pi / 6))
    top = np.sqrt(square + L**2 * np.cos(be) ** 2 - 2 * L**2 * np.sin(be) ** 2)
    wanted = 1e-3 * COMPUTED[0]
    distance = np.hypot(side - 0.336 - wanted[3:].mean(), top - 0.356 - wanted[:3].mean())
    assert 1e3 * distance.min() == pytest.approx(1.39, abs=0.03)


@pytest.mark.parametrize("bar", [1, 2, 3])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_loads_in_any_direction_do_the_work_that_the_energy_takes_up(
    model: CompiledModel, bar: int, axis: int
) -> None:
    node, force = f"bar{bar}_B", 2.0 * np.eye(3)[axis]
    nodes, weights = np.polynomial.legendre.leggauss(8)
    path = [settle(model, node, tuple(s * force)) for s in (0.0, *(0.5 + 0.5 * nodes), 1.0)]
    place = np.array([found.node_position[PRISM.find_node(node)] @ force for found in path])
    # U + F r is the energy of springs and weight alone; F goes from 0 to 1: work = F r - integral of r dF.
    stored = path[-1].energy + place[-1] - path[0].energy
    work = place[-1] - weights @ place[1:-1] / 2
    assert stored == pytest.approx(work, abs=1e-10)
