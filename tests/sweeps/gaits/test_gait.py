"""Gaits: facets and symmetries, the loss of a roll, and walks under errors of stiffness and friction."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.sweeps.gaits.gait import Gait, Walk, design_gait
from tensegrity_codegen.sweeps.gaits.rolls import FREE, KNOTS, Facets, RollLoss
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError

SCENE = Path(__file__).parents[3] / "docs" / "gallery" / "icosahedron_gait.toml"
STANDING, OPEN = (0, 4, 8), (4, 8, 10)  # a facet of three cables, and the one of two beyond its edge
STEPS = [(STANDING, OPEN), (OPEN, (1, 4, 10)), (OPEN, (5, 8, 10))]  # one over each kind of edge


@pytest.fixture(scope="module")
def structure() -> Structure:
    found = load_scene(SCENE)[0]
    assert isinstance(found, Structure)
    return found


@pytest.fixture(scope="module")
def gait() -> Gait:
    """Rolls after two iterations, which cost more than the best and bring it as far."""
    return design_gait(SCENE, max_iterations=2)


def write_scene(folder: Path, old: str, new: str) -> Path:
    text = SCENE.read_text(encoding="utf-8")
    assert old in text
    path = folder / "changed.toml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path


def test_an_icosahedron_has_twenty_facets_and_the_symmetries_of_a_pyritohedron(structure: Structure) -> None:
    facets = Facets(structure, list(range(6, 30)))
    assert len(facets.facet) == 20
    assert len(facets.symmetry) == 24
    cables = {frozenset(ends) for ends in structure.connectivity[6:].tolist()}
    for row in facets.symmetry:
        assert sorted(row.tolist()) == list(range(12))
        assert {frozenset(row[list(ends)].tolist()) for ends in cables} == cables
        assert sorted(facets.map_members(row)) == list(range(30))
    # Three kinds of edges: each step from facet to facet is one of three by symmetry
    steps = [(facet, one) for facet in facets.facet for one in facets.list_next(facet)]
    assert len(steps) == 60
    kinds = [[facets.find_symmetry(own, step) is not None for own in STEPS] for step in steps]
    assert np.sum(kinds, axis=0).tolist() == [24, 24, 12]
    assert np.sum(kinds, axis=1).tolist() == [1] * 60


def test_a_single_winch_breaks_the_symmetry(structure: Structure) -> None:
    """Left are those that leave its cable, from n5 to n1 of a facet of three cables, where it is."""
    facets = Facets(structure, [6])
    assert 1 <= len(facets.symmetry) < 24
    assert all(facets.map_members(row)[6] == 6 for row in facets.symmetry)


def test_a_rigid_roll_lays_the_next_facet_on_the_ground(structure: Structure) -> None:
    facets, position = Facets(structure, [6]), np.array(structure.node_position)
    assert facets.find_standing(position) == STANDING
    leaning = Rotation.from_rotvec([0.2, 0.0, 0.0]).apply(position)
    assert facets.find_standing(leaning) is None
    for target in facets.list_next(STANDING):
        turned = facets.turn_over(position, (STANDING, target))
        assert facets.find_standing(turned) == target
        np.testing.assert_allclose(turned[list(target), 2], position[0, 2], atol=1e-6)
        assert turned[:, 2].min() > position[0, 2] - 1e-6
        edge = sorted({*STANDING} & {*target})
        np.testing.assert_allclose(turned[edge], position[edge], atol=1e-12)


def test_the_loss_of_a_roll_has_the_gradient_of_differences(gait: Gait) -> None:
    """With the cost of transport, whose winches pull and let out."""
    loss = RollLoss(SCENE, gait.winches, np.array([-0.07, -0.12]), {"ground": [0.4]})
    loss.has_cost = True
    random = np.random.default_rng(2)
    values = 0.01 * random.normal(size=24 * len(KNOTS[FREE]))
    slope = loss(values)[1]
    way = random.normal(size=len(values))
    ahead, behind = (loss(values + step * way)[0] for step in (1e-6, -1e-6))
    assert slope @ way == pytest.approx((ahead - behind) / 2e-6, rel=1e-4)
    assert loss.disagreement < 1e-8


def test_rolls_are_mapped_to_all_edges(gait: Gait) -> None:
    """The same roll over another edge, in another direction, with the same work."""
    assert len(gait.rolls) == 3
    assert gait.failed == ()
    costs = []
    for direction in ([-0.5, -np.sqrt(0.75)], [1.0, 0.0], [-0.5, np.sqrt(0.75)]):
        walk = gait.walk(1, direction)
        assert walk.status == "ok"
        assert walk.way @ direction == pytest.approx(0.144, abs=0.015)
        costs.append(walk.cost_of_transport)
    np.testing.assert_allclose(costs, costs[0], rtol=0.02)


def walk_with_errors(gait: Gait, n_facets: int, seed: int) -> Walk:
    """Stiffnesses wrong by up to 5 %, friction 0.3 to 0.6, dropped tilted and turned from 3 mm."""
    random = np.random.default_rng(seed)
    stiffness = gait.model.nominal("spring_constant") * random.uniform(0.95, 1.05, 24)
    friction = random.uniform(0.3, 0.6)
    turn = Rotation.from_rotvec([*random.uniform(-0.02, 0.02, 2), random.uniform(-0.2, 0.2)])
    position = turn.apply(gait.model.nominal("coordinate").reshape(-1, 3))
    position[:, 2] += 0.003 - position[:, 2].min()
    arguments = {"spring_constant": stiffness, "ground": [friction]}
    return gait.walk(n_facets, arguments=arguments, coordinate=position.ravel())


def test_a_walk_with_errors_is_not_lost(gait: Gait) -> None:
    walk = walk_with_errors(gait, 3, 8)
    assert walk.status == "ok"
    assert len(walk.facet) == 4
    assert walk.way[0] > 0.27
    assert 0.0 < walk.net_cost_of_transport < walk.cost_of_transport < 4.0


@pytest.mark.thorough
@pytest.mark.timeout(1200)
def test_ten_walks_with_errors_over_ten_facets_are_not_lost() -> None:
    """With the best rolls, at the costs that the gallery states."""
    gait = design_gait(SCENE)
    for seed in range(10):
        walk = walk_with_errors(gait, 10, seed)
        assert walk.status == "ok", (seed, walk)
        assert len(walk.facet) == 11
        assert walk.way[0] > 1.1, seed
        assert abs(walk.way[1]) < 0.25, seed
        assert walk.cost_of_transport < 1.85, seed
        assert 0.1 < walk.net_cost_of_transport < 0.25, seed


def test_the_schedule_of_a_walk_is_its_motion(gait: Gait) -> None:
    """In one piece, with finer samples; some of the work of winches is lost."""
    walk = gait.walk(2)
    whole = simulate(gait.model, walk.schedule.t_end, samples=1001, schedule=walk.schedule)
    np.testing.assert_allclose(whole.node_position[-1], walk.motions[-1].node_position[-1], atol=1e-6)
    work = gait.winches.find_work(whole, walk.schedule)
    scale = gait.winches.weight * np.linalg.norm(walk.way)
    assert work[work > 0.0].sum() / scale == pytest.approx(walk.cost_of_transport, rel=0.02)
    assert whole.total_energy[-1] - whole.total_energy[0] < work.sum()


def test_a_roll_that_does_not_come_about_is_repeated_with_more(gait: Gait) -> None:
    """A tenth of the changes does not tip it, and after five tries it is lost."""
    weak = Gait(
        gait.model, {step: 0.1 * row for step, row in gait.rolls.items()}, (), gait.winches, gait.facets
    )
    walk = weak.walk(1)
    assert walk.status == "lost"
    assert walk.message == "0 of 1 facets in 5 rolls"
    largest = [max(abs(row).max() for row in motion.input) for motion in walk.motions]  # type: ignore[union-attr]
    np.testing.assert_allclose(largest[1:], largest[1] * np.array([1.0, 1.15, 1.3, 1.45, 1.6]), rtol=1e-6)


PRISM = {
    "name": "rolling_prism",
    "gravity": [0, 0, -9.81],
    "classes": {
        "bar": {"kind": "bar", "mass": 0.1, "spring_constant": 3e4, "damping": 3},
        "cable": {"kind": "cable", "spring_constant": 300, "damping": 3},
    },
    "shape": {
        "kind": "prism",
        "bars": 3,
        "bottom_radius": 0.15,
        "height": 0.2,
        "node_mass": 0.05,
        "prestress": 20,
    },
    "ground": {"stiffness": 2e4, "dissipation": 0.3, "friction": 0.5},
    "actuators": [
        {"name": f"winch_{name}", "members": name}
        for name in (f"{kind}{k}" for kind in ("bottom", "top", "vertical") for k in (1, 2, 3))
    ],
}


@pytest.mark.thorough
def test_a_prism_of_springs_rolls_head_over_heels() -> None:
    """From its base over two of its sides to its top and on, though one kind of edge has no roll."""
    gait = design_gait(PRISM, max_iterations=60)
    assert len(gait.facets.facet) == 8
    assert len(gait.facets.symmetry) == 6
    assert len(gait.rolls) >= 3
    walk = gait.walk(6)
    assert walk.status == "ok"
    assert ("t1", "t2", "t3") in walk.facet
    assert len(set(walk.facet)) >= 5
    assert np.linalg.norm(walk.way) > 0.4


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("stiffness = 2e4", "stiffness = 2e4\nnormal = [0, 0.6, 0.8]", "normal"),
        ("n8 = {", "n8 = { anchored = true,", "anchors"),
    ],
)
def test_structures_that_cannot_roll_are_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    with pytest.raises(FormulationError, match=words):
        design_gait(write_scene(tmp_path, old, new))


def test_a_structure_without_winches_is_refused(tmp_path: Path) -> None:
    text = SCENE.read_text(encoding="utf-8")
    path = tmp_path / "no_winches.toml"
    path.write_text(text[: text.index("[[actuators]]")], encoding="utf-8")
    with pytest.raises(FormulationError, match="0 winches"):
        design_gait(path)


@pytest.mark.parametrize("bounds", [(0.01, 0.02), (0.9, 1.2)], ids=["below", "above"])
def test_a_winch_that_starts_outside_of_its_range_is_named(bounds: tuple[float, float]) -> None:
    motors: Any = PRISM["actuators"]
    scene = PRISM | {"actuators": [motors[0], motors[1] | {"range": bounds}, *motors[2:]]}
    rest = float(load_scene(scene)[0].rest_length[load_scene(scene)[0].member_name.index("bottom2")])
    with pytest.raises(InvalidValueError) as caught:
        design_gait(scene)
    assert caught.value.where == "rolling_prism: actuators.winch_bottom2.range"
    assert caught.value.given == f"the rest length of bottom2, {rest:.6g} m"
    assert caught.value.allowed == f"{bounds[0]:g} to {bounds[1]:g} m, the range of the winch"


@pytest.mark.parametrize("direction", [(0, 0), (1, 0, 0), (np.nan, 1)])
def test_a_direction_has_two_numbers(gait: Gait, direction: tuple[float, ...]) -> None:
    with pytest.raises(InvalidValueError, match="direction"):
        gait.walk(1, direction)
