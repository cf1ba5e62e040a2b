"""Equilibria and simulations of bodies by the generated C."""

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
from tensegrity_codegen.runtime.trajectory.simulation_quantities import simulation_quantities
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.system.errors import ConvergenceError, FormulationError
from tensegrity_codegen.tables.request import ModelRequest
from tests.body_scenes import EVERYTHING, BodyEvaluator, assemble_document, example
from tests.symbolic.test_bodies import as_structure, two_bars

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
