"""Every kind of limit: paths keep it at every point, and end at it where it is in the way."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.control.planning.plan import plan
from tensegrity_codegen.runtime.records.plan_result import PlanResult
from tensegrity_codegen.structure.actuators import Actuator
from tensegrity_codegen.structure.structure import ActuatedInput
from tests.control.planning.structures import actuate, build_prism, compile_plan, limit

WITHIN = 1e-6


@pytest.fixture(scope="module")
def model() -> Any:
    return compile_plan(limit(actuate(build_prism(155.0))))


def find(model: Any, target: str = "twist=165", **limits: Any) -> PlanResult:
    return plan(model, target, limits=replace(model.structure.limits, **limits), least_progress=0.0)


def test_the_least_stiffness(model: Any) -> None:
    free = find(model)
    least = 0.5 * (free.smallest_eigenvalue[0] + free.smallest_eigenvalue.min())
    assert free.smallest_eigenvalue.min() < least
    found = find(model, least_stiffness=least)
    assert found.status == "found"
    assert found.smallest_eigenvalue.min() >= least * (1 - WITHIN)
    assert any(item.limit == "least_stiffness" for items in found.binding for item in items)


@pytest.mark.thorough
def test_the_yield_stress_of_bars(model: Any) -> None:
    structure = model.structure
    free = find(model)  # the bars have 29.6 N at the start, and more later
    bars = structure.is_bar
    assert np.abs(free.member_tension[:, bars]).max() > 29.65
    stress = np.full(structure.n_members, np.inf)
    stress[bars] = 29.65 / structure.section_area[bars]
    found = find(model, yield_stress=stress)
    assert found.status == "found"
    assert np.abs(found.member_tension[:, bars]).max() <= 29.65 * (1 + WITHIN)


def test_buckling_of_bars(model: Any) -> None:
    structure = model.structure
    bars = structure.is_bar
    flexural = np.pi**2 * structure.mu * structure.rest_length * structure.gyration_square
    load = (flexural / structure.member_length() ** 2)[bars].min()
    free = find(model)
    factor = load / 29.7
    found = find(model, buckling=np.where(bars, factor, 0.0))
    assert found.status == "found"
    ends = found.node_position[:, structure.connectivity]
    length = np.linalg.norm(ends[:, :, 0] - ends[:, :, 1], axis=2)[:, bars]
    use = -found.member_tension[:, bars] * factor / (flexural[bars] / length**2)
    assert use.max() <= 1 + WITHIN
    assert np.abs(free.change - found.change).max() > 1e-6


@pytest.mark.thorough
def test_the_largest_tension(model: Any) -> None:
    cable = ~model.structure.is_bar
    most = np.where(cable, 20.0 + 1e-9, np.inf)
    found = find(model, "twist=157", most_tension=most)
    assert found.status == "found"
    assert found.member_tension[:, cable].max() <= 20.0 * (1 + WITHIN)


def test_the_clearance(model: Any) -> None:
    found = find(model, "twist=165.1", clearance=0.02)
    assert found.status == "found"
    assert found.bar_distance.min() >= 0.02 * (1 - WITHIN)
    assert any(item.limit == "clearance" for item in found.binding[-1])


@pytest.mark.parametrize("target", ['member_tension["vertical1"]=19', 'bar_distance["bar1_bar2"]=0.03'])
def test_a_target_on_its_limit_is_met(model: Any, target: str) -> None:
    limits = {"least_tension": np.where(model.structure.is_bar, -np.inf, 1.0), "clearance": 0.03}
    if "tension" in target:
        limits = {"least_tension": limits["least_tension"]}
        limits["least_tension"][model.structure.member_name.index("vertical1")] = 19.0
    found = find(model, target, **limits)
    assert found.status == "found", found.message
    assert found.progress[-1] == 1.0
    np.testing.assert_allclose(found.target[-1], found.goal, rtol=1e-8)
    assert found.bar_distance.min() >= limits.get("clearance", 0.002) * (1 - WITHIN)
    assert np.all(found.member_tension >= limits["least_tension"] * (1 - WITHIN))


@pytest.fixture(scope="module")
def doubled() -> Any:
    """Return a prism whose first vertical has two actuators, and another two members share one."""
    structure = build_prism(155.0)
    place = structure.member_name.index
    one, two, three = (place(f"vertical{k}") for k in (1, 2, 3))
    rest = float(structure.rest_length[one])
    wide = (0.2, rest + 0.02)
    actuators = (
        Actuator("coarse", (one,), range=wide),
        Actuator("fine", (one,), range=wide),
        Actuator("pair", (two, three), range=(0.2, rest + 0.01)),
        *(Actuator(f"opposite{k}", (place(f"opposite{k}"),)) for k in (1, 2, 3)),
    )
    inputs = tuple(ActuatedInput(item.name, "rest_length", item.members) for item in actuators)
    return compile_plan(limit(structure.with_changes(actuators=actuators, inputs=inputs), least=0.1))


@pytest.mark.thorough
def test_the_ranges_of_two_actuators_on_one_member_hold_for_its_rest_length(doubled: Any) -> None:
    structure = doubled.structure
    rest = float(structure.rest_length[structure.member_name.index("vertical1")])
    found = plan(doubled, f'rest_length("vertical1")={rest + 0.01}')
    assert found.status == "found", found.message
    assert found.rest_length[-1, 0] == pytest.approx(rest + 0.01, rel=1e-7)
    np.testing.assert_array_equal(found.rest_length[:, 0], found.rest_length[:, 1])
    assert found.rest_length[-1, 0] == pytest.approx(rest + found.change[-1, :2].sum(), rel=1e-12)
    over = plan(doubled, f'rest_length("vertical1")={rest + 0.03}')
    assert over.status == "infeasible"
    assert over.certificate is not None
    assert over.certificate.allowed == pytest.approx(rest + 0.02, rel=1e-9)
    alone = plan(doubled, "twist=150.5", actuators=["coarse"], least_progress=0.0)
    assert alone.rest_length.max() <= rest + 0.02 * (1 + WITHIN)


def test_ranges_count_inputs_that_the_plan_holds(doubled: Any) -> None:
    structure = doubled.structure
    rest = float(structure.rest_length[structure.member_name.index("vertical1")])
    target = f'rest_length("vertical1")={rest + 0.013}'
    found = plan(doubled, target, actuators=["coarse", "opposite1"], arguments={"fine": 0.01})
    assert found.status == "found", found.message
    assert found.rest_length[[0, -1], 0] == pytest.approx([rest + 0.01, rest + 0.013], rel=1e-7)
    assert found.change[-1, 0] == pytest.approx(0.003, rel=1e-5)
    over = plan(doubled, f'rest_length("vertical1")={rest + 0.021}', arguments={"fine": 0.01})
    assert over.status == "infeasible"


def test_a_range_holds_for_each_member_of_an_actuator(doubled: Any) -> None:
    structure = doubled.structure
    place = structure.member_name.index("vertical3")
    found = plan(doubled, f'rest_length("vertical3")={structure.rest_length[place] + 0.02}')
    assert found.status == "infeasible"


def test_the_range_of_one_actuator() -> None:
    structure = actuate(build_prism(155.0), within=0.005)
    found = plan(compile_plan(limit(structure)), "twist=158")
    assert found.status == "found"
    assert np.abs(found.change).max() <= 0.005 * (1 + WITHIN)
