"""Arguments of a wrong type are errors for users, in every function that takes a model."""

import inspect

import numpy as np
import pytest

import tensegrity_codegen as package
from tensegrity_codegen import Stepping, compile_scene, find_equilibrium, simulate, simulate_batch
from tensegrity_codegen.system.errors import InvalidValueError, TensegrityError, UnknownNameError
from tests.scene.samples import ARCH

TAKES_A_MODEL = [
    name
    for name in package.__all__
    if inspect.isfunction(getattr(package, name))
    and next(iter(inspect.signature(getattr(package, name)).parameters), "") == "model"
]


@pytest.fixture(scope="module")
def arch():
    return compile_scene(ARCH, for_="equilibrium")


def test_most_public_functions_take_a_model():
    assert {"analyse", "find_equilibrium", "linearize", "plan", "simulate"} <= set(TAKES_A_MODEL)


@pytest.mark.parametrize("name", TAKES_A_MODEL)
@pytest.mark.parametrize("given", ["prism.toml", None, 3], ids=repr)
def test_what_is_no_model_is_refused_with_the_way_to_one(name, given):
    function = getattr(package, name)
    needed = [
        parameter
        for parameter in inspect.signature(function).parameters.values()
        if parameter.default is parameter.empty and parameter.kind is not parameter.VAR_KEYWORD
    ]
    with pytest.raises(InvalidValueError, match="model: not a compiled model") as caught:
        function(given, **{parameter.name: None for parameter in needed[1:]})
    assert "compile_scene" in str(caught.value)


@pytest.mark.parametrize(
    ("function", "options"),
    [
        (simulate, {"t_end": 1.0, "samples": [0, 1, 2]}),
        (simulate, {"t_end": 1.0, "samples": np.linspace(0.1, 1.0, 3)}),
        (simulate, {"t_end": 1.0, "samples": [0.0, 0.5, 0.5, 1.0]}),
        (simulate, {"t_end": 1.0, "samples": "12"}),
        (simulate, {"t_end": 1.0, "samples": [[0.0, 1.0]]}),
        (simulate, {"t_end": 1.0, "samples": 5.0}),
        (simulate, {"t_end": 1.0, "stepping": "many"}),
        (simulate, {"t_end": "long"}),
        (simulate_batch, {"t_end": 1.0, "samples": "5"}),
        (find_equilibrium, {"tolerance": "small"}),
        (find_equilibrium, {"max_iterations": 2.5}),
        (find_equilibrium, {"arguments": [1.0]}),
        (find_equilibrium, {"coordinate": "here"}),
    ],
)
def test_values_of_a_wrong_type_are_named(arch, function, options):
    with pytest.raises((InvalidValueError, UnknownNameError)) as caught:
        function(arch, **options)
    assert list(options)[-1] in str(caught.value)


@pytest.mark.parametrize("options", [{"max_steps": "many"}, {"keep": 3}, {"control": 1.0}])
def test_values_of_a_wrong_type_in_an_object_are_named(arch, options):
    with pytest.raises(InvalidValueError) as caught:
        simulate(arch, 1.0, stepping=Stepping(**options))
    assert next(iter(options)) in str(caught.value)


def test_a_quantity_that_is_no_text_is_an_unknown_name(arch):
    with pytest.raises(TensegrityError):
        arch.compute(3)
