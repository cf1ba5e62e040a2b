"""Analysis `evaluate`: every row is what the single-case function returns."""

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.analyses.evaluate import Evaluate
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError
from tests.analyses.cases.compiling import check_alike, compile_for, vary
from tests.analyses.cases.scenes import BODIES, PRISM, SINGLE, TRIANGLE
from tests.cases import thorough
from tests.sweeps.status_words import decode_statuses

KEPT = ("member_tension", "node_residual", "tangent_stiffness", "total_energy")
COUNT = 11


@pytest.mark.parametrize(
    "scene", [TRIANGLE, BODIES, SINGLE, *thorough(PRISM)], ids=lambda scene: str(scene["name"])
)
def test_rows_are_those_of_single_calls(scene: dict[str, Any]) -> None:
    operation = Evaluate(() if "bodies" in scene else KEPT)
    model = compile_for(scene, operation)
    given = vary(model, COUNT, 1)
    result = operation.run(model, given, COUNT)
    assert decode_statuses(result.status) == ("ok",) * COUNT
    check_alike(result, operation, model, COUNT)
    for output in operation.outputs(model.manifest):
        array = result.arrays[output.name]
        for k in range(COUNT):
            alone = model.compute(output.name, **{name: value[k] for name, value in given.items()})
            dense = alone.toarray() if hasattr(alone, "toarray") else alone
            np.testing.assert_allclose(array[k], dense, rtol=0, atol=0)


def test_values_shared_by_all_cases_and_inputs_by_name() -> None:
    operation = Evaluate(("member_tension",))
    model = compile_for(TRIANGLE, operation)
    pull = np.linspace(-0.01, 0.01, COUNT)
    coordinate = model.nominal("coordinate") * 1.01
    result = operation.run(model, {"pull": pull, "coordinate": coordinate}, COUNT)
    for k in range(COUNT):
        alone = model.compute("member_tension", pull=pull[k], coordinate=coordinate)
        np.testing.assert_array_equal(result.arrays["member_tension"][k], alone)
    same = operation.run(model, {"coordinate": coordinate}, COUNT)
    assert len(np.unique(same.arrays["member_tension"], axis=0)) == 1


def test_a_case_that_fails_leaves_the_others_alone() -> None:
    operation = Evaluate(("member_tension", "node_residual"))
    model = compile_for(TRIANGLE, operation)
    given = vary(model, COUNT, 2)
    wanted = operation.run(model, given, COUNT)
    given["rest_length"][3, 0] = np.nan
    given["coordinate"][5] = 1e200  # whose square overflows
    result = operation.run(model, given, COUNT)
    words = decode_statuses(result.status)
    assert words[3] == "non_finite_input"
    assert "rest_length" in result.messages[3]
    assert words[5] == "non_finite_result"
    assert [k for k, word in enumerate(words) if word != "ok"] == [3, 5]
    for name, array in result.arrays.items():
        assert np.isnan(array[[3, 5]]).all()
        others = np.delete(np.arange(COUNT), [3, 5])
        np.testing.assert_array_equal(array[others], wanted.arrays[name][others])


def test_labels_name_the_entries() -> None:
    operation = Evaluate(KEPT)
    model = compile_for(PRISM, operation)
    tension, residual, stiffness, energy = operation.outputs(model.manifest)
    assert tension.dims == ("member",)
    assert tension.coordinates["member"] == model.manifest.member_name
    assert residual.dims == ("coordinate",)
    assert stiffness.dims == ("coordinate", "coordinate_column")
    assert (energy.dims, energy.shape, energy.unit) == ((), (), "J")


@pytest.mark.parametrize(
    ("given", "error"),
    [
        ({"mass": np.ones(COUNT)}, UnknownNameError),
        ({"coordinate": np.ones((COUNT, 1))}, InvalidValueError),
        ({"rest_length": np.ones((COUNT - 1, 1))}, InvalidValueError),
        ({"pull": np.zeros(COUNT), "input": np.zeros((COUNT, 1))}, InvalidValueError),
        ({"pull": np.zeros(COUNT + 1)}, InvalidValueError),
    ],
)
def test_arguments_that_no_case_can_have_are_refused(given: dict[str, Any], error: type[Exception]) -> None:
    operation = Evaluate(("member_tension",))
    with pytest.raises(error):
        operation.run(compile_for(TRIANGLE, operation), given, COUNT)


def test_what_cannot_be_kept_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="member_tension"):
        Evaluate(("member_tensio",)).needs(*load_scene(TRIANGLE))
    structure, request = load_scene(PRISM)
    with pytest.raises(InvalidValueError, match="nothing to evaluate"):
        Evaluate().needs(structure, replace(request, quantities=()))


def test_operations_are_sent_to_other_processes() -> None:
    operation = Evaluate(KEPT)
    assert pickle.loads(pickle.dumps(operation)) == operation
    assert operation.describe() == {"do": "evaluate", "keep": list(KEPT)}


def test_expressions_are_those_of_single_states() -> None:
    texts = ("spread = max(member_tension) - min(member_tension)", "m.x + 2 * m.z", "abs(member_tension)")
    texts += ("node_position[m]", "max(member_length[left], member_length[top], 0.9)", "node_position")
    operation = Evaluate(texts)
    model = compile_for(TRIANGLE, operation)
    given = vary(model, COUNT, 3)
    result = operation.run(model, given, COUNT)
    check_alike(result, operation, model, COUNT)
    names = [output.name for output in operation.outputs(model.manifest)]
    assert names == [
        *("spread", "m_x_2_m_z", "abs_member_tension", "node_position_m"),
        *("max_member_length_left_member_length_top_0_9", "node_position"),
    ]
    for k in range(COUNT):
        at = {name: value[k] for name, value in given.items()}
        tension, length = (model.compute(name, **at) for name in ("member_tension", "member_length"))
        x, z = given["coordinate"][k]
        wanted = [np.ptp(tension), x + 2 * z, np.abs(tension), [x, 0, z]]
        wanted += [max(*length[[0, 2]], 0.9), [*model.manifest.stated_position[:3], [x, 0, z]]]
        for name, value in zip(names, wanted, strict=True):
            np.testing.assert_allclose(result.arrays[name][k], value, rtol=1e-14, atol=1e-14)


def test_an_expression_that_is_not_finite_fails_alone() -> None:
    operation = Evaluate(("sqrt(m.x)",))
    model = compile_for(TRIANGLE, operation)
    result = operation.run(model, {"coordinate": np.array([[1.0, 0.2], [-1.0, 0.2]])}, 2)
    assert decode_statuses(result.status) == ("ok", "non_finite_result")
    assert "sqrt(m.x)" in result.messages[1]
    np.testing.assert_array_equal(result.arrays["sqrt_m_x"], [1.0, np.nan])
