"""Analysis `simulate`: every row is what `simulate_batch` and `simulate` give."""

from typing import Any
from unittest import mock

import numpy as np
import pytest

from tensegrity_codegen.analyses.motions import case_motions as module
from tensegrity_codegen.analyses.simulate import Simulate
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.system.errors import (
    FormulationError,
    InvalidValueError,
    LibraryError,
    TensegrityError,
)
from tests.analyses.cases.compiling import check_alike, compile_for, vary
from tests.analyses.cases.scenes import BODIES, PRISM, SINGLE, TRIANGLE
from tests.cases import thorough
from tests.sweeps.status_words import decode_statuses

COUNT = 5
KEPT = (
    *("member_tension", "member_tension.max", "node_position.final", "node_velocity.rms", "energy_drift"),
    *("member_length.min", "total_energy.every(3)"),
)


@pytest.mark.parametrize(
    ("scene", "method"),
    [(TRIANGLE, "radau"), (BODIES, "rk853"), *thorough((PRISM, "rk853"), (TRIANGLE, "rk853"))],
    ids=lambda item: item if isinstance(item, str) else str(item["name"]),
)
def test_rows_are_those_of_single_runs(scene: dict[str, Any], method: str) -> None:
    operation = Simulate(KEPT, t_end=0.05, samples=7, method=method, rtol=1e-8)
    model = compile_for(scene, operation)
    given = vary(model, COUNT, 1)
    result = operation.run(model, given, COUNT)
    assert result.is_good.all()
    check_alike(result, operation, model, COUNT)
    for k in range(COUNT):
        own = {name: value[k] for name, value in given.items()}
        start = {name: own.pop(name) for name in ("coordinate", "velocity")}
        alone = simulate(model, 0.05, samples=7, method=method, rtol=1e-8, **start, arguments=own)
        scale = float(np.abs(alone.member_tension).max())
        kept = {name: array[k] for name, array in result.arrays.items()}
        np.testing.assert_allclose(kept["member_tension"], alone.member_tension, atol=1e-4 * scale)
        np.testing.assert_allclose(kept["member_tension_max"], kept["member_tension"].max(axis=0))
        np.testing.assert_allclose(kept["node_position_final"], alone.node_position[-1], atol=1e-6)
        np.testing.assert_allclose(kept["total_energy_every_3"], alone.total_energy[::3], rtol=1e-5)
        length = [model.compute("member_length", coordinate=q, **own) for q in alone.coordinate]
        np.testing.assert_allclose(kept["member_length_min"], np.min(length, axis=0), atol=1e-6)


def test_small_blocks_give_the_same() -> None:
    kept = ("member_tension", "first(m.z < 0.299)", "each = first(node_position < 0.299)")
    operation = Simulate(kept, t_end=0.1, samples=5)
    model = compile_for(TRIANGLE, operation)
    given = vary(model, 19, 2)
    whole = operation.run(model, given, 19)
    with mock.patch.object(module, "MAX_BYTES", 1):
        parts = operation.run(model, given, 19, threads=2)
    for name, array in whole.arrays.items():
        np.testing.assert_array_equal(array, parts.arrays[name])
    first = whole.arrays["first_m_z_0_299"]
    assert np.nanmin(first) >= 0
    assert np.nanmax(first) <= 0.1
    node = model.manifest.node_name.index("m")
    np.testing.assert_allclose(whole.arrays["each"][:, node, 2], first, rtol=1e-12)


def test_a_motion_that_fails_leaves_the_others_alone() -> None:
    operation = Simulate(("member_tension", "n_steps"), t_end=0.1, samples=3, max_steps=40)
    model = compile_for(TRIANGLE, operation)
    given = vary(model, COUNT, 3)
    wanted = operation.run(model, given, COUNT)
    given["velocity"][1] = 1e200
    given["rest_length"][3] = np.inf
    result = operation.run(model, given, COUNT)
    words = decode_statuses(result.status)
    assert words[3] == "non_finite_input"
    assert words[1] not in ("ok", "non_finite_input")
    assert (words[0], words[2], words[4]) == ("ok", "ok", "ok")
    assert np.isnan(result.arrays["member_tension"][[1, 3]]).all()
    assert (result.arrays["n_steps"][[1, 3]] == -1).all()
    for name, array in result.arrays.items():
        np.testing.assert_array_equal(array[[0, 2, 4]], wanted.arrays[name][[0, 2, 4]])


def test_usual_results_and_cases_that_are_all_the_same() -> None:
    operation = Simulate(t_end=0.02, samples=3)
    model = compile_for(TRIANGLE, operation)
    result = operation.run(model, {"pull": 0.01}, 3)
    check_alike(result, operation, model, 3)
    assert len(np.unique(result.arrays["member_tension_max"], axis=0)) == 1


@pytest.mark.parametrize(
    ("operation", "error"),
    [
        (Simulate(t_end=-1.0), InvalidValueError),
        (Simulate(samples=1), InvalidValueError),
        (Simulate(method="rk4"), InvalidValueError),
        (Simulate(method="euler"), TensegrityError),
        (Simulate(("first(member_tension)",)), InvalidValueError),
    ],
)
def test_wrong_options_are_refused_before_anything_is_built(
    operation: Simulate, error: type[Exception]
) -> None:
    with pytest.raises(error):
        operation.needs(*load_scene(TRIANGLE))


def test_what_a_library_cannot_do_is_refused_by_name() -> None:
    operation = Simulate(t_end=0.1)
    with pytest.raises(LibraryError, match="double precision"):
        operation.run(compile_for(SINGLE, operation), {}, 2)
    massless = {**TRIANGLE, "nodes": {**TRIANGLE["nodes"], "m": {"position": [0, 0, 0.3]}}}
    with pytest.raises(FormulationError, match="mass"):
        compile_for(massless, operation)
    lacking = Simulate(("member_stress.max",), t_end=0.1)
    with pytest.raises(FormulationError, match="member_stress"):
        lacking.run(compile_for(TRIANGLE, operation), {}, 2)
    with pytest.raises(TensegrityError, match="keep 'node_position"):
        Simulate(("node_position[q].max",)).outputs(compile_for(TRIANGLE, operation).manifest)
