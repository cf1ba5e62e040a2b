"""x"""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.analyses import equilibrium_quantities
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.linear.linearize import linearize
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.statics.equilibrium import build_problem, find_equilibrium
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.runtime.trajectory.simulation_quantities import simulation_quantities
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import ConvergenceError, FormulationError, InvalidValueError
from tensegrity_codegen.tables.request import ModelRequest
from tests.body_scenes import EVERYTHING, BodyEvaluator, assemble_document, example
from tests.reference import ReferenceModel
from tests.runtime.build import bar, cable, make_structure, prism, spring
from tests.runtime.rigid_reference import RigidReference, stiffened
from tests.symbolic.test_bodies import as_structure, two_bars

DOWN = (0.0, 0.0, -9.81)
FEET = {0: "xyz", 1: "xyz", 2: "xyz"}


def settle(structure: Structure, **options: Any) -> Equilibrium:
    return find_equilibrium(RigidReference(structure), **options)


def rod(i: int, j: int, position: Any, **more: Any) -> dict[str, Any]:
    """A rigid bar between two nodes as they are."""
    return bar(i, j, float(np.linalg.norm(np.subtract(position[i], position[j]))), 0.0, **more)


def pendulum(start: Any = (0, 0, -2), **more: Any) -> Structure:
    place = [[0, 0, 0], start]
    return make_structure(place, [rod(0, 1, place, **more)], anchored={0: "xyz"}, gravity=DOWN, mass=3.0)


@pytest.mark.parametrize(
    ("method", "start"),
    [
        ("newton", (0, 0, 2)),
        ("newton", (1.2, 1.6, 0)),
        ("relaxation", (1.2, 1.6, 0)),
        ("auto", (0, 0.1, -1.9)),
    ],
)
def test_a_bar_with_own_mass_hangs(method: Any, start: Any) -> None:
    """t = (M + m/2) g: half of the bar's weight acts at each of its ends; the stiffness is t / l."""
    structure = pendulum(start, mass=0.5)
    found = settle(structure, method=method)
    length = float(np.linalg.norm(start))
    force = (3.0 + 0.25) * 9.81
    np.testing.assert_allclose(found.node_position[1], [0, 0, -length], atol=1e-7)
    assert found.member_tension[0] == pytest.approx(force, rel=1e-12)
    assert found.smallest_eigenvalue == pytest.approx(force / length, rel=1e-12)
    assert found.neutral_motions == 0


def test_an_a_frame_carries_its_load_in_compression() -> None:
    """t = -P / (2 sin 45 deg) in the plane, where nothing can move."""
    place = [[0, 0, 0], [2, 0, 0], [1, 0, 1]]
    frame = make_structure(
        place, [rod(0, 2, place), rod(1, 2, place)], anchored={0: "xz", 1: "xz"}, axes="xz",
        load={2: (0, 0, -10)},
    )  # fmt: skip
    found = settle(frame)
    np.testing.assert_allclose(found.member_tension, -10 / np.sqrt(2), rtol=1e-14)
    assert found.displacement == 0.0
    assert found.smallest_eigenvalue == np.inf


def test_a_strut_between_two_springs_is_stable_by_their_stiffness_alone() -> None:
    """Upright strut of length 1 under P, held sideways by 2 k: eigenvalue 2 k - P / l, t = -P."""
    place = [[0, 0, 0], [0, 0, 1], [-1, 0, 1], [1, 0, 1]]
    members = [rod(0, 1, place), spring(1, 2, 1.0, 30.0), spring(1, 3, 1.0, 30.0)]
    strut = make_structure(
        place, members, anchored={0: "xz", 2: "xz", 3: "xz"}, axes="xz", load={1: (0, 0, -20)}
    )
    found = settle(strut)
    assert found.member_tension[0] == pytest.approx(-20.0, rel=1e-14)
    assert found.smallest_eigenvalue == pytest.approx(60.0 - 20.0, rel=1e-14)
    heavier = strut.with_changes(node_load=4 * strut.node_load)
    assert settle(heavier).displacement > 0.5


def chain() -> Structure:
    """Three bars in a row that meet (class 2), one with mass, two cables, from an upright start."""
    place = [[0, 0, 0], [0.1, 0, 1], [0.05, 0.02, 2], [0.3, 0, 3], [2, 0, 1]]
    members = [rod(0, 1, place), rod(1, 2, place, mass=0.5), rod(2, 3, place)]
    members += [cable(0, 3, 1.0, 40.0), cable(2, 4, 1.5, 25.0), cable(1, 4, 3.0, 25.0)]
    return make_structure(place, members, anchored={0: "xyz", 4: "xyz"}, gravity=DOWN)


def mixed() -> Structure:
    """A prism on the ground under loads, two of its bars rigid and one stiff, far from equilibrium."""
    start = prism(twist=110.0, anchored=FEET, gravity=DOWN, load={3: (5.0, 2.0, -8.0)}, mass=0.1)
    rigid = np.flatnonzero(start.is_bar)[:2]
    constant = start.spring_constant.copy()
    constant[rigid] = 0.0
    return start.with_changes(spring_constant=constant)


@pytest.mark.parametrize("make", [chain, mixed])
def test_rigid_bars_are_the_limit_of_stiff_ones(make: Any) -> None:
    structure = make()
    found = settle(structure)
    stiff = find_equilibrium(ReferenceModel(stiffened(structure, 1e9)))
    extent = float(np.ptp(found.node_position, axis=0).max())
    assert found.status == "converged"
    assert np.abs(found.node_position - stiff.node_position).max() < 1e-6 * extent
    assert np.abs(found.member_tension - stiff.member_tension).max() < 1e-6 * found.largest_force
    assert found.smallest_eigenvalue == pytest.approx(stiff.smallest_eigenvalue, rel=1e-5)
    rigid = structure.is_rigid
    assert np.abs(found.member_length - structure.rest_length)[rigid].max() < 1e-15 * 8
    assert found.residual < 1e-9 * found.largest_force


def test_a_free_prism_keeps_its_rigid_motions_and_its_self_stress() -> None:
    structure = prism()
    structure = structure.with_changes(
        spring_constant=np.where(structure.is_bar, 0.0, structure.spring_constant)
    )
    found = settle(structure)
    stiff = find_equilibrium(ReferenceModel(stiffened(structure, 1e9)))
    assert found.neutral_motions == stiff.neutral_motions == 6
    np.testing.assert_allclose(found.member_tension, stiff.member_tension, rtol=1e-6)
    np.testing.assert_allclose(found.member_length, stiff.member_length, rtol=1e-7)
    assert (found.member_tension[structure.is_bar] < 0).all()


def test_cables_may_go_slack_and_methods_agree() -> None:
    structure = chain()
    newton, relaxed = (settle(structure, method=method) for method in ("newton", "relaxation"))
    assert newton.member_tension[5] == 0.0
    assert np.abs(newton.node_position - relaxed.node_position).max() < 1e-6


def test_what_nothing_holds_has_no_equilibrium() -> None:
    place = [[0, 0, 0], [0, 0, -1]]
    falling = make_structure(place, [rod(0, 1, place)], gravity=DOWN)
    found = settle(falling, raise_on_failure=False)
    assert found.status == "no_equilibrium"


def test_bars_take_other_lengths_where_they_can_and_are_named_where_they_cannot() -> None:
    longer = settle(pendulum(), arguments={"rest_length": [2.5]})
    np.testing.assert_allclose(longer.node_position[1], [0, 0, -2.5], atol=1e-12)
    place = [[0, 0, 0], [2, 0, 0], [1, 0, 1]]
    members = [rod(0, 2, place), rod(1, 2, place)]
    frame = make_structure(place, members, anchored={0: "xz", 1: "xz"}, axes="xz", load={2: (0, 0, -10)})
    with pytest.raises(InvalidValueError, match="has the lengths of the rigid bars"):
        settle(frame, arguments={"rest_length": [0.5, 0.5]})


PENDULUM: dict[str, Any] = {
    "name": "pendulum",
    "gravity": [0, 0, -10],
    "bodies": {
        "hook": {"kind": "fixed", "points": {"p": [0, 0, 1]}},
        "rod": {
            "kind": "bar", "length": 0.6, "mass": 0.5, "anchor": "hook.p", "polar_axis": "x",
            "direction": [0.3, 0.1, -1],
        },
    },
    "tendons": {"slack": {"points": ["hook.p", "rod.B"], "spring_constant": 1.0, "rest_length": 5.0}},
}  # fmt: skip


def statics(system: BodySystem, **parameters: tuple[int, ...]) -> CompiledModel:
    request = ModelRequest((), parameters=parameters, formulation="bodies")
    return build_library(system, request.wanting(*equilibrium_quantities(system, request))).load()


def dynamics(system: BodySystem, *more: str) -> CompiledModel:
    request = ModelRequest((), formulation="bodies")
    wanted = request.wanting(*simulation_quantities("bodies"), *more, integrators=("rk4", "rk54"))
    return build_library(system, wanted).load()


def test_the_tower_rests_as_stated_and_comes_back_from_elsewhere() -> None:
    tower = example("svd_tower")
    model = statics(tower)
    there = find_equilibrium(model)
    assert there.iterations == 0
    back = find_equilibrium(model, coordinate=tower.coordinate + 0.03 * np.cos(np.arange(18)))
    np.testing.assert_allclose(back.coordinate, tower.coordinate, atol=1e-9)
    np.testing.assert_allclose(back.member_tension[[0, 6, 12]], [26.109, 1.850, 18.378], atol=6e-4)
    hessian = BodyEvaluator(tower)("tangent_stiffness")
    assert back.smallest_eigenvalue == pytest.approx(np.linalg.eigvalsh(hessian)[0], rel=1e-6)


def test_a_hanging_rod_is_found_without_any_tendon() -> None:
    system, _ = assemble_document(PENDULUM)
    found = find_equilibrium(statics(system))
    np.testing.assert_allclose(found.node_position[system.find_node("rod_B")], [0, 0, 0.4], atol=1e-9)
    # m g l / 2 about both axes; the azimuth counts by the radian as well, for the chart is about x.
    assert found.smallest_eigenvalue == pytest.approx(0.5 * 10 * 0.3, rel=1e-6)


def test_an_upright_rod_is_left_for_the_hanging_one() -> None:
    system, _ = assemble_document({**PENDULUM, "bodies": {
        **PENDULUM["bodies"],
        "rod": {**PENDULUM["bodies"]["rod"], "direction": [0, 0, 1]},
    }})  # fmt: skip
    found = find_equilibrium(statics(system))
    assert found.energy_change == pytest.approx(-2 * 0.5 * 10 * 0.3, rel=1e-9)


def test_a_minimum_at_the_pole_of_the_angles_is_not_passed_off_as_found() -> None:
    document = {**PENDULUM, "bodies": {
        **PENDULUM["bodies"],
        "rod": {**PENDULUM["bodies"]["rod"], "polar_axis": "z"},
    }}  # fmt: skip
    system, _ = assemble_document(document)
    with pytest.raises(ConvergenceError) as caught:
        find_equilibrium(statics(system), max_iterations=60)
    assert "rod" in str(caught.value)
    assert "pole" in caught.value.evidence["message"]


@pytest.mark.thorough
def test_free_bars_settle_on_a_line_with_five_neutral_motions() -> None:
    """Three translations and two rotations; the third, about the line, moves no point."""
    document = two_bars()
    del document["gravity"]
    system, _ = assemble_document(document)
    found = find_equilibrium(statics(system))
    assert found.neutral_motions == 5
    assert found.is_found
    ends = found.node_position - found.node_position.mean(axis=0)
    assert np.linalg.svd(ends, compute_uv=False)[1] < 1e-3


def test_free_bars_under_weight_have_no_equilibrium() -> None:
    system, _ = assemble_document(two_bars())
    with pytest.raises(ConvergenceError):
        find_equilibrium(statics(system), max_iterations=200)


def test_loads_without_potential_are_refused_with_their_place() -> None:
    system, _ = assemble_document(EVERYTHING)
    with pytest.raises(FormulationError, match="no potential") as caught:
        find_equilibrium(statics(system))
    assert "mast" in str(caught.value.given) or "plate" in str(caught.value.given)
    tower = example("svd_tower")
    with pytest.raises(FormulationError, match="no potential"):
        find_equilibrium(statics(tower), arguments={"input": [0, 0, 1.0, 0, 0, 0]})


def test_coordinates_are_scaled_to_the_way_of_the_points() -> None:
    tower = example("svd_tower")
    problem = build_problem(statics(tower))
    inside = problem.to_search_coordinate(tower.coordinate)
    scale = inside[0] / tower.coordinate[0]
    assert scale == pytest.approx(1.0)  # declination: the far end moves l a radian
    azimuth = tower.coordinate_name.index("bar11_azimuth")
    assert inside[azimuth] / tower.coordinate[azimuth] == pytest.approx(np.sin(np.radians(40)))
    np.testing.assert_allclose(problem.to_model_coordinate(inside), tower.coordinate)


def test_energy_of_an_undamped_system_is_conserved() -> None:
    document = {key: value for key, value in EVERYTHING.items() if key not in ("joint_friction", "inputs")}
    document["loads"] = EVERYTHING["loads"][:1]
    document["tendons"] = {
        name: {**tendon, "damping": 0.0, "tension_only": False}
        for name, tendon in EVERYTHING["tendons"].items()
    }
    document["tendons"]["t4"] = {"class": "wire", "points": ["leg.A", "ground.a"]}
    system, _ = assemble_document(document)
    motion = simulate(dynamics(system), 0.5, samples=21, method="rk4", stepping=Stepping(step=1e-4))
    assert motion.status == "ok"
    assert np.abs(motion.total_energy - motion.total_energy[0]).max() < 1e-8
    assert np.ptp(motion.kinetic_energy) > 0.1


@pytest.mark.thorough
@pytest.mark.parametrize("method", ["scipy_dop853", "scipy_lsoda"])
def test_the_c_loop_and_scipy_agree(method: str) -> None:
    system, _ = assemble_document(EVERYTHING)
    model = dynamics(system)
    by_c = simulate(model, 0.1, samples=5, method="rk4", stepping=Stepping(step=1e-5))
    by_scipy = simulate(model, 0.1, samples=5, method=method, rtol=1e-10, stepping=Stepping(atol=1e-12))
    np.testing.assert_allclose(by_c.coordinate, by_scipy.coordinate, atol=1e-7)
    np.testing.assert_allclose(by_c.node_position, by_scipy.node_position, atol=1e-7)


@pytest.mark.thorough
def test_friction_and_damping_take_energy_away() -> None:
    document = {**EVERYTHING, "loads": EVERYTHING["loads"][:1], "inputs": []}
    system, _ = assemble_document(document)
    motion = simulate(dynamics(system), 0.3, samples=31, method="rk4", stepping=Stepping(step=1e-4))
    assert (np.diff(motion.total_energy) < 1e-12).all()
    assert motion.energy_drift is None


@pytest.mark.thorough
def test_passing_the_pole_of_the_angles_is_reported_with_body_and_time() -> None:
    document = {**PENDULUM, "bodies": {
        **PENDULUM["bodies"],
        "rod": {**PENDULUM["bodies"]["rod"], "polar_axis": "z", "direction": [0.5, 0, -1]},
    }}  # fmt: skip
    system, _ = assemble_document(document)
    model = dynamics(system)
    motion = simulate(model, 1.0, samples=101, method="rk4", stepping=Stepping(step=1e-4))
    assert motion.status == "at_pole"
    assert "'rod'" in motion.message
    assert "polar_axis" in motion.message
    # The chart about another axis handles the same swing.
    fine = {
        **document,
        "bodies": {**document["bodies"], "rod": {**document["bodies"]["rod"], "polar_axis": "auto"}},
    }
    swing = simulate(dynamics(assemble_document(fine)[0]), 1.0, samples=101)
    assert swing.status == "ok"
    assert swing.energy_drift is not None
    assert swing.energy_drift < 1e-5


@pytest.mark.thorough
def test_stiff_springs_approach_rigid_bars_as_one_over_their_stiffness() -> None:
    """Two free bars: half a bar's mass at each end, bars as springs of 1e3, 1e4, 1e5 times the cables."""
    system, _ = assemble_document(two_bars())
    rigid = simulate(
        dynamics(system), 0.5, samples=6, method="rk4", stepping=Stepping(step=1e-4)
    ).node_position
    errors = []
    for kappa in (1e3, 1e4, 1e5):
        structure = as_structure(20.0 * kappa)
        request = ModelRequest(()).wanting(
            *simulation_quantities("node_position"), integrators=("rk4", "rk54")
        )
        model = build_library(structure, request).load()
        soft = simulate(model, 0.5, samples=6, method="rk4", stepping=Stepping(step=2e-5)).node_position
        errors.append(float(np.abs(soft - rigid).max()))
    assert errors[0] / errors[1] == pytest.approx(10, rel=0.3)
    assert errors[1] / errors[2] == pytest.approx(10, rel=0.3)
    assert errors[2] < 1e-4


@pytest.mark.thorough
def test_a_symmetrical_tower_stays_symmetrical() -> None:
    """SCS (21) to (25): released from a symmetrical configuration out of balance."""
    tower = example("svd_tower")
    q = tower.coordinate.copy()
    q[[k for k, name in enumerate(tower.coordinate_name) if name.endswith("declination")]] += 0.01
    motion = simulate(
        dynamics(tower), 0.2, samples=3, method="rk4", stepping=Stepping(step=1e-3), coordinate=q
    )
    end = dict(zip(tower.coordinate_name, motion.coordinate[-1], strict=True))
    tilt = [end[f"top_{name}"] for name in ("phi", "theta", "x", "y")]
    np.testing.assert_allclose(tilt, 0, atol=1e-12)
    lower = [end[f"bar{i}1_declination"] for i in (1, 2, 3)]
    np.testing.assert_allclose(lower, lower[0], atol=1e-12)


@pytest.mark.thorough
def test_the_linear_model_of_the_tower_has_its_inputs() -> None:
    tower = example("svd_tower")
    request = ModelRequest(("state_derivative", "state_jacobian", "input_jacobian"), formulation="bodies")
    linear = linearize(build_library(tower, request).load())
    assert linear.input_name == ("M1", "M2", "M3", "F1", "F2", "F3")
    assert linear.state_name[0] == "bar11_declination"
    assert linear.spectrum.growing == 0
    mass = BodyEvaluator(tower)("mass_matrix")
    by_load = np.linalg.solve(mass, -BodyEvaluator(tower)("load_matrix"))
    np.testing.assert_allclose(linear.B.toarray()[18:], by_load, atol=1e-10)
