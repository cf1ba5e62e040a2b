"""Least masses: closed forms, every vertex of small structures, and derivatives by differences.

Numbers of the D-bar and of the T-bar are those of MOTES (Goyal, Chen, Majji and Skelton, Journal of Open
Source Software 4, 2019), aluminium, 10 kN; formulas of buckling: Skelton and de Oliveira, "Tensegrity
systems", 2009.
"""

import itertools
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.pipeline.sizing.size_members import Sizing, size_members
from tensegrity_codegen.scene.shapes.selfstress import equilibrium_matrix
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    DuplicateNameError,
    FormulationError,
    InfeasibleError,
    InvalidValueError,
    NonFiniteError,
    UnknownNameError,
)
from tests.cases import thorough

ALUMINIUM = {"youngs_modulus": 60e9, "density": 2700.0, "yield_stress": 110e6}
RING, CROSS = [(1, 2), (2, 3), (3, 4), (4, 1)], [(1, 3), (2, 4)]


def diamond(bars: list[tuple[int, int]], cables: list[tuple[int, int]], load: float = 1e4) -> dict[str, Any]:
    """Four nodes at a distance of 1 m from the middle, pressed together along x."""
    places = [[-1.0, 0.0], [0.0, -1.0], [1.0, 0.0], [0.0, 1.0]]
    nodes = {f"n{k}": {"position": place} for k, place in enumerate(places, 1)}
    kinds = [*(("bar", pair) for pair in bars), *(("cable", pair) for pair in cables)]
    members = {f"{kind}{a}{b}": {"nodes": [f"n{a}", f"n{b}"], "class": kind} for kind, (a, b) in kinds}
    classes = {"bar": {"kind": "bar"}, "cable": {"kind": "cable", "axial_stiffness": 1e6}}
    loads = [{"node": "n1", "force": [load, 0.0]}, {"node": "n3", "force": [-load, 0.0]}]
    return {
        "name": "diamond",
        "axes": "xy",
        "nodes": nodes,
        "classes": classes,
        "members": members,
        "loads": loads,
    }


def rod(load: float) -> dict[str, Any]:
    """One bar of 2 m, pressed together."""
    scene = diamond([(1, 3)], [], load)
    for name in ("n2", "n4"):
        del scene["nodes"][name]
    return scene


def draw_truss(seed: int, load: float, n: int = 4, more: int = 3) -> dict[str, Any]:
    """Nodes in a plane, two of them anchored, and 2 n + more members drawn among all pairs."""
    random = np.random.default_rng(seed)
    places = random.normal(size=(n + 2, 2))
    nodes: dict[str, Any] = {f"n{k}": {"position": place.tolist()} for k, place in enumerate(places)}
    nodes[f"n{n}"]["anchored"] = nodes[f"n{n + 1}"]["anchored"] = True
    pairs = [pair for pair in itertools.combinations(range(n + 2), 2) if pair != (n, n + 1)]
    random.shuffle(pairs)
    members = {
        f"m{k}": {"nodes": [f"n{a}", f"n{b}"], "class": "bar" if random.random() < 0.6 else "cable"}
        for k, (a, b) in enumerate(pairs[: 2 * n + more])
    }
    loads = [{"node": f"n{k}", "force": (random.normal(size=2) * load).tolist()} for k in range(n)]
    classes = {"bar": {"kind": "bar"}, "cable": {"kind": "cable", "axial_stiffness": 1e6}}
    return {
        "name": "truss",
        "axes": "xy",
        "nodes": nodes,
        "classes": classes,
        "members": members,
        "loads": loads,
    }


def balance_of(structure: Structure) -> tuple[FloatArray, FloatArray]:
    """Return A and loads of the free coordinates: A t = load."""
    node, axis = structure.coordinate_node_axis.T
    matrix = equilibrium_matrix(structure.node_position, structure.connectivity)[3 * node + axis]
    return matrix, structure.node_load[node, axis]


def mass_of(structure: Structure, tension: FloatArray, column: str = "euler") -> FloatArray:
    """Return the masses of aluminium members, from the formulas."""
    modulus, density, limit = ALUMINIUM.values()
    length, push = structure.member_length(), np.maximum(-tension, 0.0)
    yields = np.abs(tension) / limit
    buckles = 2 * length * np.sqrt(push / (np.pi * modulus))
    if column == "johnson":
        stocky = push / limit + limit * length**2 / (np.pi * modulus)
        buckles = np.where(push <= limit**2 * length**2 / (np.pi * modulus), buckles, stocky)
    area = np.where(structure.is_bar & (tension < 0), np.maximum(yields, buckles), yields)
    return np.asarray(density * length * area)


def enumerate_vertices(scene: dict[str, Any], column: str, bars_pull: bool) -> float:
    """Return the least mass over all vertices; inf where no forces balance the loads.

    Between the planes t = 0 and those where a bar begins to yield the mass is concave.
    """
    structure, _ = load_scene(scene)
    assert isinstance(structure, Structure)
    matrix, load = balance_of(structure)
    n, scale = structure.n_members, float(np.abs(load).max())
    kink = 4 * 110e6**2 * structure.member_length() ** 2 / (np.pi * 60e9)
    planes = [(e, 0.0) for e in range(n)]
    if column == "euler":
        planes += [(e, -kink[e]) for e in range(n) if structure.is_bar[e]]
    least, free = np.inf, n - int(np.linalg.matrix_rank(matrix))
    for chosen in itertools.combinations(planes, free):
        if len({e for e, _ in chosen}) < free:
            continue
        rows = np.vstack([matrix, *(np.eye(n)[[e]] for e, _ in chosen)])
        right = np.concatenate([load, [value for _, value in chosen]])
        tension, _, rank, _ = np.linalg.lstsq(rows, right, rcond=None)
        if rank < n or np.abs(rows @ tension - right).max() > 1e-7 * scale:
            continue
        wrong = np.where(structure.is_bar, 0.0 if bars_pull else tension, -tension)
        if wrong.max() <= 1e-7 * scale:
            least = min(least, float(mass_of(structure, tension, column).sum()))
    return least


def check(found: Sizing, column: str = "euler", load: FloatArray | None = None) -> None:
    """Forces balance, no section yields or buckles, and the bound is below the mass."""
    structure = found.structure
    matrix, own = balance_of(structure)
    loads = np.atleast_2d(own if load is None else load)
    np.testing.assert_allclose(
        found.member_tension @ matrix.T, loads, atol=1e-9 * np.abs(found.member_tension).max()
    )
    needed = [mass_of(structure, tension, column) for tension in found.member_tension]
    np.testing.assert_allclose(np.max(needed, axis=0), found.member_mass, rtol=1e-9)
    assert (structure.is_bar | (found.member_tension >= 0)).all()
    assert found.lower_bound <= found.total_mass == pytest.approx(found.member_mass.sum())
    np.testing.assert_allclose(found.area * structure.member_length() * 2700.0, found.member_mass)


# --- closed forms ------------------------------------------------------------------------------------


def test_the_d_bar_weighs_what_it_does_in_motes() -> None:
    """Four bars around two strings: bars 2.0917785 kg each by buckling, strings 0 and 0.490909 kg."""
    found = size_members(diamond(RING, CROSS), **ALUMINIUM)
    assert found.status == "optimal"
    assert found.total_mass == pytest.approx(8.85802309, abs=1e-8)
    np.testing.assert_allclose(found.member_mass[:4], 2.0917785, atol=1e-8)
    np.testing.assert_allclose(found.member_mass[4:], [0.0, 0.490909091], atol=1e-9)
    assert found.limit == ("buckling",) * 4 + ("none", "yield")
    assert found.gap < 1e-8
    np.testing.assert_allclose(found.force_density, [[-5000.0] * 4 + [0.0, 5000.0]], atol=1e-9)
    check(found)


def test_the_t_bar_is_one_bar() -> None:
    """Two crossed bars in four strings: 4.97511575 kg in one bar; MOTES ends at 4.9754358 kg."""
    found = size_members(diamond(CROSS, RING), **ALUMINIUM)
    assert found.total_mass == pytest.approx(4.97511575, abs=1e-8)
    assert found.total_mass < 4.9754358
    assert np.count_nonzero(found.member_mass) == 1
    check(found)


def test_what_leaves_its_balance_is_named() -> None:
    """Loads that press a free bar turn it over; between an anchor and a rail it stays."""
    assert size_members(diamond(CROSS, RING), **ALUMINIUM).n_unstable == 1
    assert size_members(diamond(CROSS, RING, load=-1e4), **ALUMINIUM).n_unstable == 0
    scene = diamond(CROSS, RING)
    scene["nodes"]["n1"]["anchored"] = True
    scene["nodes"]["n3"]["anchored"] = "y"
    found = size_members(scene, **ALUMINIUM)
    assert (found.n_unstable, found.total_mass) == (0, pytest.approx(4.97511575, abs=1e-8))


@pytest.mark.parametrize(("load", "column", "limit"), [(1e6, "euler", "buckling"), (2e7, "euler", "yield")])
def test_a_bar_yields_above_the_force_at_which_both_sections_are_equal(
    load: float, column: Any, limit: str
) -> None:
    """They are at 4 yield_stress^2 l^2 / (pi E) = 1.027e6 N for 2 m."""
    scene = rod(load)
    found = size_members(scene, **ALUMINIUM, column=column)
    assert found.limit == (limit,)
    assert 4 * 110e6**2 * 2.0**2 / (np.pi * 60e9) == pytest.approx(1.027e6, rel=1e-3)
    check(found)


def test_johnson_is_above_both_in_between() -> None:
    """At half of the yield stress Euler's section and Johnson's are the same: 0.2568e6 N for 2 m."""
    at = 110e6**2 * 2.0**2 / (np.pi * 60e9)
    for load, ratio in ((0.9 * at, 1.0), (at, 1.0), (4 * at, 1.25)):
        euler = size_members(rod(load), **ALUMINIUM)
        johnson = size_members(rod(load), **ALUMINIUM, column="johnson")
        assert johnson.total_mass / euler.total_mass == pytest.approx(ratio, rel=1e-9)
        check(johnson, "johnson")


def test_sections_and_limits_of_a_scene_are_its_material() -> None:
    """A tube with a safety factor of 2: sqrt(2 (1 - h^2) / (1 + h^2)) times the mass of a solid bar."""
    scene = rod(1e4)
    area = np.pi * (0.05**2 - 0.04**2)
    scene["classes"]["bar"] |= {"radius": 0.05, "inner_radius": 0.04, "density": 2700.0}
    scene["classes"]["bar"]["axial_stiffness"] = 60e9 * float(area)
    scene["limits"] = {"yield_stress": 110e6, "buckling": 2.0}
    found = size_members(scene)
    assert found.total_mass == pytest.approx(4.97511575 * np.sqrt(2 * 0.36 / 1.64), rel=1e-8)
    assert found.inner_radius[0] / found.radius[0] == pytest.approx(0.8)
    structure, _ = load_scene(found.document)
    assert isinstance(structure, Structure)
    factor = np.pi**2 * 60e9 * np.pi * (found.radius**4 - found.inner_radius**4) / 4 / 2.0**2 / 1e4
    np.testing.assert_allclose(factor, 2.0)
    assert structure.static_tension() == pytest.approx([-1e4])
    again = size_members(found.document)
    assert again.total_mass == pytest.approx(found.total_mass, rel=1e-12)


def test_bars_that_do_not_buckle_yield_alone() -> None:
    """The truss of ten bars by yield alone: 1584 kg of 0.1 kg/m3 at 25 Pa, as by its linear program."""
    places = [(720.0, 360.0), (720.0, 0.0), (360.0, 360.0), (360.0, 0.0), (0.0, 360.0), (0.0, 0.0)]
    pairs = [(5, 3), (3, 1), (6, 4), (4, 2), (3, 4), (1, 2), (5, 4), (6, 3), (3, 2), (4, 1)]
    scene: dict[str, Any] = {
        "name": "tenbar",
        "axes": "xy",
        "nodes": {f"n{k}": {"position": place, "anchored": k > 4} for k, place in enumerate(places, 1)},
        "members": {f"m{k}": {"kind": "bar", "nodes": [f"n{a}", f"n{b}"]} for k, (a, b) in enumerate(pairs)},
        "loads": [{"node": name, "force": [0.0, -100.0]} for name in ("n2", "n4")],
        "limits": {"buckling": False},
    }
    stated = {"density": 0.1, "yield_stress": 25.0, "bars_pull": True}
    for more in ({}, {"youngs_modulus": 1e4}, {"youngs_modulus": 1e4, "column": "johnson"}):
        found = size_members(scene, **stated, **more)
        assert found.status == "optimal"
        assert found.total_mass == pytest.approx(1584.0, rel=1e-9)
        assert set(found.limit) <= {"yield", "none"}
        assert found.document["limits"] == {"buckling": False}
    del scene["limits"]
    assert size_members(scene, **stated, youngs_modulus=1e4).total_mass == pytest.approx(6465.67, abs=5e-3)


def test_a_least_tension_of_cables_needs_no_load() -> None:
    """The crossed bars press against four strings of at least 100 N: 141.4 N in each bar."""
    scene = diamond(CROSS, RING, 0.0)
    scene["classes"]["cable"]["radius"] = 0.01
    scene["limits"] = {"least_tension": 100.0}
    del scene["loads"]
    found = size_members(scene, **ALUMINIUM)
    np.testing.assert_allclose(found.member_tension, [[-np.sqrt(2) * 100.0] * 2 + [100.0] * 4], rtol=1e-12)
    check(found)


# --- the proof ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [*range(130, 138), *thorough(*range(138, 190))])
def test_the_mass_is_that_of_the_best_vertex(seed: int) -> None:
    load = (1e4, 1e6, 3e6, 1e7)[seed % 4]
    bars_pull = seed % 4 != 0
    column: Any = "johnson" if seed % 5 == 0 else "euler"
    scene = draw_truss(seed, load)
    least = enumerate_vertices(scene, column, bars_pull)
    if least == np.inf:
        with pytest.raises(InfeasibleError):
            size_members(scene, **ALUMINIUM, column=column, bars_pull=bars_pull)
        return
    found = size_members(scene, **ALUMINIUM, column=column, bars_pull=bars_pull)
    assert found.status == "optimal"
    assert found.total_mass == pytest.approx(least, rel=2e-6)
    assert found.lower_bound <= least * (1 + 1e-12)
    check(found, column)


def braced_frame(columns: int, rows: int) -> dict[str, Any]:
    """A grid of bars of which each node sees all neighbours, anchored along one side, loaded at a corner."""
    random = np.random.default_rng(0)
    grid = [(i, j) for i in range(columns) for j in range(rows)]
    places = np.array(grid) + random.normal(size=(len(grid), 2)) * 0.1
    nodes = {f"n{k}": {"position": place.tolist(), "anchored": k < rows} for k, place in enumerate(places)}
    members = {
        f"b{a}_{b}": {"nodes": [f"n{a}", f"n{b}"], "class": "bar"}
        for a, b in itertools.combinations(range(len(places)), 2)
        if np.linalg.norm(places[a] - places[b]) < 1.75 and b >= rows
    }
    loads = [{"node": f"n{len(places) - 1}", "force": [3e3, -1e4]}]
    classes = {"bar": {"kind": "bar"}}
    return {
        "name": "frame",
        "axes": "xy",
        "nodes": nodes,
        "classes": classes,
        "members": members,
        "loads": loads,
    }


@pytest.mark.parametrize(
    ("size", "count", "mass"), [((3, 3), 18, 5.82376113), *thorough(((4, 4), 39, 8.69572038))]
)
def test_frames_are_proved_by_splitting(size: tuple[int, int], count: int, mass: float) -> None:
    found = size_members(braced_frame(*size), **ALUMINIUM, bars_pull=True)
    assert found.structure.n_members == count
    assert found.status == "optimal"
    assert found.n_splits > 0
    assert found.gap <= 1e-6
    assert found.total_mass == pytest.approx(mass, rel=1e-8)
    check(found)


def test_without_splits_the_result_is_local_and_the_bound_holds() -> None:
    found = size_members(braced_frame(3, 3), **ALUMINIUM, bars_pull=True, max_splits=0)
    assert found.status == "local"
    assert 0.0 < found.lower_bound < 5.82376113 * (1 + 1e-8) <= found.total_mass * (1 + 2e-8)
    assert found.message.startswith(f"{found.total_mass:.9g} kg, proved {found.lower_bound:.6g} kg")


# --- load cases --------------------------------------------------------------------------------------


def test_sections_of_load_cases_are_the_largest_ones() -> None:
    """A bar that is pressed in one case and pulled in another."""
    scene = rod(0.0)
    del scene["loads"]
    push, pull = {"n1": [1e4, 0.0, 0.0], "n3": [-1e4, 0.0, 0.0]}, {"n1": [-2e5, 0, 0], "n3": [2e5, 0, 0]}
    cases = {"push": push, "pull": pull}
    found = size_members(scene, **ALUMINIUM, load_cases=cases, bars_pull=True)
    np.testing.assert_allclose(found.member_tension, [[-1e4], [2e5]])
    assert found.total_mass == pytest.approx(max(4.97511575, 2700.0 * 2.0 * 2e5 / 110e6))
    assert found.governing_case == ("pull",)
    with pytest.raises(InfeasibleError, match="load case pull"):
        size_members(scene, **ALUMINIUM, load_cases=cases)


def hung(length: float = 10.0) -> dict[str, Any]:
    """A mass of 100 kg on a rope."""
    return {
        "name": "hung",
        "gravity": [0, 0, -10.0],
        "nodes": {
            "a": {"position": [0, 0, 0], "anchored": True},
            "b": {"position": [0, 0, -length], "mass": 100.0},
        },
        "classes": {"rope": {"kind": "cable", "axial_stiffness": 1e6}},
        "members": {"rope1": {"nodes": ["a", "b"], "class": "rope"}},
    }


def test_factors_of_loads_and_weights_of_members() -> None:
    """F = 1.5 x 1000 N and 1.2 times half of the rope: A = F / (fy - 1.2 rho l g / 2)."""
    steel = {"density": 8000.0, "yield_stress": 1e6}
    case = {"ultimate": {"loads": 1.5, "weight": 1.2}}
    found = size_members(hung(), load_cases=case, **steel)
    assert found.area == pytest.approx([1500.0 / (1e6 - 1.2 * 8000.0 * 10.0 * 10.0 / 2.0)], rel=1e-8)
    assert found.member_tension[0] == pytest.approx(found.area * 1e6, rel=1e-8)
    plain = size_members(hung(), load_cases={"ultimate": {"loads": 1.5}}, **steel)
    assert plain.area == pytest.approx([1.5e-3])
    with pytest.raises(ConvergenceError, match="do not come to an end"):
        size_members(hung(30.0), load_cases=case, **steel)


def test_a_prestress_is_one_case_and_is_written() -> None:
    """Verticals of a prism of three bars have sqrt(3) times the force densities of its rings."""
    shape = {"kind": "prism", "bars": 3, "bottom_radius": 0.5, "top_radius": 0.5, "height": 1.0}
    kinds = {
        "bar": {"kind": "bar", "axial_stiffness": 1e7},
        "cable": {"kind": "cable", "axial_stiffness": 1e6},
    }
    scene = {"name": "prism", "shape": shape, "classes": kinds}
    case = {"prestress": {"loads": 0.0, "top1": 500.0}}
    found = size_members(scene, load_cases=case, youngs_modulus=2e11, density=7850.0, yield_stress=3e8)
    q = dict(zip(found.member_name, found.force_density[0], strict=True))
    assert q["top1"] * np.sqrt(3) * 0.5 == pytest.approx(500.0)
    assert q["vertical2"] == pytest.approx(np.sqrt(3) * q["bottom3"])
    assert q["bar1"] == pytest.approx(-q["vertical1"])
    np.testing.assert_allclose(found.structure.static_tension(), found.member_tension[0], rtol=1e-6)


def test_sections_of_a_catalogue_are_the_smallest_that_hold() -> None:
    """10 kN press the ends together: bars need 4.3e-4 m2 and the string 1.3e-4 m2."""
    scene = diamond(RING, [(2, 4)])
    free = size_members(scene, **ALUMINIUM)
    areas = [1e-4, 2e-4, 5e-4, 1e-3]
    found = size_members(scene, sections=areas[::-1], **ALUMINIUM)
    used = free.area > 0
    chosen = [min(a for a in areas if a >= need) for need in free.area[used]]
    assert found.area[used] == pytest.approx(chosen)
    assert len(set(chosen)) > 1
    assert found.total_mass == pytest.approx(float(found.member_mass.sum()))
    assert found.lower_bound == pytest.approx(free.total_mass, rel=1e-5)
    assert found.status == "local"
    with pytest.raises(InvalidValueError, match="no section of the catalogue"):
        size_members(scene, sections=areas[:2], **ALUMINIUM)
    with pytest.raises(InvalidValueError, match="not a section"):
        size_members(scene, sections=[0.0], **ALUMINIUM)


def test_two_load_cases_against_a_fine_grid() -> None:
    """A rhombus with both diagonals has one self-stress: two numbers in two cases."""
    scene = diamond([*RING, *CROSS], [], 0.0)
    del scene["loads"]
    for name, held in (("n1", True), ("n2", "y")):
        scene["nodes"][name]["anchored"] = held
    cases = {"a": {"n3": [-1e4, 3e3, 0.0]}, "b": {"n4": [2e3, -8e3, 0.0], "n3": [5e3, 0.0, 0.0]}}
    found = size_members(scene, **ALUMINIUM, load_cases=cases, bars_pull=True)
    assert found.status == "optimal"
    structure = found.structure
    matrix, _ = balance_of(structure)
    node, axis = structure.coordinate_node_axis.T
    loads = np.zeros((2, structure.n_nodes, 3))
    for case, forces in zip(loads, cases.values(), strict=True):
        for name, force in forces.items():
            case[structure.node_name.index(name)] = force
    check(found, load=loads[:, node, axis])
    mode = np.linalg.svd(matrix)[2][-1]
    grid = np.linspace(-4e4, 4e4, 1001)
    masses = []
    for case in loads:
        first = np.linalg.lstsq(matrix, case[node, axis], rcond=None)[0]
        masses.append(np.array([mass_of(structure, first + x * mode) for x in grid]))
    both = np.maximum(masses[0][:, None], masses[1][None, :]).sum(axis=2)
    assert found.lower_bound <= both.min()
    assert both.min() == pytest.approx(found.total_mass, rel=2e-2)


# --- derivatives -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("seed", "with_cases"), [(131, False), (138, True), *thorough((137, False), (141, False))]
)
def test_derivatives_by_positions_are_those_of_differences(seed: int, with_cases: bool) -> None:
    scene = draw_truss(seed, 1e5)
    random = np.random.default_rng(1)
    cases = {name: {"n0": [*(random.normal(size=2) * 1e5), 0.0]} for name in "ab"} if with_cases else None
    call: dict[str, Any] = {**ALUMINIUM, "bars_pull": True, "load_cases": cases, "gap": 1e-9}
    found = size_members(scene, **call)
    slopes = found.mass_gradient
    assert np.isfinite(slopes[:, :2]).all()
    assert np.isnan(slopes[:, 2]).all()  # not modelled
    for node, axis in ((0, 0), (2, 1), (5, 0)):  # the last one is an anchor
        masses = []
        for step in (1e-5, -1e-5):
            moved = {**scene, "nodes": {name: dict(table) for name, table in scene["nodes"].items()}}
            place = list(moved["nodes"][f"n{node}"]["position"])
            place[axis] += step
            moved["nodes"][f"n{node}"]["position"] = place
            masses.append(size_members(moved, **call).total_mass)
        slope = (masses[0] - masses[1]) / 2e-5
        assert slope == pytest.approx(slopes[node, axis], abs=1e-6 * np.nanmax(np.abs(slopes)))


def test_there_is_no_derivative_where_moving_a_node_breaks_the_balance() -> None:
    """The load at n1 goes through n3: either of them moves along x alone, m ~ l^2 and m ~ l of strings."""
    found = size_members(diamond(RING, CROSS), **ALUMINIUM)
    assert np.isnan(found.mass_gradient[[0, 2], 1]).all()
    assert found.mass_gradient[2, 0] == pytest.approx(-found.mass_gradient[0, 0])
    assert found.mass_gradient[3, 1] == pytest.approx(-found.mass_gradient[1, 1])


# --- wrong input -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "kind", "says"),
    [
        ({"yield_stress": None}, InvalidValueError, "no yield stress of some members"),
        ({"density": None}, InvalidValueError, "no density of some members"),
        ({"youngs_modulus": None}, InvalidValueError, "no Young's modulus of some members"),
        ({"youngs_modulus": {"cables": 6e10}}, InvalidValueError, "no Young's modulus"),
        ({"yield_stress": -1.0}, InvalidValueError, "not a yield stress"),
        ({"density": float("nan")}, InvalidValueError, "not a density"),
        ({"density": {"rope": 1.0}}, UnknownNameError, "unknown member, group, class or kind"),
        ({"density": {"bars": 1.0, "bar": 2.0, "cables": 1.0, "cable": 3.0}}, None, ""),
        ({"load_cases": {"a": {"n9": [0.0, 0.0, 0.0]}}}, UnknownNameError, "n9"),
        ({"load_cases": {"a": {"n1": [1.0]}}}, InvalidValueError, "not a force"),
        ({"load_cases": {"a": {"n1": [np.nan, 0.0, 0.0]}}}, NonFiniteError, "not finite"),
        ({"column": "rankine"}, UnknownNameError, "formula of columns"),
        ({"max_splits": -1}, InvalidValueError, "out of range"),
        ({"gap": 0.0}, InvalidValueError, "out of range"),
    ],
)
def test_wrong_input_is_named(change: dict[str, Any], kind: type[Exception] | None, says: str) -> None:
    call: dict[str, Any] = {**ALUMINIUM, **change}
    if kind is None:  # of fewer members comes first: the class before the kind
        found = size_members(diamond(RING, CROSS), **call)
        assert found.member_mass[5] == pytest.approx(3.0 * 0.490909091 / 2700.0)
        return
    with pytest.raises(kind, match=says):
        size_members(diamond(RING, CROSS), **call)


def test_two_statements_of_one_member_are_refused() -> None:
    scene = {**diamond(RING, CROSS), "groups": {"first": ["bar12", "bar23"], "second": ["bar23"]}}
    with pytest.raises(DuplicateNameError, match="bar23"):
        size_members(scene, **{**ALUMINIUM, "density": {"all": 1.0, "first": 2.0, "second": 3.0}})  # type: ignore[arg-type]


def test_nothing_to_carry_is_an_error() -> None:
    scene = diamond(RING, CROSS, 0.0)
    del scene["loads"]
    with pytest.raises(InvalidValueError, match="the least mass is nothing"):
        size_members(scene, **ALUMINIUM)


def test_loads_that_nothing_carries_are_proved_so() -> None:
    """A pull along x on strings around crossed bars is carried; a push on strings alone is not."""
    scene = diamond([], [*RING, *CROSS])
    with pytest.raises(InfeasibleError) as caught:
        size_members(scene, **ALUMINIUM)
    evidence = caught.value.evidence
    assert caught.value.exit_code == 3
    assert evidence["nodes"] in ("2 (n1, n3)", "1 (n1)", "1 (n3)")
    assert evidence["unbalanced_force"] == pytest.approx(2e4)
    # In the motion no string gets longer, and loads do work.
    structure, _ = load_scene(scene)
    assert isinstance(structure, Structure)
    motion = np.array([evidence["motion"].get(name, [0.0] * 3) for name in structure.node_name])
    matrix = equilibrium_matrix(structure.node_position, structure.connectivity)
    assert (matrix.T @ motion.ravel()).max() <= 1e-9
    assert (structure.node_load * motion).sum() == pytest.approx(2e4)


def test_the_way_out_of_weights_is_without_gravity() -> None:
    """An equilibrium has the weights of members, sizes only those of cases: settling with them is in vain."""
    scene = {**diamond([], [*RING, *CROSS]), "gravity": [0.0, -9.81]}
    for member in scene["members"].values():
        member["mass"] = 1.0
    with pytest.raises(InfeasibleError, match=r"gravity = \[0, 0, 0\]"):
        size_members(scene, **ALUMINIUM)


@pytest.mark.parametrize("rise", [0.001, 0.1])
def test_forces_far_above_the_loads_are_told(rise: float) -> None:
    """Two cables nearly in line pull load / (2 sine of their slope) each."""
    places = {"a": [-1.0, rise], "b": [1.0, rise], "m": [0.0, 0.0]}
    nodes = {name: {"position": at, "anchored": name != "m"} for name, at in places.items()}
    members = {f"c{name}": {"nodes": [name, "m"], "kind": "cable", "axial_stiffness": 1e6} for name in "ab"}
    loads = [{"node": "m", "force": [0.0, -10.0]}]
    scene = {"name": "line", "axes": "xy", "nodes": nodes, "members": members, "loads": loads}
    told = f"forces are {np.hypot(1.0, rise) / (2.0 * rise):.4g} times all loads"
    assert (told in size_members(scene, **ALUMINIUM).message) == (rise < 0.01)


def test_grounds_and_rings_are_refused() -> None:
    scene = {**diamond(RING, CROSS), "ground": {"stiffness": 1e5}}
    for node in scene["nodes"].values():
        node["mass"] = 1.0
    with pytest.raises(FormulationError, match="least mass"):
        size_members(scene, **ALUMINIUM)
    scene = diamond(RING, [(1, 3)])
    scene["members"]["cable13"]["nodes"] = ["n1", "n2", "n3"]
    with pytest.raises(FormulationError, match="through rings"):
        size_members(scene, **ALUMINIUM)


def cross(arms: int) -> dict[str, Any]:
    """A strut between two nodes, each of which cables hold at anchors around: many designs are as light."""
    nodes: dict[str, Any] = {"top": {"position": [0, 0, 1]}, "low": {"position": [0, 0, -1]}}
    members = {"king": {"class": "strut", "nodes": ["top", "low"]}}
    for k, angle in enumerate(2 * np.pi * np.arange(arms) / arms):
        nodes[f"s{k}"] = {"position": [2 * np.cos(angle), 2 * np.sin(angle), 0.0], "anchored": True}
        members |= {f"{end}{k}": {"class": "cable", "nodes": [f"s{k}", end]} for end in ("top", "low")}
    kinds = {
        "strut": {"kind": "bar", "axial_stiffness": 1e7},
        "cable": {"kind": "cable", "axial_stiffness": 1e6},
    }
    return {"name": "cross", "gravity": [0, 0, -9.81], "classes": kinds, "nodes": nodes, "members": members}


def test_weights_agree_where_designs_that_are_as_light_take_turns() -> None:
    """Cables of another pair of arms weigh as much on the two nodes."""
    case = {"snow": {"top": [0, 0, -3e4], "weight": 50.0, "king": -4e4}}
    steel = {"youngs_modulus": 2.1e11, "density": 7850.0, "yield_stress": 355e6}
    found = size_members(cross(4), load_cases=case, **steel)
    assert found.total_mass == pytest.approx(21.1084011, rel=1e-8)
    assert found.member_tension[0][0] == pytest.approx(-4e4)
