"""One question, one answer: what a verb, a function of Python and a row of a sweep say of twelve scenes."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import analyse, compile_scene, find_equilibrium, linearize, simulate
from tensegrity_codegen.analyses.cases.record import CaseAnalysis
from tensegrity_codegen.analyses.cases.registry import build_analysis
from tensegrity_codegen.analyses.equilibrium import RESULTS
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.pipeline.settle import choose_request
from tensegrity_codegen.report.analysis_tables import describe_analysis
from tensegrity_codegen.runtime.statics.equilibrium import choose_tolerance
from tensegrity_codegen.scene.write import write_scene
from tests.cases import thorough
from tests.cli.conftest import Run
from tests.sweeps.status_words import decode_statuses

Document = dict[str, Any]
LINEAR = (
    *("natural_frequency", "damping_ratio", "zero_eigenvalues", "growing_eigenvalues"),
    *("is_balanced", "one_sided_cables"),
)
CORRECTED = {"formulation": "rigid_bar", "options": {"bars": "all", "correction": "first_order"}}


def make_scene(name: str, model: Document | None = None, **bar: Any) -> Document:
    """Return a weight at the end of a bar that two cables hold, anchored beside it."""
    cable = {"kind": "cable", "axial_stiffness": 500.0, "damping": 0.5}
    return {
        "name": name,
        "axes": "xz",
        "gravity": [0.0, -9.81],
        "model": {"quantities": ["member_tension"]} | (model or {}),
        "nodes": {
            "a": {"position": [-1.0, 0.0], "anchored": True},
            "b": {"position": [1.0, 0.0], "anchored": True},
            "m": {"position": [0.0, -0.3], "mass": 0.5},
            "n": {"position": [0.0, -0.8], "mass": 0.2},
        },
        "members": {
            "left": cable | {"nodes": ["a", "m"], "rest_length": 0.95},
            "right": cable | {"nodes": ["b", "m"], "rest_length": 0.95},
            "rod": {"kind": "bar", "spring_constant": 500.0, "rest_length": 0.5, "nodes": ["m", "n"]} | bar,
        },
    }


def make_truss(force: float) -> Document:
    """Return two bars of 1e5 N to an apex 0.2 m above feet 2 m apart, loaded."""
    bar = {"kind": "bar", "axial_stiffness": 1e5}
    return {
        "name": "truss",
        "axes": "xz",
        "nodes": {
            "l": {"position": [-1, 0], "anchored": True},
            "r": {"position": [1, 0], "anchored": True},
            "t": {"position": [0, 0.2], "mass": 1.0},
        },
        "members": {"a": bar | {"nodes": ["l", "t"]}, "b": bar | {"nodes": ["r", "t"]}},
        "loads": [{"node": "t", "force": [0, -force]}],
    }


def make_slack() -> Document:
    """Return a weight on one cable, with one that is slack and one exactly at rest length, along x."""
    scene = make_scene("slack")
    cable = {"kind": "cable", "spring_constant": 100.0}
    scene["members"]["slack"] = cable | {"nodes": ["a", "n"], "rest_length": 5.0}
    return scene


def make_frame() -> Document:
    """Return a triangle of bars that stands on two feet."""
    place = {"left": [0, 0.0], "right": [1, 0.0], "top": [0.5, 1]}
    ends = {"base": ["left", "right"], "west": ["left", "top"], "east": ["right", "top"]}
    return {
        "name": "frame",
        "axes": "xz",
        "gravity": [0, -9.81],
        "nodes": {name: {"position": at, "mass": 1.0} for name, at in place.items()},
        "members": {
            name: {"kind": "bar", "spring_constant": 1e4, "damping": 20.0, "nodes": pair}
            for name, pair in ends.items()
        },
        "ground": {"stiffness": 1e5, "friction": 0.5},
    }


def make_ring() -> Document:
    """Return a weight on a cable that slides through its ring, with friction."""
    scene = make_scene("ring")
    del scene["members"]["left"], scene["members"]["right"]
    scene["members"]["rope"] = {
        "kind": "cable", "axial_stiffness": 500.0, "rest_length": 1.9, "friction": 0.1, "damping": 0.5,
        "nodes": ["a", "m", "b"],
    }  # fmt: skip
    return scene


def make_bodies() -> Document:
    """Return a bar that hangs in two tendons."""
    tendon = {"spring_constant": 100.0, "rest_length": 0.5, "damping": 0.5}
    return {
        "name": "bodies",
        "gravity": [0.0, 0.0, -9.81],
        "model": {"formulation": "bodies"},
        "bodies": {
            "ceiling": {"kind": "fixed", "points": {"a": [0.0, 0.0, 0.0], "b": [1.0, 0.0, 0.0]}},
            "stick": {
                "kind": "bar", "length": 0.6, "mass": 0.3, "centre": [0.5, 0.0, -0.5], "polar_axis": "z",
                "azimuth_deg": 0, "declination_deg": 90,
            },
        },
        "tendons": {
            "t1": tendon | {"points": ["ceiling.a", "stick.A"]},
            "t2": tendon | {"points": ["ceiling.b", "stick.B"]},
        },
    }  # fmt: skip


SCENES = {
    "plain": make_scene("plain"),
    "stiff": make_scene("stiff", spring_constant=1e7),
    "slack": make_slack(),
    "snapped": make_truss(400.0),
    "shallow": make_truss(200.0),
    "ground": make_frame(),
    "ring": make_ring(),
    "bodies": make_bodies(),
    "plastic": make_scene("plastic", yield_force=5.0, hardening=0.2),
    "viscous": make_scene("viscous", relaxation_time=0.5, relaxed_fraction=0.5),
    "rigid": make_scene("rigid", {"formulation": "rigid_bar", "options": {"bars": "all"}}),
    "corrected": make_scene("corrected", CORRECTED),
    "distances": make_scene("distances", {"formulation": "node_distance"}),
}


def compare(one: Any, other: Any, where: str) -> None:
    """Check that two JSON values say the same, numbers to rounding and tolerance."""
    if isinstance(one, dict):
        assert one.keys() == other.keys(), where
        for key in one:
            compare(one[key], other[key], f"{where}.{key}")
    elif isinstance(one, list):
        assert len(one) == len(other), where
        for k, (left, right) in enumerate(zip(one, other, strict=True)):
            compare(left, right, f"{where}[{k}]")
    elif isinstance(one, float) and isinstance(other, float):
        assert one == pytest.approx(other, rel=1e-5, abs=1e-7), where
    else:
        assert one == other, where


def check_keys(own: dict[str, Any], said: dict[str, Any], *others: str) -> None:
    """Check that a verb says all that a result in Python says, warnings besides those of the scene."""
    assert set(own.pop("warnings", ())) <= set(said.get("warnings", ()))
    for key in own.keys() - set(others):
        compare(own[key], said[key], key)


def to_json(value: Any) -> Any:
    """Return a value as the command line would write it."""

    def convert(item: Any) -> Any:
        return item.tolist() if isinstance(item, np.ndarray | np.generic) else list(item)

    text = json.dumps(value, default=convert)
    return json.loads(text, parse_constant=lambda _: None)


def compute_row(document: Document, operation: CaseAnalysis) -> tuple[str, dict[str, Any]]:
    """Return status and results of the only case of a sweep, of the library that a sweep builds."""
    structure, request = load_scene(document)
    request = choose_request(structure, request, operation.analyses)
    model = build_library(structure, operation.needs(structure, request).alone(request)).load()
    result = operation.run(model, {}, 1)
    return decode_statuses(result.status)[0], {name: array[0] for name, array in result.arrays.items()}


@pytest.fixture
def scene(request: pytest.FixtureRequest, folder: Path) -> tuple[Document, Path]:
    document, path = SCENES[request.param], folder / f"{request.param}.toml"
    write_scene(document, path)
    return document, path


LIGHT = ("slack", "snapped", "ground", "plastic", "corrected")
OTHERS = tuple(name for name in SCENES if name not in LIGHT)
every = pytest.mark.parametrize("scene", [*LIGHT, *thorough(*OTHERS)], indirect=True)


@pytest.mark.parametrize("scene", list(SCENES), indirect=True)
def test_equilibrium(scene: tuple[Document, Path], run: Run) -> None:
    document, path = scene
    said = run("equilibrium", path, "--json").data
    model = compile_scene(document, for_="equilibrium")
    found = find_equilibrium(model)
    own = to_json(found.as_evidence())
    if own["limits"] is not None:  # the verb adds values by member, which are arrays in Python
        said["limits"] = {key: said["limits"][key] for key in own["limits"]}
    check_keys(own, said, "residual", "iterations")
    assert found.residual <= 1e-9 * found.largest_force
    for name in ("node_position", "member_length", "member_tension"):
        compare(to_json(getattr(found, name)), list(said[name].values()), name)
    names = tuple(
        name for name in RESULTS if name not in ("residual", "iterations", "limit_use", "energy_change")
    )
    status, row = compute_row(document, build_analysis("equilibrium", names))
    assert status == said["status"]
    for name in names:
        value = to_json(float(row[name]))
        stated = said[name] if said[name] is None else float(said[name])
        compare(value, stated, f"row {name}")


@every
def test_linearize(scene: tuple[Document, Path], run: Run) -> None:
    document, path = scene
    for words, about in ((), "start"), (("--settle",), "equilibrium"):
        said = run("linearize", path, *words, "--json").data
        analyses = ("linearize", "equilibrium") if words else ("linearize",)
        model = compile_scene(document, for_=analyses)
        tolerance = choose_tolerance(model.structure)
        settled = find_equilibrium(model, tolerance=tolerance, snap_check=False) if words else None
        linear = linearize(model, settled)
        own = to_json(linear.as_evidence())
        if words and document["name"] == "distances":  # settled in node positions, and linearized in these
            own = {name: own[name] for name in ("natural_frequency", "damping_ratio", "growing_eigenvalues")}
        check_keys(own, said)
        assert set(linear.warnings) <= set(said.get("warnings", ()))
        _, row = compute_row(document, build_analysis("linearize", tuple(LINEAR), about=about))
        for name in LINEAR:
            stated = len(said[name]) if name == "one_sided_cables" else said[name]
            value = np.asarray(row[name])
            value = value[~np.isnan(value)] if value.ndim else float(value)
            compare(to_json(value), stated if isinstance(stated, list) else float(stated), name)


@pytest.mark.parametrize("scene", [name for name in SCENES if name != "ring"], indirect=True)
def test_analyse(scene: tuple[Document, Path], run: Run) -> None:
    document, path = scene
    said = run("analyse", path, "--json").data
    model = compile_scene(document, for_="analyse")
    own = to_json(describe_analysis(analyse(model), model.manifest.member_name, model.manifest.node_name))
    check_keys(own, said)
    names = ("n_selfstress", "n_mechanisms", "n_rigid_motions", "smallest_eigenvalue", "residual")
    _, row = compute_row(document, build_analysis("analyse", ("is_stable", *names)))
    assert row["is_stable"] == (said["status"] == "stable")
    for name in names:
        compare(float(row[name]), float(said[name]), f"row {name}")


@every
def test_simulate(scene: tuple[Document, Path], run: Run) -> None:
    document, path = scene
    said = run("simulate", path, "--t-end", 0.2, "--samples", 5, "--json").data
    found = simulate(compile_scene(document, for_="simulate"), 0.2, samples=5)
    check_keys(to_json(found.summary()), said)
    operation = build_analysis("simulate", "node_position.final", t_end=0.2, samples=5, method="rk54")
    status, row = compute_row(document, operation)
    assert status == said["status"]
    (place,) = row.values()
    final = found.node_position[-1][:, [0, 2] if place.shape[1] == 2 else slice(None)]
    np.testing.assert_allclose(place, final, atol=1e-5)
