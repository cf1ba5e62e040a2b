"""Wrong calls of form, size_members, identify, optimise, libraries and requests: a named error."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tensegrity_codegen as tc
from tensegrity_codegen.runtime.model.arrays import to_doubles
from tensegrity_codegen.sweeps.fitting.keyed_motion import METHOD
from tensegrity_codegen.system.checks import check_names
from tensegrity_codegen.system.errors import InvalidValueError
from tests.wrong_calls import WRONG, list_bare_errors

SCENE: dict[str, Any] = {
    "name": "swing",
    "gravity": [0, 0, -9.81],
    "nodes": {"a": {"position": [0, 0, 0], "anchored": True}, "b": {"position": [0, 0, -1], "mass": 3.0}},
    "members": {"m": {"kind": "cable", "nodes": ["a", "b"], "spring_constant": 100.0, "rest_length": 0.9}},
}
MEASURED = {"time": [0.1, 0.2, 0.3], "b.z": [-1.04, -1.1, -1.12]}
FEW = (None, 3, "x", {"x": 1}, [None], object(), np.zeros(0))
Call = tuple[Callable[..., Any], dict[str, Any]]


def lose(motion: tc.Trajectory) -> tuple[float, dict[str, Any]]:
    return float((motion.node_position**2).sum()), {"node_position": 2.0 * motion.node_position}


@pytest.fixture(scope="module")
def calls() -> dict[str, Call]:
    """Functions with arguments that are right."""
    structure, _ = tc.load_scene(SCENE)
    request = tc.ModelRequest(("member_tension",))
    built = tc.build_library(structure, request)
    slope = tc.LossGradient(SCENE, ["gravity[2]"], lose, 0.1, samples=3)

    def build(**stated: Any) -> None:
        tc.build_library(structure, tc.ModelRequest(**stated))

    def differentiate(values: Any) -> None:
        slope(values)

    lists = ("integrators", "solvers", "keep", "interfaces", "driven", "columns", "directions")
    asked = dict.fromkeys(lists, ()) | {"quantities": ("member_tension",), "parameters": {}, "options": {}}
    asked |= {"formulation": "node_position", "emitter": "unrolled", "precision": "double", "events": None}
    targets = {
        "target_length": {"m": 1.0},
        "target_force": {"m": (1.0, 1.0)},
        "length_range": {"m": (0.5, 3)},
    }
    motions = {"method": METHOD, "rtol": 1e-9, "schedule": None, "compiler": None}
    return {
        "form": (tc.form, {"scene": SCENE, "density": {"cables": 5.0}, "force": None, "length": None}),
        "form with targets": (tc.form, {"scene": SCENE, "density": {"cables": 5.0}, **targets}),
        "size_members": (
            tc.size_members,
            {"scene": SCENE, "density": 7850.0, "yield_stress": 2e8, "load_cases": {"a": {"b": [0, 0, -5]}}},
        ),
        "optimise": (
            tc.optimise,
            {"gradient": slope, "bounds": {"gravity[2]": (-20, 0)}, "max_iterations": 1, "tolerance": 1e-9},
        ),
        "LossGradient": (
            tc.LossGradient,
            {"scene": SCENE, "keys": ["gravity[2]"], "loss": lose, "t_end": 0.1, "samples": 3, **motions,
             "arguments": None, "backwards": None},
        ),
        "LossGradient()": (differentiate, {"values": [-9.81]}),
        "add_segment_error": (
            tc.add_segment_error,
            {"found": tc.find_equilibrium(tc.compile_scene(SCENE, for_="equilibrium")), "request": None},
        ),
        "build_library": (tc.build_library, {"structure": structure, "request": request, "cache": None}),
        "ModelRequest": (build, {**asked, "flags": "reference", "batch_width": 0}),
        "symbolic_functions": (
            tc.symbolic_functions, {"path": SCENE, "quantities": (), "parameters": None, "actuate": ()}
        ),
        "identify": (
            tc.identify,
            {"scene": SCENE, "measured": MEASURED, "keys": ["nodes.b.mass"], "bounds": None, "noise": None,
             "hold_out": 0.0, **motions, "progress": None},
        ),
        "CompiledModel": (tc.CompiledModel, {"path": built.path, "manifest": None, "structure": None}),
        "Scene": (tc.Scene, {**SCENE, "classes": {}, "axes": "xyz", "model": {}, "loads": [], "limits": {}}),
        "find_catenary": (
            tc.find_catenary,
            {"span": 10.0, "rise": 0.0, "length": 10.5, "weight": 9.81, "axial_stiffness": 1e4},
        ),
    }  # fmt: skip


NAMES = (
    *("form", "form with targets", "size_members", "optimise", "LossGradient", "LossGradient()"),
    *("add_segment_error", "build_library", "ModelRequest", "symbolic_functions", "identify"),
    *("CompiledModel", "Scene", "find_catenary"),
)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", NAMES)
def test_wrong_calls_are_named_errors(calls: dict[str, Call], name: str) -> None:
    function, right = calls[name]
    assert list_bare_errors(function, right, right, FEW) == []


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", NAMES)
def test_all_wrong_calls_are_named_errors(calls: dict[str, Call], name: str) -> None:
    function, right = calls[name]
    assert list_bare_errors(function, right, right, WRONG) == []


def test_folders_of_controllers_and_names_of_motions_are_checked(tmp_path: Path) -> None:
    for value in (None, 1.0, [1]):
        with pytest.raises(InvalidValueError, match="not a path"):
            tc.load_controller(value)  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match=r"scene\.nodes"):
        tc.Scene(name="x", nodes=5)
    with pytest.raises(InvalidValueError, match="load_scene"):
        tc.build_library(SCENE, tc.ModelRequest(("member_tension",)))  # type: ignore[arg-type]


def test_endless_ranges_fill_no_memory() -> None:
    with pytest.raises(InvalidValueError, match="not an array of numbers"):
        to_doubles(range(10**12), "q", "numbers")
    with pytest.raises(InvalidValueError, match="not a list of names"):
        check_names(range(10**12), "names")
