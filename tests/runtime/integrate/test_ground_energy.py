"""Where the energy of motions on the ground goes: work of friction, impacts, damping and belts.

Normal force: Hunt and Crossley, Journal of Applied Mechanics 42 (1975) 440; friction: a bristle in series
with a Coulomb slider, see docs/ground.md. The work is integrated with the motion, so that the change of the
total energy, of which nothing else knows, checks both.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.structure.structure import Structure
from tests.cases import thorough
from tests.ground_cases import (
    GRAVITY,
    METHODS,
    make_belt,
    make_block,
    make_icosahedron,
    make_prism,
    make_slope,
    move,
)
from tests.models import load
from tests.runtime.integrate.test_ground import rotate


def balanced(structure: Structure) -> Structure:
    assert structure.ground is not None
    return structure.with_changes(ground=replace(structure.ground, balances_energy=True))


def make_slide() -> Structure:
    rest = [0.0, 0.0, -GRAVITY / 1e5]
    return make_block(rest, load=(0.5, 0.0, 0.0), friction=0.3, stick_damping=200.0)


CASES: dict[str, tuple[Structure, list[float], dict[str, Any]]] = {
    "bounce": (make_block([0.0, 0.0, 0.5], dissipation=0.311252583112), [0.0, 0.9, 2.0], {}),
    "slope": (make_slope(np.radians(30.0))[0], [0.0, 1.0, 2.0], {}),
    "curve": (make_slide(), [0.0, 1.5, 3.0], {"velocity": [1.0, 2.0, 0.0]}),
    "belt": (make_belt(0.2), [0.0, 1.0, 2.0], {}),
    "static friction": (make_belt(0.2, static_friction=0.6), [0.0, 1.0, 2.0], {}),
    "prism": (make_prism(rotate((0.0, 0.3, 0.2))), [0.0, 0.3, 0.6], {}),
    "no friction": (make_icosahedron(), [0.0, 0.1, 0.2], {}),
}


@pytest.mark.parametrize("method", [METHODS[0], *thorough(*METHODS[1:])])
@pytest.mark.parametrize("name", CASES)
def test_energy_changes_by_the_work_that_is_told(name: str, method: str) -> None:
    structure, times, more = CASES[name]
    _, motion = move(balanced(structure), method, times, integrators=(method,), **more)
    assert motion.status == "ok"
    assert motion.energy_drift is not None
    assert motion.energy_drift < (1e-8 if name == "static friction" else 1e-9)
    assert motion.internal is not None
    first = motion.internal_name.index("friction_work")
    work = motion.internal[:, first : first + 4]
    scale = max(np.abs(motion.total_energy).max(), motion.kinetic_energy.max())
    change = motion.total_energy - motion.total_energy[0]
    np.testing.assert_allclose(change, work.sum(axis=1), atol=1e-9 * scale)
    assert (np.diff(work[:, :3], axis=0) <= 1e-12 * scale).all()
    assert (motion.work["belt_work"] != 0.0) == ("belt" in name or name == "static friction")
    assert (motion.work["friction_work"] < 0.0) == (name not in ("bounce", "no friction"))


def test_the_work_of_a_curved_slide_is_that_of_its_friction() -> None:
    slide, one = balanced(make_slide()), ("rk853",)
    _, motion = move(slide, "rk853", [0.0, 3.0], integrators=one, velocity=[1.0, 2.0, 0.0])
    assert motion.work["friction_work"] == pytest.approx(-2.74016843744, rel=1e-10)
    assert motion.summary()["friction_work"] == motion.work["friction_work"]


def test_work_that_is_told_changes_no_motion() -> None:
    prism = make_prism(rotate((0.0, 0.3, 0.2)))
    (_, told), (_, untold) = (
        move(item, "rk853", [0.0, 0.3, 0.6], integrators=("rk853",)) for item in (balanced(prism), prism)
    )
    assert np.abs(told.node_position - untold.node_position).max() < 1e-12
    assert untold.work == {}
    assert untold.energy_drift is None


def test_powers_are_losses_and_belong_to_the_energy_rate() -> None:
    belt = make_belt(0.2, dissipation=0.7)
    model = load(belt, "friction_power", "impact_power", "energy_rate", "contact_force")
    rng = np.random.default_rng(4)
    for _ in range(50):
        state = {
            "coordinate": np.array([rng.normal()]),
            "velocity": rng.normal(size=1),
            "internal": 1e-4 * rng.normal(size=2),
        }
        friction, impact, rate = (
            float(model.compute(name, **state)) for name in ("friction_power", "impact_power", "energy_rate")
        )
        force = float(model.compute("contact_force", **state)[0, 0])  # on the block
        assert friction <= 1e-15
        assert impact <= 0.0
        assert rate == pytest.approx(friction + impact + 0.2 * force, abs=1e-12)
