"""Analysis `linearize`: every row is what `linearize` gives alone."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.analyses.linearize import Linearize
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.linear.linearize import linearize
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.system.errors import LibraryError, TensegrityError
from tests.analyses.cases.compiling import check_alike, compile_for, vary
from tests.analyses.cases.scenes import BODIES, PRISM, SINGLE, TRIANGLE
from tests.cases import thorough
from tests.sweeps.status_words import decode_statuses

COUNT = 4
ALL = ("natural_frequency", "damping_ratio", "A", "B", "residual_rate", "zero_eigenvalues")


@pytest.mark.parametrize("scene", [TRIANGLE, *thorough(BODIES, PRISM)], ids=lambda scene: str(scene["name"]))
@pytest.mark.parametrize("about", ["start", "equilibrium"])
def test_rows_are_those_of_single_models(scene: dict[str, Any], about: str) -> None:
    operation = Linearize(ALL, about=about)
    model = compile_for(scene, operation)
    given = vary(model, COUNT, 1)
    if scene is PRISM:
        given["node_load"][:, :, :2] = 0
    result = operation.run(model, given, COUNT)
    assert result.is_good.all()
    check_alike(result, operation, model, COUNT)
    for k in range(COUNT):
        own = {name: value[k] for name, value in given.items()}
        q, v = own.pop("coordinate"), own.pop("velocity")
        if about == "equilibrium":
            q, v = find_equilibrium(model, coordinate=q, arguments=own, tolerance=1e-12).coordinate, 0 * v
        alone = linearize(model, coordinate=q, velocity=v, arguments=own)
        kept = {name: array[k] for name, array in result.arrays.items()}
        size = float(np.abs(alone.A.toarray()).max())
        count = len(alone.natural_frequency)
        if about == "start":
            np.testing.assert_allclose(kept["A"], alone.A.toarray(), atol=1e-9 * size)
            np.testing.assert_allclose(kept["B"], alone.B.toarray(), atol=1e-9 * size)
            np.testing.assert_allclose(kept["residual_rate"], alone.residual_rate, atol=1e-9 * size)
            assert kept["zero_eigenvalues"] == alone.spectrum.zero_eigenvalues
        # Slow vibrations of a free structure depend on where it came to rest.
        fast = alone.natural_frequency > 1e-3 * alone.natural_frequency.max()
        np.testing.assert_allclose(
            kept["natural_frequency"][:count][fast], alone.natural_frequency[fast], rtol=1e-5
        )
        assert np.isnan(kept["natural_frequency"][count:]).all()


def test_a_case_that_fails_leaves_the_others_alone() -> None:
    operation = Linearize()
    model = compile_for(TRIANGLE, operation)
    given = vary(model, COUNT, 2)
    given["coordinate"][2] = [1e200, 0.0]  # whose square overflows
    given["pull"] = np.array([np.nan, 0, 0, 0])
    del given["input"]
    result = operation.run(model, given, COUNT)
    assert decode_statuses(result.status) == ("non_finite_input", "ok", "non_finite_result", "ok")
    assert np.isnan(result.arrays["A"][[0, 2]]).all()
    assert np.isfinite(result.arrays["A"][[1, 3]]).all()


def test_without_inputs_there_is_no_b() -> None:
    operation = Linearize()
    names = [output.name for output in operation.outputs(compile_for(PRISM, operation).manifest)]
    assert names == ["natural_frequency", "damping_ratio", "A"]


def test_what_cannot_be_done_is_refused() -> None:
    for operation in (Linearize(("frequency",)), Linearize(("A", "A")), Linearize(about="end")):
        with pytest.raises(TensegrityError):
            operation.needs(*load_scene(TRIANGLE))
    with pytest.raises(LibraryError, match="double precision"):
        Linearize().run(compile_for(SINGLE, Linearize()), {}, 2)
