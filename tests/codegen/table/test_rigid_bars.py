"""Loops over tables with rigid bars: the statics of unrolled code, bit for bit, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from tensegrity_codegen.codegen.choose_emitter import choose_emitter, find_facts
from tensegrity_codegen.codegen.table.emitter import TABLE
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.statics.equilibrium import equilibrium_quantities
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest
from tests.comparison import dense
from tests.runtime.build import bar, cable, make_structure, prism

STATICS = ModelRequest(equilibrium_quantities("rigid_bar"), formulation="rigid_bar", emitter="auto")


def rigid_prism() -> Structure:
    structure = prism(gravity=(0, 0, -9.81), anchored={0: "xyz"})
    constant = np.where(structure.is_bar, 0.0, structure.spring_constant)
    return structure.with_changes(spring_constant=constant)


@pytest.mark.thorough
def test_statics_have_the_bits_of_unrolled_code() -> None:
    structure = rigid_prism()
    structure = structure.with_changes(damping=np.where(structure.is_bar, 0.0, 0.4))
    matrices = ("material_stiffness", "geometric_stiffness", "damping_matrix", "equilibrium_matrix")
    request = STATICS.wanting(*STATICS.quantities, *matrices)
    table, unrolled = (
        build_library(structure, replace(request, emitter=name)).load() for name in ("table", "unrolled")
    )
    assert table.manifest.rigid_bar == unrolled.manifest.rigid_bar
    q = table.nominal("coordinate") * 1.03
    for name in request.quantities:
        one, other = (dense(model.compute(name, coordinate=q)) for model in (table, unrolled))
        assert np.array_equal(one, other)


def test_large_scenes_take_loops_for_statics_alone() -> None:
    place = [[float(k), 0, float(k % 2)] for k in range(130)]
    members = [bar(k, k + 1, 2**0.5, 0.0) if k % 3 == 0 else cable(k, k + 1, 1.0) for k in range(129)]
    row = make_structure(place, members)
    assert choose_emitter(find_facts(row, STATICS)).name == "table"
    moving = replace(STATICS, quantities=("acceleration",))
    assert choose_emitter(find_facts(row, moving)).name == "unrolled"


def test_what_needs_forces_of_bars_is_refused() -> None:
    with pytest.raises(FormulationError, match="does not serve"):
        TABLE.prune(TABLE.build(rigid_prism(), STATICS), ("member_tension",))
    corrected = replace(STATICS, options={"bars": "all", "correction": "first_order"})
    with pytest.raises(FormulationError, match="in statics only"):
        TABLE.build(prism(), corrected)
