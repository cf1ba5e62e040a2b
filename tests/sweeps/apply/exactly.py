"""Arguments of cases, compared bit by bit with the structures of the edited scenes."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.sweeps.apply.assembler import (
    WITHOUT_ROWS,
    AssembledCase,
    CaseAssembler,
    build_assembler,
    hash_constants,
    list_slots,
)
from tensegrity_codegen.sweeps.apply.group_cases import ROUNDED, find_groups
from tensegrity_codegen.sweeps.apply.mapper import CaseGroup
from tensegrity_codegen.sweeps.cases.cases import Cases
from tensegrity_codegen.system.errors import TensegrityError

EXAMPLES = Path(__file__).resolve().parents[3] / "tensegrity_codegen/scene/examples"


def assemble(assembler: CaseAssembler, values: np.ndarray) -> tuple[AssembledCase | None, str]:
    """Return the structure of the edited scene and "", or None and what is wrong with it."""
    try:
        return assembler.assemble(values), ""
    except TensegrityError as error:
        return None, str(error)


def group_and_compare(scene: Mapping[str, Any] | Path, cases: Cases) -> tuple[CaseGroup, ...]:
    """Return the groups of some cases; every argument of every case must be that of its structure."""
    assembler = build_assembler(scene, cases.keys)
    groups = find_groups(assembler, cases, yes=True)
    assert sorted(row for group in groups for row in group.rows) == list(range(cases.count))
    for group in groups:
        numbers = np.asarray(group.rows)
        values = cases.select(numbers)
        applied = group.arguments(values)
        library = AssembledCase(group.structure, group.request, np.zeros(len(group.structure.inputs)))
        nominal = list_slots(library)
        for row, message in enumerate(applied.messages):
            alone, problem = assemble(assembler, values[row])
            assert message == problem
            if alone is None:
                assert all(np.isnan(array[row]).all() for array in applied.arguments.values())
                continue
            assert hash_constants(alone) == group.hash
            for name, exact in list_slots(alone).items():
                if name not in applied.arguments:
                    assert np.array_equal(nominal[name], exact), name
                    continue
                chosen = name in WITHOUT_ROWS or list(group.request.parameters[name])
                expected = exact if chosen is True else exact[chosen]
                if name == "rest_length":  # of prestresses of shapes, which are rounded to 13 digits
                    assert np.allclose(applied.arguments[name][row], expected, rtol=ROUNDED, atol=0.0)
                else:
                    assert np.array_equal(applied.arguments[name][row], expected), name
    return groups
