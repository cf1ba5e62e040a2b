"""Motions with rigid bars: stiff bars in the limit, and the first-order correction."""

import numpy as np
import pytest

from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import InvalidValueError
from tests.common_prism import common_prism
from tests.models import simulator
from tests.runtime.build import bar, cable, make_structure, prism
from tests.scene.samples import build


def twisted_prism(ratio: float) -> Structure:
    """A prism with point masses whose bars are `ratio` times as stiff as its cables."""
    velocity = 0.1 * np.random.default_rng(1).standard_normal((6, 3))
    return prism(150.0, bar_stiffness=100.0 * ratio, strain=0.2).with_changes(node_velocity=velocity)


def compile_rigid(structure: Structure, **options: str) -> CompiledModel:
    more = ("consistent_coordinate", "consistent_velocity")
    return simulator(structure, "rk54", more=more, formulation="rigid_bar", options=options)


def errors_of(ratio: float) -> tuple[float, float, float]:
    """Return errors [m] of rigid and corrected bars against springs, 0.5 s, and the corrected estimate."""
    structure = twisted_prism(ratio)
    plain, corrected = (
        compile_rigid(structure, bars="all", correction=word) for word in ("none", "first_order")
    )
    springs = simulator(structure, "rk54")
    options = {"samples": 6, "method": "rk54", "rtol": 1e-11, "stepping": Stepping(atol=1e-13)}
    first = simulate(corrected, 0.5, **options)
    # Springs start on the slow motion, so that no bar vibrates.
    start = {"coordinate": first.coordinate[0], "velocity": first.velocity[0]}
    exact = simulate(springs, 0.5, **options, **start).coordinate
    rigid = simulate(plain, 0.5, **options, **start)
    estimate = corrected.compute("rigidity_error", **start).max()
    return (
        float(np.abs(rigid.coordinate - exact).max()),
        float(np.abs(first.coordinate - exact).max()),
        float(estimate),
    )


@pytest.mark.thorough
def test_rigid_bars_are_off_by_one_over_the_ratio_and_corrected_ones_by_its_square() -> None:
    (rigid_2, first_2, estimate_2), (rigid_3, first_3, estimate_3) = errors_of(1e2), errors_of(1e3)
    assert rigid_2 / rigid_3 == pytest.approx(10.0, rel=0.2)
    assert first_2 / first_3 == pytest.approx(100.0, rel=0.4)
    assert first_3 < 2e-6
    for estimate, error in ((estimate_2, first_2), (estimate_3, first_3)):
        assert 0.1 < estimate / error < 10.0


def test_an_initial_motion_that_stretches_a_rigid_bar_is_refused() -> None:
    model = compile_rigid(common_prism())
    velocity = model.nominal("velocity")
    velocity[0] = 0.3
    with pytest.raises(InvalidValueError, match="changes the length of a rigid bar"):
        simulate(model, 1.0, velocity=velocity)


@pytest.mark.thorough
def test_chains_of_rigid_bars_swing_as_stiff_ones_do() -> None:
    position = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 0, -1]]

    def chain(mu: float) -> Structure:
        members = [bar(0, 1, 1.0, mu), bar(1, 2, 1.0, mu, mass=0.5), cable(2, 3, 0.9)]
        return make_structure(position, members, anchored={0: "xyz", 3: "xyz"}, gravity=(0, 0, -9.81))

    rigid = simulate(compile_rigid(chain(0.0)), 1.0, samples=11, rtol=1e-9, stepping=Stepping(atol=1e-10))
    stiff = simulate(
        simulator(chain(1e6), "rk54"),
        1.0,
        samples=11,
        method="rk54",
        rtol=1e-8,
        stepping=Stepping(atol=1e-10),
    )
    assert np.abs(rigid.node_position - stiff.node_position).max() < 1e-3
    assert rigid.energy_drift is not None
    assert rigid.energy_drift < 1e-6


@pytest.mark.parametrize("damping", [1.0, 8.0])
def test_damped_cables_become_taut_where_lengths_of_bars_follow_their_tensions(damping: float) -> None:
    """The force that a cable has as it is pulled taut moves its end back by 6e-8 m, where it is slack."""
    rope = {"kind": "cable", "spring_constant": 300.0, "rest_length": 0.55, "damping": damping}
    nodes = {
        "a": {"position": [-0.6, 0.0, 1.0], "anchored": True},
        "b": {"position": [0.6, 0.0, 1.0], "anchored": True},
        "p": {"position": [-0.3, 0.05, 0.5], "mass": 0.1},
        "q": {"position": [0.3, 0.05, 0.5], "mass": 0.2},
    }
    members = {
        "rod": {"kind": "bar", "nodes": ["p", "q"], "spring_constant": 1e6, "mass": 0.3},
        "s": {**rope, "nodes": ["a", "p"]},
        "u": {**rope, "nodes": ["b", "q"]},
    }
    scene = {"name": "hang", "gravity": [0.0, 0.0, -9.81], "nodes": nodes, "members": members}
    options = {"bars": "all", "correction": "first_order"}
    methods = ("rk853", "rk54", "rodas")
    model = simulator(build(scene)[0], *methods, "rk4", formulation="rigid_bar", options=options)
    exact = simulate(model, 1.0, samples=101, method="rk4", stepping=Stepping(step=2e-4))
    assert exact.status == "ok"
    for method in methods:
        for rtol in (1e-4, 1e-6, 1e-7):
            found = simulate(model, 1.0, samples=101, method=method, rtol=rtol)
            assert (found.status, found.log.count) == ("ok", exact.log.count), (method, rtol)
            np.testing.assert_allclose(found.node_position, exact.node_position, rtol=0, atol=max(rtol, 1e-6))
        once = simulate(model, 1.0, method=method, rtol=1e-10, stepping=Stepping(control="steps"))
        assert (once.status, once.log.count) == ("ok", exact.log.count)  # each turn once, at any tolerance
    if damping == 1.0:
        assert exact.log.count == 10
        assert exact.position("p")[-1] == pytest.approx([-0.290389, -0.007388, 0.526661], abs=1e-6)
