"""Equilibria with known answers: springs, pendulum, prism, von Mises truss, nets."""

import numpy as np
import pytest

from tensegrity_codegen.runtime.statics import newton
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.structure.structure import ActuatedInput
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    FormulationError,
    InvalidValueError,
    NonFiniteError,
    UnknownNameError,
    UnstableError,
)
from tests.cases import thorough
from tests.reference import ReferenceModel
from tests.runtime.build import bar, cable, make_structure, prism, spring

DOWN = (0.0, 0.0, -9.81)


def settle(structure, **options):
    return find_equilibrium(ReferenceModel(structure), **options)


def pendulum(**more):
    """1 kg on a bar of 1 m and 100 N/m, hung from the origin: l = 1 + 9.81 / 100."""
    return make_structure([[0, 0, 0], [0, 0, -1]], [bar(0, 1, 1.0, 100.0)], anchored={0: "xyz"}, **more)


def test_mass_between_two_springs() -> None:
    """k1 (x - rho1) = k2 (2 - x - rho2) + m g for a mass at depth x between anchors 2 m apart."""
    structure = make_structure(
        [[0, 0, 0], [0, 0, -1], [0, 0, -2]],
        [spring(0, 1, 0.8, 100.0), spring(1, 2, 0.7, 50.0)],
        anchored={0: "xyz", 2: "xyz"}, gravity=DOWN,
    )  # fmt: skip
    found = settle(structure)
    depth = (9.81 + 100 * 0.8 + 50 * (2 - 0.7)) / 150
    np.testing.assert_allclose(found.coordinate, [0, 0, -depth], atol=1e-12)
    np.testing.assert_allclose(found.member_tension, [100 * (depth - 0.8), 50 * (1.3 - depth)])
    assert found.status == "converged"
    assert found.displaced_node == "n1"
    assert found.displacement == pytest.approx(depth - 1)


@pytest.mark.parametrize("start", [[1.0, 0, 0], [0.3, -0.4, 0.6], [0, 0, 1 - 9.81 / 100], [0, 0, 2.0]])
def test_pendulum_hangs_from_any_start_even_the_upright_saddle(start) -> None:
    found = settle(pendulum(gravity=DOWN), coordinate=start)
    length = 1 + 9.81 / 100
    np.testing.assert_allclose(found.coordinate, [0, 0, -length], atol=1e-8)
    assert found.smallest_eigenvalue == pytest.approx(9.81 / length, rel=1e-7)
    assert found.neutral_motions == 0
    assert found.energy_change < 0


def test_pendulum_without_gravity_turns_freely() -> None:
    found = settle(pendulum(), coordinate=[0.6, 0.5, -0.9])
    assert found.neutral_motions == 2
    assert found.member_length == pytest.approx([1.0], abs=1e-13)
    assert found.smallest_eigenvalue == pytest.approx(100.0)


def test_upright_pendulum_is_unstable_where_the_method_stays_there() -> None:
    start = [0, 0, 1 - 9.81 / 100]
    found = settle(pendulum(gravity=DOWN), coordinate=start, method="relaxation", raise_on_failure=False)
    assert found.status == "unstable"
    assert found.smallest_eigenvalue == pytest.approx(-9.81 / start[2])
    with pytest.raises(UnstableError, match="saddle"):
        settle(pendulum(gravity=DOWN), coordinate=start, method="relaxation")


@pytest.mark.thorough
@pytest.mark.parametrize("bar_stiffness", [1e5, *thorough(1e3, 1e7)])
@pytest.mark.parametrize("sides", [3, *thorough(4, 5)])
def test_free_prism_turns_to_the_twist_of_its_selfstress(sides: int, bar_stiffness: float) -> None:
    """A prism of n bars is in equilibrium with itself at the twist 90 + 180/n degrees alone."""
    twist = 90 + 180 / sides
    found = settle(prism(twist - 20, sides=sides, bar_stiffness=bar_stiffness))
    place = found.node_position
    low, high = place[:sides], place[sides:]
    normal = high.mean(axis=0) - low.mean(axis=0)
    normal /= np.linalg.norm(normal)
    a, b = low[0] - low.mean(axis=0), high[0] - high.mean(axis=0)
    angle = np.degrees(np.arctan2(normal @ np.cross(a, b), a @ b)) % 360
    assert found.status == "converged"
    assert angle == pytest.approx(twist, abs=1e-6)
    assert found.neutral_motions == 6
    assert found.smallest_eigenvalue > 1
    bars = found.member_tension[::4]
    assert np.all(bars < 0)
    assert np.ptp(bars) < 1e-6 * abs(bars[0])


def truss(load: float, stiffness: float):
    """Von Mises truss: two bars of span 2 m and rise 0.2 m under a load on their apex."""
    length = np.hypot(1, 0.2)
    return make_structure(
        [[-1, 0, 0], [0, 0, 0.2], [1, 0, 0]],
        [bar(0, 1, length, stiffness), bar(1, 2, length, stiffness)],
        anchored={0: "xz", 2: "xz"}, axes="xz", load={1: (0, 0, -load)},
    )  # fmt: skip


def truss_load(height, stiffness):
    """Vertical load that holds the apex at a height: 2 k (l0 - l) h / l."""
    length = np.hypot(1, height)
    return 2 * stiffness * (np.hypot(1, 0.2) - length) * height / length


@pytest.mark.parametrize("stiffness", [1e3, 1e6])
def test_truss_snaps_through_past_its_limit_load_only(stiffness: float) -> None:
    limit = truss_load(np.linspace(0, 0.2, 200001), stiffness).max()
    for load, side in ((0.5 * limit, 1), (0.98 * limit, 1), (1.02 * limit, -1), (2 * limit, -1)):
        found = settle(truss(load, stiffness))
        height = found.coordinate[1]
        assert np.sign(height) == side
        assert truss_load(height, stiffness) == pytest.approx(load, rel=1e-6)
        assert found.smallest_eigenvalue > 0


@pytest.mark.parametrize("ratio", [1e6, 1e9])
def test_loaded_prism_on_anchors_with_nearly_rigid_bars(ratio: float) -> None:
    """Bars keep their length, forces balance by the reference, as exactly as rounding permits."""
    structure = prism(
        130.0, bar_stiffness=100 * ratio, anchored={0: "xyz", 1: "xyz", 2: "xyz"}, gravity=DOWN,
        load={5: (0.0, 0.0, -5.0)},
    )  # fmt: skip
    found = settle(structure, method="newton")
    rest = structure.rest_length[::4]
    stretch = found.member_tension[::4] / (100 * ratio)
    np.testing.assert_allclose(found.member_length[::4] - rest, stretch, atol=1e-15)
    assert found.is_found
    last_digit = np.finfo(float).eps * 100 * ratio  # force of one rounding error of a bar's end
    assert found.residual <= max(1e-9 * found.largest_force, last_digit)
    assert found.status == "converged"
    assert found.iterations < 20


def icosahedron(seed: int, stiffness: float):
    """Six bars and 24 cables of uneven prestress, nothing anchored."""
    place = np.zeros((12, 3))
    for row, (axis, short, long) in enumerate(
        (k, a, b) for k in range(3) for a in (-0.5, 0.5) for b in (-1, 1)
    ):
        place[row, (axis + 1) % 3], place[row, (axis + 2) % 3] = short, long
    rng, members = np.random.default_rng(seed), []
    for i in range(12):
        for j in range(i):
            gap = float(np.linalg.norm(place[i] - place[j]))
            if abs(gap - 2) < 1e-9:
                members.append(bar(i, j, gap, stiffness))
            elif gap < 1.3:
                members.append(cable(i, j, gap * rng.uniform(0.5, 0.95), 500.0))
    return make_structure(place, members)


@pytest.mark.thorough
def test_free_icosahedron_balances_its_uneven_prestress() -> None:
    structure = icosahedron(1, 1e5)
    found = settle(structure)
    assert found.status == "converged"
    assert found.neutral_motions == 6
    assert found.smallest_eigenvalue > 1
    np.testing.assert_allclose(
        found.node_position.mean(axis=0), structure.node_position.mean(axis=0), atol=1e-9
    )


def net(n: int, rest: float = 1.02, weight: float = -1.0):
    """Square net of n x n nodes, 1 m apart, held at its rim; slack at the start if rest > 1."""
    place = [[i, j, 0] for i in range(n) for j in range(n)]
    members = [cable(i * n + j, (i + 1) * n + j, rest, 1000.0) for i in range(n - 1) for j in range(n)]
    members += [cable(i * n + j, i * n + j + 1, rest, 1000.0) for i in range(n) for j in range(n - 1)]
    rim = {k: "xyz" for k, (i, j, _) in enumerate(place) if {i, j} & {0, n - 1}}
    return make_structure(place, members, anchored=rim, gravity=(0.0, 0.0, weight))


@pytest.mark.parametrize("n", [5, *thorough(11, 33)])
def test_slack_net_falls_into_its_ropes(n: int) -> None:
    """Weight in equals reactions out; with n = 33 the net has 2,883 coordinates and is solved sparsely."""
    structure = net(n)
    found = settle(structure, method="newton")
    reaction = ReferenceModel(structure).compute("support_reaction", coordinate=found.coordinate)
    assert found.status == "converged"
    assert found.iterations < 60
    assert reaction.reshape(-1, 3)[:, 2].sum() == pytest.approx((n**2) * 1.0)
    assert found.coordinate.reshape(-1, 3)[:, 2].max() < 0
    assert found.smallest_eigenvalue > 0


def test_slack_net_without_weight_stays_and_is_neutral() -> None:
    found = settle(net(6, weight=0.0))
    assert (found.status, found.iterations, found.displacement) == ("converged", 0, 0.0)
    assert found.smallest_eigenvalue == 0.0
    assert "neutral" in found.message


@pytest.mark.parametrize("structure", [net(3), *thorough(net(6), prism(140.0))])
def test_relaxation_finds_what_newton_finds(structure) -> None:
    newton = settle(structure, method="newton")
    relaxed = settle(structure, method="relaxation")
    assert relaxed.status == "converged"
    assert relaxed.method == "relaxation"
    assert relaxed.energy == pytest.approx(newton.energy, rel=1e-9)
    np.testing.assert_allclose(relaxed.member_length, newton.member_length, rtol=1e-6)


def test_free_fall_has_no_equilibrium() -> None:
    found = settle(prism(gravity=DOWN), raise_on_failure=False)
    assert found.status == "no_equilibrium"
    assert "along z" in found.message
    assert f"{-6 * 9.81:.6g}" in found.message
    with pytest.raises(ConvergenceError, match="anchor some nodes") as caught:
        settle(prism(gravity=DOWN))
    assert caught.value.evidence["status"] == "no_equilibrium"


def test_a_load_that_slides_along_a_partly_anchored_axis_has_no_equilibrium() -> None:
    members = [spring(0, 1, 1.0)]
    free_x = make_structure(
        [[0, 0, 0], [0, 0, -1]], members, anchored={0: "yz", 1: "yz"}, load={1: (2.0, 0, 0)}
    )
    assert settle(free_x, raise_on_failure=False).status == "no_equilibrium"


def test_planar_square_has_three_neutral_motions() -> None:
    place = [[0, 5, 0], [1, 5, 0], [1, 5, 1], [0, 5, 1]]
    members = [cable(k, (k + 1) % 4, 0.9) for k in range(4)] + [bar(0, 2, 2**0.5), bar(1, 3, 2**0.5)]
    found = settle(make_structure(place, members, axes="xz"))
    assert found.neutral_motions == 3
    assert found.smallest_eigenvalue > 0
    assert np.all(found.node_position[:, 1] == 5)


def test_inputs_parameters_and_anchors_change_the_answer() -> None:
    lift = ActuatedInput("lift", "force", (1,), (0.0, 0.0, 1.0))
    pull = ActuatedInput("pull", "rest_length", (0,))
    structure = pendulum(gravity=DOWN, inputs=(lift, pull))
    anchors = np.array([[0, 0, 3.0], [0, 0, -1.0]])
    found = settle(structure, arguments={"input": [4.81, -0.2], "anchor_position": anchors})
    np.testing.assert_allclose(found.node_position, [[0, 0, 3], [0, 0, 3 - 0.8 - 0.05]], atol=1e-8)


def test_progress_is_reported() -> None:
    seen: list[tuple[int, float]] = []
    settle(net(5), progress=lambda iteration, residual: seen.append((iteration, residual)))
    assert [iteration for iteration, _ in seen] == list(range(len(seen)))
    assert seen[-1][1] < seen[0][1]


def test_start_without_finite_forces_is_named() -> None:
    structure = prism()
    start = structure.node_position.copy()
    start[3] = start[0]
    with np.errstate(invalid="ignore"):
        found = settle(structure, coordinate=start.ravel(), raise_on_failure=False)
    assert found.status == "not_finite"
    assert "'e0'" in found.message


def test_iteration_limit_is_told_with_its_evidence() -> None:
    with pytest.raises(ConvergenceError) as caught:
        settle(net(5), method="newton", max_iterations=2)
    assert caught.value.evidence["status"] == "iteration_limit"
    assert caught.value.evidence["iterations"] == 2


def test_a_search_that_nobody_waits_for_ends_with_its_evidence(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = settle(net(5))
    monkeypatch.setattr(newton, "MAX_WORK", 2 * len(whole.coordinate))
    with pytest.raises(ConvergenceError, match=r"factorisations with \d+ coordinates") as caught:
        settle(net(5))
    assert caught.value.evidence["status"] == "work_limit"
    assert 0 < caught.value.evidence["iterations"] < whole.iterations
    assert "relaxation" in caught.value.hint


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"method": "newtn"}, UnknownNameError),
        ({"tolerance": 0.0}, InvalidValueError),
        ({"tolerance": float("nan")}, InvalidValueError),
        ({"max_iterations": 0}, InvalidValueError),
        ({"coordinate": [0.0, 1.0]}, InvalidValueError),
        ({"coordinate": [0.0, 1.0, float("nan")]}, NonFiniteError),
        ({"arguments": {"velocity": [0, 0, 0]}}, InvalidValueError),
    ],
)
def test_bad_options_are_refused(options, error) -> None:
    with pytest.raises(error):
        settle(pendulum(), **options)


def test_a_model_without_the_functions_is_refused() -> None:
    class Poor(ReferenceModel):
        def has(self, quantity):
            return quantity != "tangent_stiffness"

    with pytest.raises(FormulationError, match="tangent_stiffness"):
        find_equilibrium(Poor(pendulum()))


def test_start_is_not_modified() -> None:
    start = np.array([1.0, 0, 0])
    settle(pendulum(gravity=DOWN), coordinate=start)
    assert start.tolist() == [1.0, 0, 0]


@pytest.mark.parametrize("bar_stiffness", [1e6, *thorough(1e8)])
def test_far_from_the_origin_an_equilibrium_is_found_up_to_its_rounding(bar_stiffness: float) -> None:
    """At 1,300 m positions are rounded to 1e-13 m, and forces of bars to that times their stiffness."""
    near = prism(bar_stiffness=bar_stiffness)
    far = near.with_changes(node_position=near.node_position + np.array([1000.0, -700.0, 400.0]))
    found, moved = settle(near), settle(far)
    assert moved.status in ("converged", "rounding_limited")
    assert moved.residual < 4e-12 * 2 * bar_stiffness
    np.testing.assert_allclose(moved.member_tension, found.member_tension, rtol=0, atol=1e-12 * bar_stiffness)
