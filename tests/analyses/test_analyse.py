"""Analysis `analyse`: every row is what `analyse` gives alone; a prism has a prestress at one twist."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.analyses.analyse import RESULTS, Analyse
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.analysis.analyse import analyse
from tensegrity_codegen.sweeps.sweep import sweep
from tensegrity_codegen.system.errors import TensegrityError
from tests.analyses.cases.compiling import check_alike, compile_for, vary
from tests.analyses.cases.scenes import BODIES, PRISM, TRIANGLE
from tests.cases import thorough
from tests.sweeps.status_words import decode_statuses

COUNT = 3


@pytest.mark.parametrize("scene", [TRIANGLE, *thorough(BODIES)], ids=lambda scene: str(scene["name"]))
def test_rows_are_those_of_single_analyses(scene: dict[str, Any]) -> None:
    operation = Analyse(tuple(RESULTS))
    model = compile_for(scene, operation)
    given = vary(model, COUNT, 1)
    result = operation.run(model, given, COUNT)
    assert result.is_good.all(), result.messages
    check_alike(result, operation, model, COUNT)
    for k in range(COUNT):
        own = {name: value[k] for name, value in given.items() if name != "velocity"}
        alone = analyse(model, coordinate=own.pop("coordinate"), arguments=own)
        kept = {name: array[k] for name, array in result.arrays.items()}
        for name in ("n_selfstress", "n_mechanisms", "n_rigid_motions", "residual", "smallest_eigenvalue"):
            assert kept[name] == pytest.approx(getattr(alone, name), rel=1e-12)
        assert kept["is_stable"] == (alone.status == "stable")
        np.testing.assert_array_equal(kept["prestress"], alone.prestress.tension)
        least = alone.prestress.least_tension  # infinite without cables
        np.testing.assert_array_equal(kept["least_tension"], least if np.isfinite(least) else np.nan)
        if alone.modes is not None:
            count = min(len(alone.modes.frequency), len(kept["natural_frequency"]))
            np.testing.assert_allclose(
                kept["natural_frequency"][:count], alone.modes.frequency[:count], rtol=1e-9, atol=1e-9
            )


def test_a_prism_has_a_prestress_at_one_twist_only() -> None:
    """90 + 180 / n degrees for n bars."""
    shape = {key: value for key, value in PRISM["shape"].items() if key != "prestress"}
    scene = {**PRISM, "shape": shape, "parameters": {}}
    found = sweep(scene, do="analyse", over={"shape.twist": [140.0, 150.0, 160.0]}, workers=1)
    assert (found["status"] == 0).all()
    assert found["is_stable"].values.tolist() == [0, 1, 0]
    assert found["n_selfstress"].values.tolist() == [0, 1, 0]
    assert found["prestress"].dims == ("shape.twist", "member")
    assert found["least_tension"].values[1] > 0


def test_a_case_that_fails_leaves_the_others_alone_and_wrong_names_are_refused() -> None:
    operation = Analyse()
    model = compile_for(TRIANGLE, operation)
    given = vary(model, COUNT, 2)
    given["pull"] = np.array([0.0, np.nan, 0.0])
    del given["input"]
    result = operation.run(model, given, COUNT)
    assert decode_statuses(result.status) == ("ok", "non_finite_input", "ok")
    for wrong in (Analyse(("rank",)), Analyse(("prestress", "prestress")), Analyse(about="end")):
        with pytest.raises(TensegrityError):
            wrong.needs(*load_scene(TRIANGLE))
