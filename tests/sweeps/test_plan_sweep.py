"""The plan of a sweep: libraries, tasks, time, size and notes, and what makes it impossible."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.analyses.evaluate import Evaluate
from tensegrity_codegen.sweeps.cases.build_cases import build_cases
from tensegrity_codegen.sweeps.engines.work import compute_task
from tensegrity_codegen.sweeps.plan_sweep import PlannedSweep, format_bytes, format_seconds, plan_sweep
from tensegrity_codegen.system.errors import InvalidValueError, UnknownKeyError

EXAMPLES = Path(__file__).resolve().parents[2] / "tensegrity_codegen/scene/examples"
TENSION = Evaluate(("member_tension",))


def plan(over: list[str], name: str = "two_nodes", **options: Any) -> PlannedSweep:
    return plan_sweep(EXAMPLES / f"{name}.toml", build_cases(over), TENSION, **options)


def test_the_plan_says_cases_libraries_tasks_time_size_and_notes() -> None:
    planned = plan(["gravity[2]=-9.81:0:40", "classes.cord.rest_length=1:1.2:5"], workers=2)
    data = json.loads(json.dumps(planned.describe()))
    assert (data["cases"], data["shape"], data["method"]) == (200, [40, 5], "grid")
    assert len(data["libraries"]) == 1
    assert set(data["libraries"][0]["parameters"]) == {"gravity", "rest_length"}
    assert data["tasks"] == len(planned.work.plan.tasks) >= 2
    assert data["seconds"] > 0
    assert data["bytes"] == 200 * (8 * 1 + 1)
    assert data["notes"] == ["no quantity depends on gravity[2]"]
    text = str(planned)
    for words in (
        "200 cases (40 x 5)",
        "1 library",
        "tasks of up to",
        "a case and core",
        "1.8 kB",
        "note: no",
    ):
        assert words in text


def test_every_case_is_in_one_task_and_has_its_result() -> None:
    planned = plan(["gravity[2]=-9.81:0:4", "classes.cord.rest_length=1:1.2:5"], task_size=7)
    work = planned.work
    results = [compute_task(work, task, planned.libraries.load) for task in work.plan.tasks]
    tension = np.concatenate([result.arrays["member_tension"] for result in results])
    model = planned.libraries.load(work.plan.groups[0])
    for row, values in enumerate(work.plan.cases.values()):
        alone = model.compute("member_tension", rest_length=values[1:])
        assert np.allclose(tension[row], alone, rtol=1e-12)


def test_tasks_have_the_size_that_is_stated() -> None:
    planned = plan(["gravity[2]=-9.81:0:40", "classes.cord.rest_length=1:1.2:5"], task_size=11)
    assert max(task.count for task in planned.work.plan.tasks) <= 11
    with pytest.raises(InvalidValueError, match="number of cases of a task"):
        plan(["gravity[2]=-9.81,0"], task_size=0)


def test_groups_that_need_other_libraries_are_listed() -> None:
    planned = plan(["shape.bars=3,4", "loads[0].force[2]=-3,0"], "prism")
    assert [item["cases"] for item in planned.describe()["libraries"]] == [2, 2]
    assert "2 libraries" in str(planned)


def test_notes_name_keys_whose_values_are_assembled_and_unbalanced_samples() -> None:
    cases = build_cases({}, {"shape.twist": "uniform(152,158)"}, n=6, method="sobol")
    notes = plan_sweep(EXAMPLES / "prism12.toml", cases, TENSION).notes
    assert notes[0] == "a Sobol' sequence is balanced for n = 2, 4, 8, ...: choose 4 or 8, not 6"
    assert notes[1] == "the structure is assembled for every set of values of shape.twist"


def test_a_table_with_an_unknown_column_is_named_with_its_line(tmp_path: Path) -> None:
    file = tmp_path / "cases.csv"
    file.write_text("\nshape.hieght\n0.3\n", encoding="utf-8")
    with pytest.raises(UnknownKeyError, match=r"cases.csv: line 2: column shape.hieght"):
        plan_sweep(EXAMPLES / "prism.toml", build_cases(table=file), TENSION)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (3.2e-6, "3.2 us"),
        (0.0124, "12 ms"),
        (0.614, "610 ms"),
        (2.44, "2.4 s"),
        (90, "90 s"),
        (7300, "2 h 2 min"),
    ],
)
def test_times_are_written_in_a_suitable_unit(seconds: float, text: str) -> None:
    assert format_seconds(seconds) == text


def test_sizes_are_written_in_a_suitable_unit() -> None:
    assert [format_bytes(size) for size in (0, 999, 12_345, 97_000_000)] == [
        "0 B",
        "999 B",
        "12.3 kB",
        "97 MB",
    ]
