"""What the mixed form takes, from loops over tables: the bits of the unrolled functions."""

from dataclasses import replace

import numpy as np
import pytest

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.integrate.implicit import integrate_implicit
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.codegen.subjects import everything
from tests.runtime.stiff_bars import class_two


@pytest.mark.parametrize("is_changeable", [True, *thorough(False)])
def test_cable_forces_and_laws_have_the_bits_of_unrolled_code(is_changeable: bool) -> None:
    structure, request = everything()
    request = request.wanting("cable_force", "member_law")
    request = request if is_changeable else replace(request, parameters={})
    unrolled = build_library(structure, request).load()
    table = build_library(structure, replace(request, emitter="table")).load()
    rng = np.random.default_rng(5)
    for spec in unrolled.manifest.functions:
        for _ in range(3):
            given = {name: unrolled.nominal(name) for name in spec.arguments}
            given = {name: value * rng.uniform(0.9, 1.1, value.shape) for name, value in given.items()}
            expected = unrolled.compute(spec.quantity, **given)
            np.testing.assert_array_equal(table.compute(spec.quantity, **given), expected)


@pytest.mark.thorough
def test_radau_runs_over_tables_to_the_same_bits() -> None:
    request = ModelRequest(("member_tension",), integrators=("radau",))
    runs = []
    for emitter in ("unrolled", "table"):
        model = build_library(class_two(1e7), replace(request, emitter=emitter)).load()
        state = np.concatenate([model.nominal("coordinate"), model.nominal("velocity")])
        motion = Motion(model, state, np.array([0.0, 0.2]))
        runs.append(integrate_implicit(motion, RunOptions("radau", 1e-6, 1e-6)))
    np.testing.assert_array_equal(runs[0].state, runs[1].state)
