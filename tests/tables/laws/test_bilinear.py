"""Bilinear members in closed form: scenes, statics, motion across the switch, emitters and formulations."""

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.linear.linearize import LINEARIZE_QUANTITIES, linearize
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.paths.continuation import follow_path
from tensegrity_codegen.runtime.paths.model_path import ModelPath
from tensegrity_codegen.runtime.paths.watches import watch_switch
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.simulate.simulate_batch import simulate_batch
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.static_problem import EQUILIBRIUM_QUANTITIES
from tensegrity_codegen.runtime.trajectory.simulation_quantities import SIMULATION_QUANTITIES
from tensegrity_codegen.scene.describe import describe_structure
from tensegrity_codegen.scene.write import write_scene
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.outline import outline_tendons
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.codegen.table.long_structures import tower
from tests.runtime.build import cable, make_structure, prism, spring

EXAMPLES = Path(__file__).resolve().parents[3] / "tensegrity_codegen/scene/examples"
K, MASS = 100.0, 2.0
QUANTITIES = (
    *(
        "member_tension",
        "force_density",
        "elastic_energy",
        "potential_energy",
        "node_residual",
        "acceleration",
    ),
    *("material_stiffness", "geometric_stiffness", "tangent_stiffness", "state_jacobian", "cable_force"),
    *("rest_length_jacobian", "cable_margin", "switch_margin", "acceleration"),
)
RATIOS = (0.25, 3.0)


def with_law(structure: Structure, at: Any, ratio: Any) -> Structure:
    """Return the structure with a switch at an elongation [m] in every member where it is not zero."""
    at = np.broadcast_to(np.asarray(at, dtype=float), structure.n_members)
    ratio = np.where(at == 0, 0.0, ratio)
    return structure.with_changes(law_parameter={"switch_elongation": at, "stiffness_ratio": ratio})


def hanging(ratio: float, at: float, *, tension_only: bool = True, gravity: float = 0.0) -> Structure:
    """A mass on one vertical member of rest length 1 m."""
    member = (cable if tension_only else spring)(0, 1, 1.0, K)
    nodes = [[0, 0, 0], [0, 0, -1.0]]
    structure = make_structure(
        nodes, [member], anchored={0: "xyz"}, axes="z", mass=MASS, gravity=(0.0, 0.0, gravity)
    )
    return with_law(structure, at, ratio)


def compute_tension(structure: Structure, length: np.ndarray) -> np.ndarray:
    """Return the tensions without damping, written apart from the package."""
    x = length - structure.rest_length
    k = structure.spring_constant + structure.axial_stiffness / structure.rest_length
    at, ratio = (structure.law_parameter[name] for name in ("switch_elongation", "stiffness_ratio"))
    first = np.where(at > 0, np.minimum(x, at), np.where(at < 0, np.maximum(x, at), x))
    tension = k * (first + ratio * (x - first))
    return np.where(structure.tension_only & (x <= 0), 0.0, tension)


def load(structure: Structure, *quantities: str, **options: Any) -> CompiledModel:
    return build_library(structure, ModelRequest(quantities, **{"events": ("auto",), **options})).load()


# --- scenes ----------------------------------------------------------------------------------------

SCENE = """
name = "weight"
gravity = [0, 0, -9.81]
[model]
quantities = ["member_tension"]
[nodes]
top = {{ position = [0, 0, 0], anchored = true }}
low = {{ position = [0, 0, -1.2], mass = 2 }}
[members]
rope = {{ kind = "{kind}", nodes = ["top", "low"], {values} }}
"""


def read(folder: Path, values: str, kind: str = "cable") -> Structure:
    path = folder / "weight.toml"
    path.write_text(SCENE.format(values=values, kind=kind), encoding="utf-8")
    structure, _ = load_scene(path)
    assert isinstance(structure, Structure)
    return structure


@pytest.mark.parametrize("tension", [5.0, 20.0])
@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("stiffness", ["spring_constant = 100", "axial_stiffness = 110"])
@pytest.mark.parametrize("switch", ["switch_elongation = 0.1", "switch_force = 10"])
def test_a_prestress_has_its_rest_length(
    tmp_path: Path, tension: float, ratio: float, stiffness: str, switch: str
) -> None:
    values = f"{stiffness}, {switch}, stiffness_ratio = {ratio}, prestress = {tension}"
    structure = read(tmp_path, values)
    assert structure.static_tension() == pytest.approx([tension], rel=1e-13)
    assert compute_tension(structure, structure.member_length()) == pytest.approx([tension], rel=1e-13)
    if "force" in switch:
        at = structure.law_parameter["switch_elongation"] + structure.rest_length
        assert compute_tension(structure, at) == pytest.approx([10.0], rel=1e-13)


def test_a_bilinear_member_survives_a_scene_file(tmp_path: Path) -> None:
    structure = read(tmp_path, "spring_constant = 100, switch_force = 7, stiffness_ratio = 0")
    path = tmp_path / "again.toml"
    write_scene(describe_structure(structure), path)
    again, _ = load_scene(path)
    for name in ("switch_elongation", "stiffness_ratio"):
        assert np.array_equal(structure.law_parameter[name], again.law_parameter[name])
    assert again.law_parameter["switch_elongation"] == [7 / 100]


@pytest.mark.parametrize(
    ("values", "kind", "word"),
    [
        ("spring_constant = 9, switch_force = 1", "cable", "without stiffness_ratio"),
        ("spring_constant = 9, stiffness_ratio = 2", "cable", "without switch_elongation or switch_force"),
        ("spring_constant = 9, stiffness_ratio = 2, switch_force = 0", "cable", "switch_elongation is zero"),
        ("spring_constant = 9, stiffness_ratio = 2, switch_force = -1", "cable", "slack"),
        ("stiffness_ratio = 2, switch_elongation = 1", "bar", "a rigid bar cannot be bilinear"),
        (
            "spring_constant = 9, stiffness_ratio = 2, switch_elongation = 1, switch_force = 2",
            "cable",
            "cannot be given together",
        ),
    ],
)
def test_what_no_bilinear_member_can_have_is_refused(
    tmp_path: Path, values: str, kind: str, word: str
) -> None:
    with pytest.raises(InvalidValueError, match=word) as caught:
        read(tmp_path, values, kind)
    assert "members.rope" in str(caught.value)


# --- statics ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("at", [0.3, *thorough(0.05)])
def test_a_weight_hangs_where_the_tension_carries_it(ratio: float, at: float) -> None:
    gravity = -9.81
    model = load(hanging(ratio, at, gravity=gravity), *EQUILIBRIUM_QUANTITIES, *LINEARIZE_QUANTITIES)
    found = find_equilibrium(model)
    weight = MASS * -gravity
    is_beyond = weight > K * at
    elongation = at + (weight - K * at) / (ratio * K) if is_beyond else weight / K
    assert found.coordinate == pytest.approx([-1.0 - elongation], abs=1e-11)
    slope = K * (ratio if is_beyond else 1.0)
    stiffness = model.compute("tangent_stiffness", coordinate=found.coordinate).toarray()
    assert stiffness == pytest.approx(np.array([[slope]]), rel=1e-14)
    linear = linearize(model, coordinate=found.coordinate)
    assert np.abs(linear.A[1, 0]) == pytest.approx(slope / MASS, rel=1e-12)


def test_a_compressed_spring_switches_in_compression() -> None:
    model = load(hanging(0.5, -0.1, tension_only=False), "member_tension", "tangent_stiffness")
    for length, tension, slope in ((0.95, -5.0, 100.0), (0.8, -15.0, 50.0), (1.4, 40.0, 100.0)):
        assert model.compute("member_tension", coordinate=[-length]) == pytest.approx([tension])
        assert model.compute("tangent_stiffness", coordinate=[-length]).toarray() == pytest.approx(slope)


@pytest.mark.parametrize("ratio", RATIOS)
def test_a_load_path_leads_through_the_switch(ratio: float) -> None:
    at, most = 0.2, 40.0
    structure = hanging(ratio, at, gravity=-0.5)
    quantities = (*EQUILIBRIUM_QUANTITIES, "material_stiffness", "geometric_stiffness", "switch_margin")
    model = load(structure, *quantities, parameters={"node_load": (0, 1)})
    path = ModelPath(model, np.array([[0.0], [-1.0]]))
    start = find_equilibrium(model).coordinate
    found = follow_path(path, start, most=most, watches=watch_switch(path, structure.member_name))
    assert found.status == "completed"
    assert [event.names for event in found.find_events("switch")] == [("e0",)]
    force = found.load_factor + MASS * 0.5
    elongation = np.where(force <= K * at, force / K, at + (force - K * at) / (ratio * K))
    assert -1.0 - found.coordinate[:, 0] == pytest.approx(elongation, abs=1e-9)


# --- motion ----------------------------------------------------------------------------------------


def cross(ratio: float, at: float, speed: float, time: float) -> tuple[float, float]:
    """Return elongation at `time` and the time of the switch of a mass that starts at rest length."""
    first, second = np.sqrt(K / MASS), np.sqrt(ratio * K / MASS)
    crossing = np.arcsin(at * first / speed) / first
    slower = speed * np.cos(first * crossing)
    middle = at - at / ratio
    t = time - crossing
    return middle + (at - middle) * np.cos(second * t) + slower / second * np.sin(second * t), crossing


CROSSINGS = [("rk54", 0.25, True), ("radau", 3.0, False)]
OTHERS = [
    case for case in product(("rk54", "rk853", "radau"), RATIOS, (True, False)) if case not in CROSSINGS
]


@pytest.mark.parametrize(("method", "ratio", "tension_only"), [*CROSSINGS, *thorough(*OTHERS)])
def test_a_motion_across_the_switch_has_its_closed_form(
    method: str, ratio: float, tension_only: bool
) -> None:
    at, speed, time = 0.1, 1.5, 0.2
    structure = hanging(ratio, at, tension_only=tension_only)
    structure = structure.with_changes(node_velocity=np.array([[0, 0, 0], [0, 0, -speed]]))
    model = load(structure, *SIMULATION_QUANTITIES, integrators=(method,))
    expected, crossing = cross(ratio, at, speed, time)
    found = simulate(model, time, samples=3, method=method, rtol=1e-9)
    assert found.status == "ok"
    assert found.coordinate[-1] == pytest.approx([-1.0 - expected], abs=2e-8)
    events = [k for k, kind in enumerate(found.log.kind) if kind == "switch"]
    assert [found.log.name[k] for k in events] == ["e0"]
    assert found.log.time[events] == pytest.approx([crossing], abs=1e-8)
    assert found.log.direction[events].tolist() == [1]


def test_a_long_motion_keeps_its_energy_across_many_switches() -> None:
    structure = hanging(3.0, 0.1, gravity=-9.81)
    structure = structure.with_changes(node_velocity=np.array([[0, 0, 0], [0, 0, -1.5]]))
    model = load(structure, *SIMULATION_QUANTITIES, integrators=("rk853",))
    found = simulate(model, 10.0, samples=201, method="rk853", rtol=1e-9)
    assert found.status == "ok"
    assert found.log.kind.count("switch") > 10
    assert np.ptp(found.total_energy) < 1e-7 * np.ptp(found.coordinate) * MASS * 9.81


# --- emitters and formulations ---------------------------------------------------------------------


def bilinear_prism(damping: float = 0.0) -> Structure:
    """A prism whose bars switch in compression and whose cables switch in tension, some on either side."""
    structure = prism(strain=0.2, bar_stiffness=500.0, anchored={0: "xyz", 1: "z"}, gravity=(0.0, 0.0, -9.81))
    at = np.where(structure.is_bar, -0.01, np.where(np.arange(structure.n_members) % 3 == 0, 0.5, 0.1))
    ratio = np.where(np.arange(structure.n_members) % 2 == 0, 0.4, 2.5)
    changed = with_law(structure, at, ratio)
    return changed.with_changes(damping=np.full(structure.n_members, damping), name="kinked")


def states(structure: Structure, count: int = 3) -> list[np.ndarray]:
    places = structure.coordinate_node_axis
    start = structure.node_position[places[:, 0], places[:, 1]]
    random = np.random.default_rng(5)
    return [start + 0.05 * random.standard_normal(start.size) for _ in range(count)]


def member_length(structure: Structure, coordinate: np.ndarray) -> np.ndarray:
    position, places = structure.node_position.copy(), structure.coordinate_node_axis
    position[places[:, 0], places[:, 1]] = coordinate
    ends = position[structure.connectivity]
    return np.asarray(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1))


@pytest.mark.parametrize("emitter", ["table", *thorough("unrolled")])
@pytest.mark.parametrize("damping", [0.3, *thorough(0.0)])
def test_emitters_follow_the_law_and_each_other(emitter: str, damping: float) -> None:
    structure = bilinear_prism(damping)
    model = load(structure, *QUANTITIES, emitter=emitter)
    unrolled = load(structure, *QUANTITIES, emitter="unrolled")
    for q in states(structure):
        tension = compute_tension(structure, member_length(structure, q))
        assert model.compute("member_tension", coordinate=q) == pytest.approx(tension, rel=1e-12, abs=1e-12)
        step = 1e-6 * np.eye(q.size)
        residual = [model.compute("node_residual", coordinate=q + change) for change in (*step, *-step)]
        difference = (np.array(residual[q.size :]) - residual[: q.size]) / 2e-6
        stiffness = model.compute("tangent_stiffness", coordinate=q).toarray()
        assert stiffness == pytest.approx(difference, rel=1e-6, abs=1e-5)
        for name in QUANTITIES:
            if not model.has(name):
                continue
            one, other = (m.compute(name, coordinate=q) for m in (model, unrolled))
            one, other = (getattr(x, "toarray", lambda x=x: x)() for x in (one, other))
            assert np.asarray(one) == pytest.approx(np.asarray(other), rel=1e-12, abs=1e-11), name


@pytest.mark.thorough
@pytest.mark.parametrize("flags", ["reference", *thorough("native")])
def test_a_tower_in_tables_follows_the_law(flags: str) -> None:
    structure = tower(12)
    length = structure.member_length()
    kinds = np.where(structure.is_bar, -0.01, 0.02) * length
    structure = with_law(structure, kinds, np.where(structure.is_bar, 0.5, 2.0))
    model = load(
        structure, "node_residual", "member_tension", "potential_energy", emitter="table", flags=flags
    )
    plain = load(structure, "node_residual", emitter="unrolled")
    for q in states(structure, 2):
        tension = compute_tension(structure, member_length(structure, q))
        assert model.compute("member_tension", coordinate=q) == pytest.approx(tension, rel=1e-11, abs=1e-9)
        one, other = (m.compute("node_residual", coordinate=q) for m in (model, plain))
        assert one == pytest.approx(other, rel=1e-11, abs=1e-9)


def test_batches_compute_what_single_calls_do() -> None:
    structure = bilinear_prism()
    model = load(structure, "member_tension", "acceleration", batch_width=4)
    many = np.array(states(structure, 7))
    for name in ("member_tension", "acceleration"):
        single = np.array([model.compute(name, coordinate=q) for q in many])
        assert model.compute_batch(name, coordinate=many) == pytest.approx(single, rel=1e-13, abs=1e-12)


@pytest.mark.thorough
def test_batches_of_motions_have_the_closed_form() -> None:
    model = load(hanging(3.0, 0.1), *SIMULATION_QUANTITIES, integrators=("rk853",), batch_width=4)
    speed = np.array([1.2, 1.3, 1.4, 1.5, 1.6])
    found = simulate_batch(model, 0.2, samples=3, rtol=1e-8, velocity=-speed[:, None])
    expected = [cross(3.0, 0.1, one, 0.2)[0] for one in speed]
    assert set(found.status) == {"ok"}
    assert -1.0 - found.coordinate[:, -1, 0] == pytest.approx(expected, abs=1e-5)


@pytest.mark.thorough
def test_node_distances_and_node_positions_move_alike() -> None:
    structure = bilinear_prism()
    ends = []
    for formulation in ("node_position", "node_distance"):
        wanted = SIMULATION_QUANTITIES
        if formulation == "node_distance":
            wanted = (*wanted, "node_position", "node_velocity")
        model = load(structure, *wanted, formulation=formulation, integrators=("rk853",))
        found = simulate(model, 0.3, samples=4, method="rk853", rtol=1e-9)
        assert found.status == "ok"
        assert "switch" in found.log.kind
        ends.append(found.node_position[-1])
    assert ends[0] == pytest.approx(ends[1], abs=1e-7)


@pytest.mark.thorough
def test_cables_of_rigid_bars_follow_the_law() -> None:
    structure = prism(strain=0.2, anchored={0: "xyz", 1: "z"})
    bar = structure.is_bar
    rigid = structure.with_changes(
        spring_constant=np.where(bar, 0.0, structure.spring_constant),
        rest_length=np.where(bar, structure.member_length(), structure.rest_length),
    )
    rigid = with_law(rigid, np.where(bar, 0.0, 0.1), 2.5)
    model = load(rigid, *SIMULATION_QUANTITIES, formulation="rigid_bar", integrators=("rk54", "radau"))
    tension = compute_tension(rigid, rigid.member_length())
    assert model.compute("member_tension")[~bar] == pytest.approx(tension[~bar], rel=1e-12)
    ends = [simulate(model, 0.2, samples=3, method=m, rtol=1e-8) for m in ("rk54", "radau")]
    assert [run.status for run in ends] == ["ok", "ok"]
    assert ends[0].node_position[-1] == pytest.approx(ends[1].node_position[-1], abs=1e-6)


def test_tendons_of_bodies_follow_the_law() -> None:
    system, _ = load_scene(EXAMPLES / "lin_prism.toml")
    assert isinstance(system, BodySystem)
    at = np.full(system.n_members, 0.02)
    values = {"switch_elongation": at, "stiffness_ratio": np.full(system.n_members, 0.3)}
    bent = system.with_changes(law_parameter=values)
    model = build_library(
        bent, ModelRequest(("member_tension", "switch_margin"), formulation="bodies")
    ).load()
    length = outline_tendons(bent).member_length()
    assert (length - bent.rest_length > at).any()
    tension = compute_tension(outline_tendons(bent), length)
    assert model.compute("member_tension") == pytest.approx(tension, rel=1e-9)
    assert model.compute("switch_margin") == pytest.approx(length - bent.rest_length - at, abs=1e-12)
