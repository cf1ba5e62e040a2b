"""What does not know the ground says so, in one error, before any number is computed."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.analyses import find_needs
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.structure.ground_support import WITHOUT_GROUND, require_no_ground
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.quantities import QUANTITIES
from tensegrity_codegen.tables.request import ModelRequest
from tests.ground_cases import make_block, make_ground
from tests.models import load, simulator

REFUSAL = "the ground is not supported here"
BLOCK = make_block([0.0, 0.0, 0.1])


@pytest.mark.parametrize(
    "request_",
    [
        {"formulation": "node_distance"},
        {"solvers": ("equilibrium",)},
        {"integrators": ("rk54",), "keep": ("energy",)},
    ],
)
def test_other_ways_are_refused(request_: dict[str, Any]) -> None:
    with pytest.raises(FormulationError, match=REFUSAL):
        load(BLOCK, "acceleration", **request_)


@pytest.mark.parametrize("quantity", WITHOUT_GROUND)
def test_quantities_without_the_ground_are_refused(quantity: str) -> None:
    assert quantity in QUANTITIES
    with pytest.raises(FormulationError, match=REFUSAL):
        load(BLOCK, quantity)


@pytest.mark.parametrize(
    "analysis",
    [
        *("plan", "time_motion"),
    ],
)
def test_other_analyses_are_refused(analysis: str) -> None:
    request = ModelRequest(("member_tension",), emitter="auto")
    with pytest.raises(FormulationError, match=REFUSAL):
        build_library(BLOCK, find_needs(analysis, BLOCK, request).alone(request))


def test_static_friction_and_too_many_contacts_are_refused() -> None:
    sticky = make_block([0.0, 0.0, 0.1], static_friction=0.6)
    for wanted in (
        {"emitter": "table"},
        {"batch_width": 8},
        {"integrators": ("rk54",), "events": ("cable",)},
    ):
        with pytest.raises(FormulationError, match="static_friction"):
            load(sticky, "acceleration", **wanted)
    crowd = _many_nodes(201)
    with pytest.raises(FormulationError, match="events of 201 contacts"):
        load(crowd, "acceleration", integrators=("rk54",), events=("ground",))


def test_scipy_methods_and_conditions_on_friction_are_refused() -> None:
    model = simulator(BLOCK, "rk54", more=("contact_force", "penetration"))
    with pytest.raises(FormulationError, match="scipy_dop853"):
        simulate(model, 0.1, method="scipy_dop853")
    with pytest.raises(FormulationError, match="contact_force"):
        simulate(model, 0.1, method="rk54", until="contact_force[0, 2] > 1")
    motion = simulate(model, 1.0, method="rk54", until="penetration[0] > 0")
    assert motion.time[-1] == pytest.approx(np.sqrt(2 * 0.1 / 9.81), rel=1e-6)


def test_structures_without_ground_are_not_refused() -> None:
    require_no_ground(BLOCK.with_changes(ground=None), "anything")


def test_auto_takes_an_explicit_method_whatever_the_stiffness() -> None:
    stiff = BLOCK.with_changes(spring_constant=np.array([1e12]), tension_only=np.array([False]))
    request = ModelRequest((), emitter="auto")
    assert find_needs("simulate", stiff, request).integrators in (("rk54",), ("rk853",))
    model = build_library(BLOCK, find_needs("simulate", BLOCK, request).alone(request)).load()
    assert simulate(model, 0.2, samples=3).status == "ok"


def _many_nodes(count: int) -> Structure:
    from tests.runtime.build import make_structure

    place = np.stack([np.arange(count), np.zeros(count), np.ones(count)], axis=1)
    return make_structure(place, []).with_changes(ground=make_ground(count))
