"""The functions of a scene as CasADi functions: names, shapes, values, errors."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from tensegrity_codegen import SymbolicFunctions, compile_scene, symbolic_functions
from tensegrity_codegen.system.errors import FormulationError, SceneError, UnknownNameError
from tests.cases import thorough
from tests.comparison import dense

EXAMPLES = Path(__file__).resolve().parent.parent.parent / "tensegrity_codegen" / "scene" / "examples"


@pytest.mark.parametrize("scene", ["two_nodes", "lin_prism", *thorough("prism", "planar")])
def test_values_are_those_of_the_library(scene: str) -> None:
    path = EXAMPLES / f"{scene}.toml"
    functions, model = symbolic_functions(path), compile_scene(path)
    assert isinstance(functions, SymbolicFunctions)
    order = [spec.quantity for spec in model.manifest.functions]
    assert set(functions) <= set(order)
    for name, function in functions.items():
        values = [functions.nominal[argument] for argument in function.name_in()]
        expected = dense(model.compute(name))
        found = np.array(ca.densify(function(*values)))
        is_matrix = model.manifest.functions[order.index(name)].pattern is not None
        found = found if is_matrix else found.T.reshape(expected.shape)
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-9, err_msg=name)
    assert functions.coordinate_name == model.manifest.coordinate_name


def test_inputs_and_parameters_are_arguments() -> None:
    functions = symbolic_functions(
        EXAMPLES / "prism12.toml", quantities=("node_residual",), parameters={"node_load": (0, 1)}
    )
    assert functions["node_residual"].name_in() == ["coordinate", "input", "node_load"]
    assert functions.nominal["node_load"].shape == (3, 2)
    assert functions.nominal["input"].shape == (len(functions.input_name), 1)
    actuated = symbolic_functions(EXAMPLES / "prism.toml", actuate="cables")
    assert actuated["member_tension"].name_in() == ["coordinate", "input"]
    assert len(actuated.input_name) == 9


def test_nominal_values_cannot_be_changed() -> None:
    functions = symbolic_functions(EXAMPLES / "two_nodes.toml")
    with pytest.raises(ValueError, match="read-only"):
        functions.nominal["coordinate"][0] = 1.0


def test_they_can_be_differentiated_and_used_in_a_program() -> None:
    functions = symbolic_functions(EXAMPLES / "two_nodes.toml", quantities=("potential_energy",))
    q = ca.MX.sym("q", 3)
    energy = functions["potential_energy"](q)
    problem = {"x": q, "f": energy}
    quiet = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
    found = ca.nlpsol("solver", "ipopt", problem, quiet)(x0=functions.nominal["coordinate"] - 0.1)
    force = ca.Function("force", [q], [ca.gradient(energy, q)])(found["x"])
    assert np.abs(np.array(force)).max() <= 1e-6


def test_errors_are_those_of_scenes_and_quantities(tmp_path: Path) -> None:
    with pytest.raises(SceneError):
        symbolic_functions(tmp_path / "absent.toml")
    with pytest.raises(UnknownNameError):
        symbolic_functions(EXAMPLES / "prism.toml", quantities=("tensions",))
    with pytest.raises(FormulationError):
        symbolic_functions(EXAMPLES / "prism.toml", quantities=("chart_margin",))
