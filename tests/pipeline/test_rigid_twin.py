"""The model with corrected rigid bars beside the elastic one: where there is one, and what they share."""

import pickle
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.analyses import Needs, want_analyses
from tensegrity_codegen.pipeline.build_library import build_library, check_buildable
from tensegrity_codegen.pipeline.compile_scene import compile_scene, load_scene
from tensegrity_codegen.pipeline.rigid_twin import INTEGRATORS, MOST_BARS, request_rigid_twin
from tensegrity_codegen.runtime.accuracy.integrate import integrate
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.model.consistent import make_consistent
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.cache_root import CACHE_VARIABLE
from tensegrity_codegen.tables.request import ModelRequest
from tests.models import EXAMPLES, STIFF_PENDULUM

BAR, CABLE = STIFF_PENDULUM["members"].values()


def pendulum(**changes: Any) -> dict[str, Any]:
    """Return the scene of a stiff pendulum with other sections."""
    return {**deepcopy(STIFF_PENDULUM), **changes}


def wanted(scene: Any, **besides: Any) -> tuple[Structure, ModelRequest | None]:
    """Return the structure of a scene and the request of the second model beside that of `simulate`."""
    structure, request = load_scene(scene)
    assert isinstance(structure, Structure)
    request = want_analyses(structure, request, ("simulate",), besides=Needs((), **besides))
    return structure, request_rigid_twin(structure, request)


@pytest.mark.parametrize("name", ["prism", "icosahedron", "tower", "prism12"])
def test_examples_with_stiff_bars_have_one_that_can_be_built(name: str) -> None:
    structure, request = wanted(EXAMPLES / f"{name}.toml")
    assert request is not None
    assert request.integrators == INTEGRATORS
    assert dict(request.options) == {"bars": "all", "correction": "first_order"}
    check_buildable(structure, request)


def members(**changes: Any) -> dict[str, Any]:
    """The pendulum with more or other members."""
    return pendulum(members={"bar": BAR, "cable": CABLE, **changes})


def with_nodes(**changes: Any) -> dict[str, Any]:
    scene = pendulum()
    return scene | {"nodes": scene["nodes"] | changes}


OTHERS: dict[str, Callable[[], dict[str, Any]]] = {
    "bars hardly stiffer": lambda: members(bar={**BAR, "spring_constant": 9e3}),
    "one soft bar": lambda: (
        members(cable={**CABLE, "kind": "bar"}, other={**CABLE, "nodes": ["a", "d"]})
        | {"nodes": with_nodes(d={"position": [0.0, -1.0], "mass": 1.0})["nodes"]}
    ),
    "a bar of another law": lambda: members(bar={**BAR, "switch_elongation": 0.1, "stiffness_ratio": 0.5}),
    "a ground": lambda: pendulum(ground={"stiffness": 1e4, "offset": -2.0}),
    "a plastic cable": lambda: members(cable={**CABLE, "yield_force": 5.0, "hardening": 0.1}),
    "a cable through a ring": lambda: members(
        cable={"kind": "cable", "nodes": ["a", "b", "c"], "axial_stiffness": 100.0, "rest_length": 1.9}
    ),
    "bars that repeat each other": lambda: (
        members(cable=BAR | {"nodes": ["b", "c"]}, more=BAR | {"nodes": ["b", "d"]})
        | {"nodes": with_nodes(d={"position": [0.0, -1.6], "anchored": True})["nodes"]}
    ),
    "a bar between anchors": lambda: members(held=BAR | {"nodes": ["a", "c"], "rest_length": 1.7}),
    "an input of a bar": lambda: pendulum(inputs=[{"name": "u", "members": ["bar"], "kind": "rest_length"}]),
    "another formulation": lambda: pendulum(model={"formulation": "node_distance"}),
    "single precision": lambda: pendulum(model={"precision": "single"}),
}


@pytest.mark.parametrize("why", OTHERS)
def test_others_have_none(why: str) -> None:
    assert wanted(OTHERS[why]())[1] is None


@pytest.mark.parametrize("name", ["spring_constant", "rest_length", "damping"])
def test_parameters_of_cables_are_shared_and_those_of_bars_leave_none(name: str) -> None:
    assert wanted(pendulum(), parameters={name: (0,)})[1] is None
    structure, request = wanted(pendulum(), parameters={name: (1,), "node_mass": (1,), "node_load": (1,)})
    assert request is not None
    check_buildable(structure, request)


def test_methods_that_are_named_leave_none() -> None:
    structure, request = load_scene(pendulum())
    for method, has_twin in (("auto", True), ("rk853", False), ("radau", False)):
        asked = want_analyses(structure, request, ("simulate",), method=method)
        assert (request_rigid_twin(structure, asked) is not None) == has_twin
    batch = want_analyses(structure, request, ("simulate_batch",))
    assert request_rigid_twin(structure, batch) is None


def test_many_bars_have_none() -> None:
    scene = pendulum()
    nodes, links = scene["nodes"], scene["members"]
    for k in range(MOST_BARS):
        nodes[f"n{k}"] = {"position": [0.0, -1.0 - k], "mass": 1.0}
        links[f"b{k}"] = {**BAR, "nodes": ["a" if k == 0 else f"n{k - 1}", f"n{k}"]}
    assert wanted(scene)[1] is None


def test_it_is_built_when_first_asked_for_and_moves_as_the_elastic_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    model = compile_scene(pendulum(), for_="simulate")
    assert len(list(tmp_path.rglob("manifest.json"))) == 1
    twin = model.rigid_twin
    assert twin is not None
    assert twin is model.rigid_twin
    assert len(list(tmp_path.rglob("manifest.json"))) == 2
    for part in ("coordinate_name", "member_name", "input_name"):
        assert getattr(twin.manifest, part) == getattr(model.manifest, part)
    named = [{spec.name: spec.shape for spec in each.manifest.arguments} for each in (model, twin)]
    assert named[0] == named[1]
    # A start from which the bar hardly vibrates: both move alike to the compliance squared.
    start = np.concatenate(make_consistent(twin, twin.nominal("coordinate"), twin.nominal("velocity"), {}))
    elastic, rigid = (
        integrate(Motion(each, start, np.linspace(0.0, 1.0, 11)), RunOptions("rk853", 1e-9, 1e-11))
        for each in (model, twin)
    )
    apart = np.abs(elastic.state[:, :2] - rigid.state[:, :2]).max()
    assert apart < 1e-9 < 0.05 < np.abs(elastic.state[:, :2] - start[:2]).max()
    # Sent to another process.
    sent = pickle.loads(pickle.dumps(model))
    assert sent.rigid_twin.path == twin.path
    assert twin.rigid_twin is None


def test_exported_libraries_have_none() -> None:
    structure, request = load_scene(pendulum())
    asked = want_analyses(structure, replace(request, quantities=()), ("simulate",))
    assert build_library(structure, asked).load().rigid_twin is None
