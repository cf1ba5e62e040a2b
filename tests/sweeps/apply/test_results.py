"""Results of cases through arguments of one library, beside those of the edited scene alone."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.analyses.cases.record import CaseAnalysis, TaskResult
from tensegrity_codegen.analyses.cases.registry import build_analysis
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.scene.read import read_document
from tensegrity_codegen.sweeps.apply.assembler import build_assembler
from tensegrity_codegen.sweeps.apply.group_cases import find_groups
from tensegrity_codegen.sweeps.cases.build_cases import build_cases
from tensegrity_codegen.sweeps.cases.cases import Cases
from tensegrity_codegen.sweeps.engines.work import library_request, select_arguments
from tests.sweeps.apply.exactly import EXAMPLES

ROWS = (-1,)  # cases that are computed alone too
SWEEPS = {
    "prism": ["shape.prestress=8:12:3", "classes.cable.spring_constant=180,220", "loads[0].force[2]=-3,-1"],
    "planar": ["nodes.a.position[1]=0,0.02", "nodes.b.position[1]=0,-0.01", "classes.post.prestress=18,22"],
    "lin_prism": ["tendons.top1.rest_length=0.35,0.36", "bodies.bar1.azimuth_deg=-166,-164"],
}


def thorough(name: str) -> Any:
    return pytest.param(name, marks=pytest.mark.thorough)


def run_both(
    name: str, over: list[str], operation: CaseAnalysis
) -> tuple[Cases, TaskResult, list[TaskResult]]:
    """Return the results of all cases by one library, and of some by a library of their own scene."""
    document: dict[str, Any] = read_document(EXAMPLES / f"{name}.toml")
    cases = build_cases(over)
    assembler = build_assembler(document, cases.keys)
    (group,) = find_groups(assembler, cases)
    model = build_library(group.structure, library_request(group, operation)).load()
    applied = group.arguments(cases.values())
    assert applied.good.all()
    together = operation.run(model, select_arguments(model, applied), cases.count)
    alone = [operation.run(load_alone(assembler, cases.values()[row], operation), {}, 1) for row in ROWS]
    return cases, together, alone


def load_alone(assembler: Any, values: np.ndarray, operation: CaseAnalysis) -> CompiledModel:
    case = assembler.assemble(values)
    needs = operation.needs(case.subject, case.request)
    return build_library(case.subject, needs.alone(case.request)).load()


def compare(together: TaskResult, alone: list[TaskResult], part: float) -> None:
    for row, single in zip(ROWS, alone, strict=True):
        assert together.status[row] == single.status[0]
        assert single.is_good.all()
        for name, expected in single.arrays.items():
            if expected.dtype.kind != "f":
                continue
            scale = np.abs(expected).max()
            assert np.allclose(together.arrays[name][row], expected[0], rtol=0.0, atol=part * scale), name


@pytest.mark.parametrize("name", ["planar", thorough("prism"), thorough("lin_prism")])
def test_tensions_are_those_of_the_edited_scene(name: str) -> None:
    _, together, alone = run_both(name, SWEEPS[name], build_analysis("evaluate", ("member_tension",)))
    compare(together, alone, 1e-12)


@pytest.mark.thorough
def test_equilibria_are_those_of_the_edited_scene() -> None:
    keep = ("node_position", "member_tension")
    _, together, alone = run_both("prism", SWEEPS["prism"], build_analysis("equilibrium", keep))
    compare(together, alone, 1e-8)


@pytest.mark.parametrize("name", ["planar", thorough("lin_prism")])
def test_motions_are_those_of_the_edited_scene(name: str) -> None:
    operation = build_analysis("simulate", ("node_position",), t_end=0.02, samples=3, atol=1e-10)
    _, together, alone = run_both(name, SWEEPS[name], operation)
    compare(together, alone, 1e-9)


def test_moved_anchors_are_where_the_cases_have_them() -> None:
    over = ["nodes.a.position[0]=-0.1,0,0.1", "nodes.b.position[1]=-0.1,0.1"]
    cases, together, alone = run_both("planar", over, build_analysis("evaluate", ("node_position",)))
    compare(together, alone, 0.0)
    position = together.arrays["node_position"]
    assert np.array_equal(position[:, 0, 0], cases.values()[:, 0])
    assert np.array_equal(position[:, 1, -1], cases.values()[:, 1])
