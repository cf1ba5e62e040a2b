"""Tasks: every case in one of them, and in one group."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.codegen.compilation.fingerprint import hash_scene
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.sweeps.apply.mapper import AppliedCases, CaseGroup
from tensegrity_codegen.sweeps.cases.cases import Axis, Cases
from tensegrity_codegen.sweeps.engines.work import SweepPlan, divide_cases

EXAMPLES = Path(__file__).resolve().parents[3] / "tensegrity_codegen/scene/examples"


def apply_nothing(values: np.ndarray) -> AppliedCases:
    return AppliedCases({}, ("",) * len(values))


@pytest.mark.parametrize("size", [1, 4, 7, 100])
def test_every_case_is_in_one_task_and_one_group(size: int) -> None:
    structure, request = load_scene(EXAMPLES / "prism.toml")
    cases = Cases((Axis("a", np.arange(23.0)),))
    odd = np.arange(23) % 5 == 1
    rows = (np.flatnonzero(odd), np.flatnonzero(~odd))
    groups = tuple(
        CaseGroup(number, str(number), structure, request, part, apply_nothing)
        for number, part in enumerate(rows)
    )
    plan = SweepPlan(cases, groups, divide_cases(cases, groups, size), size)
    found = [np.concatenate([part for _, part in plan.find_rows(task)]) for task in plan.tasks]
    assert sorted(np.concatenate(found)) == list(range(23))
    for task, numbers in zip(plan.tasks, found, strict=True):
        assert sorted(numbers) == list(range(task.first, task.last))
        assert all(len(part) for _, part in plan.find_rows(task))


@pytest.mark.parametrize("name", ["prism", "prism12", "svd_tower"])
def test_a_group_can_be_sent_to_another_process(name: str) -> None:
    structure, request = load_scene(EXAMPLES / f"{name}.toml")
    group = CaseGroup(0, "", structure, request, range(3), apply_nothing)
    other = pickle.loads(pickle.dumps(group))
    assert hash_scene(other.structure, other.request) == hash_scene(structure, request)
    assert not other.structure.rest_length.flags.writeable
