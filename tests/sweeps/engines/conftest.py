"""A sweep whose results are made up of the values of its cases, and whose workers can be made to end."""

import os
import signal
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from tensegrity_codegen.analyses.cases.record import CaseAnalysis, Output, TaskResult
from tensegrity_codegen.analyses.cases.statuses import encode_status
from tensegrity_codegen.pipeline.analyses import Needs
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.sweeps.apply.mapper import AppliedCases, CaseGroup
from tensegrity_codegen.sweeps.cases.cases import Axis, Cases
from tensegrity_codegen.sweeps.engines.work import SweepPlan, SweepWork, divide_cases
from tensegrity_codegen.system.errors import LibraryError
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.request import ModelRequest

SCENE = Path(__file__).resolve().parents[3] / "tensegrity_codegen/scene/examples/two_nodes.toml"


@dataclass(frozen=True)
class Square(CaseAnalysis):
    """The square of a number; the value `deadly` ends its process `lives` times, by files in `folder`."""

    name: ClassVar[str] = "square"
    compute: ClassVar[Any] = None  # `run` is here without a library, whose arguments `compute` would take
    folder: str = ""
    deadly: float = -1.0
    lives: int = 0
    way: str = "kill"

    def needs(self, structure: Subject, request: ModelRequest) -> Needs:
        return Needs(("member_tension",))

    def outputs(self, manifest: Manifest | None = None) -> tuple[Output, ...]:
        return (Output("square", (), (), "float64", "1", "square"),)

    def run(
        self, model: CompiledModel, arguments: Mapping[str, Any], count: int, *, threads: int = 1
    ) -> TaskResult:
        x = np.asarray(arguments["x"])
        if self.deadly in x and len(list(Path(self.folder).iterdir())) < self.lives:
            (Path(self.folder) / str(os.getpid())).touch()
            if self.way == "kill":
                os.kill(os.getpid(), signal.SIGKILL)
            raise LibraryError("no such library") if self.way == "library" else ZeroDivisionError("by zero")
        return TaskResult({"square": x**2}, np.full(count, encode_status("ok"), dtype=np.int8), ("",) * count)


@dataclass(frozen=True)
class Take:
    """Values as arguments; the value `wrong` is no scene."""

    wrong: float = -1.0

    def __call__(self, values: np.ndarray) -> AppliedCases:
        messages = tuple("a wrong value" if row[0] == self.wrong else "" for row in values)
        return AppliedCases({"x": values[:, 0]}, messages)


class NoLibraries:
    """In place of libraries, which made-up results need not."""

    def load(self, group: CaseGroup) -> Any:
        return None


def make_work(operation: Square, *, count: int = 40, size: int = 8, wrong: float = -1.0) -> SweepWork:
    structure, request = load_scene(SCENE)
    cases = Cases((Axis("x", np.arange(float(count))),))
    odd = np.arange(count) % 4 == 1
    groups = tuple(
        CaseGroup(number, str(number), structure, request, rows, Take(wrong))
        for number, rows in enumerate((np.flatnonzero(odd), np.flatnonzero(~odd)))
    )
    plan = SweepPlan(cases, groups, divide_cases(cases, groups, size), size)
    return SweepWork(plan, operation, operation.outputs())
