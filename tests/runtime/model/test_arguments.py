"""Values of run-time parameters that no scene has are refused for motions and equilibria."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.runtime.model.arguments import check_parameter_values
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.static_problem import EQUILIBRIUM_QUANTITIES
from tensegrity_codegen.runtime.trajectory.simulation_quantities import SIMULATION_QUANTITIES
from tensegrity_codegen.structure.ground import CHANGEABLE
from tensegrity_codegen.system.errors import InvalidValueError
from tests.ground_cases import make_slope
from tests.models import load
from tests.runtime.build import make_structure, spring

PARAMETERS = {"rest_length": (0,), "spring_constant": (0,), "damping": (0,), "node_mass": (1,)}


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    structure = make_structure([[0, 0, 0], [1, 0, 0]], [spring(0, 1, 1.0)], anchored={0: "xyz", 1: "yz"})
    quantities = tuple(dict.fromkeys((*SIMULATION_QUANTITIES, *EQUILIBRIUM_QUANTITIES)))
    return load(structure, *quantities, integrators=("rk853",), parameters=PARAMETERS)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("rest_length", -1.0),
        ("rest_length", 0.0),
        ("spring_constant", 0.0),
        ("damping", -0.1),
        ("node_mass", -2),
    ],
)
def test_no_motion_and_no_equilibrium_has_them(model: CompiledModel, name: str, value: float) -> None:
    arguments = {name: [value]}
    with pytest.raises(InvalidValueError, match=rf"arguments\.{name}"):
        simulate(model, t_end=0.1, arguments=arguments)
    with pytest.raises(InvalidValueError, match=rf"arguments\.{name}"):
        find_equilibrium(model, arguments=arguments)


@pytest.mark.parametrize("arguments", [{"damping": [0.0]}, {"rest_length": [0.9]}, {"rest_length": "a"}, {}])
def test_other_values_pass(model: CompiledModel, arguments: dict[str, Any]) -> None:
    check_parameter_values(model.manifest, arguments)


def test_one_row_of_many_is_named(model: CompiledModel) -> None:
    rows = np.array([[1.0], [0.5], [-0.5]])
    with pytest.raises(InvalidValueError) as caught:
        check_parameter_values(model.manifest, {"rest_length": rows})
    assert caught.value.given == -0.5


def test_friction_and_dissipation_of_the_ground_may_be_zero_and_its_stiffness_not() -> None:
    names = ("stiffness", "dissipation", "friction")
    over = tuple(CHANGEABLE.index(name) for name in names)
    grounded = load(make_slope(0.2)[0], "contact_force", parameters={"ground": over})
    values = dict(zip(names, grounded.nominal("ground"), strict=True))
    for name in names[1:]:
        check_parameter_values(grounded.manifest, {"ground": list((values | {name: 0.0}).values())})
        with pytest.raises(InvalidValueError) as caught:
            check_parameter_values(grounded.manifest, {"ground": list((values | {name: -1.0}).values())})
        assert (caught.value.where, caught.value.allowed) == (f"arguments.ground: {name}", "0 or more")
    with pytest.raises(InvalidValueError, match="above 0"):
        check_parameter_values(grounded.manifest, {"ground": list((values | {"stiffness": 0.0}).values())})
