"""Libraries with what an operation needs, and random arguments of cases."""

from typing import Any

import numpy as np

from tensegrity_codegen.analyses.cases.record import CaseAnalysis, TaskResult
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.model.model import CompiledModel


def compile_for(scene: dict[str, Any], operation: CaseAnalysis) -> CompiledModel:
    structure, request = load_scene(scene)
    return build_library(structure, operation.needs(structure, request).alone(request)).load()


def vary(model: CompiledModel, count: int, seed: int, scale: float = 1e-3) -> dict[str, Any]:
    """Return random values about the nominal ones of all arguments, one row a case."""
    random = np.random.default_rng(seed)
    return {
        item.name: model.nominal(item.name)
        + random.normal(scale=scale, size=(count, *item.shape)).astype(model.dtype)
        for item in model.manifest.arguments
    }


def check_alike(result: TaskResult, operation: CaseAnalysis, model: CompiledModel, count: int) -> None:
    """Check that arrays are as the operation says."""
    outputs = operation.outputs(model.manifest)
    assert list(result.arrays) == [output.name for output in outputs]
    for output in outputs:
        array = result.arrays[output.name]
        assert array.shape == (count, *output.shape)
        assert array.dtype == output.dtype
        assert len(output.dims) == len(output.shape) == len(set(output.dims))
        for dim, labels in output.coordinates.items():
            assert len(labels) == output.shape[output.dims.index(dim)]
        assert output.sentence
