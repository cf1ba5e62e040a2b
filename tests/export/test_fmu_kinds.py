"""Units of other kinds of scenes: bodies, bars of constant length, stiff bars, laws with two slopes."""

import itertools
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.export.export_fmu import export_fmu
from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.scene.write import write_scene
from tests.body_scenes import EVERYTHING
from tests.cases import thorough
from tests.export.importer import Unit2
from tests.export.scenes import LOOSE

RTOL, T_END = 1e-8, 0.1


def change_loose(**changes: Any) -> dict[str, Any]:
    document = tomllib.loads(LOOSE)
    for key, value in changes.items():
        section, _, name = key.partition("__")
        document[section][name] = value
    return document


def rigid() -> dict[str, Any]:
    return change_loose(model__formulation="rigid_bar", model__options={"bars": "all"})


def switching() -> dict[str, Any]:
    document = tomllib.loads(LOOSE)
    document["classes"]["cable"] |= {"switch_elongation": 0.004, "stiffness_ratio": 0.3}
    return document


def table() -> dict[str, Any]:
    return change_loose(model__emitter="table")


def distances() -> dict[str, Any]:
    document = change_loose(model__formulation="node_distance")
    document["shape"]["anchor_bottom"] = False
    document["gravity"] = [0, 0, 0]
    return document


SCENES = {"rigid": rigid, "switching": switching, "table": table, "bodies": lambda: dict(EVERYTHING)}
SCENES["distances"] = distances
NAMES = ["rigid", *thorough("switching", "table", "bodies", "distances")]


def make_unit(document: dict[str, Any], folder: Path, **options: Any) -> tuple[Path, Unit2]:
    scene, out = folder / f"{document['name']}.toml", folder / "unit.fmu"
    write_scene(document, scene)
    export_fmu(scene, out, **options)
    return scene, Unit2(out, folder / "unit", "cs")


def largest_error(unit: Unit2, scene: Path, method: str = "auto") -> float:
    """Return the largest difference of a node position from those of `simulate` [m]."""
    model = compile_scene(scene, for_="simulate", method=method)
    ours = simulate(model, T_END, samples=21, rtol=RTOL, method=method)
    assert ours.status == "ok", ours.message
    names = [f"node_position.{node}.{axis}" for node in ours.node_name for axis in "xyz"]
    unit.start(RTOL)
    found = 0.0
    for k, (first, last) in enumerate(itertools.pairwise(ours.time)):
        assert unit.step(first, last - first) == 0, unit.messages
        found = max(found, float(np.abs(unit.get(*names) - ours.node_position[k + 1].ravel()).max()))
    assert unit.count() == ours.log.count
    assert float(np.abs(ours.node_position[-1] - ours.node_position[0]).max()) > 1e-4
    return found


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.thorough
def test_the_motion_is_that_of_simulate(name: str, tmp_path: Path) -> None:
    scene, unit = make_unit(SCENES[name](), tmp_path)
    assert largest_error(unit, scene) < 100 * RTOL
    unit.free()


@pytest.mark.thorough
@pytest.mark.parametrize("name", SCENES)
def test_derivatives_are_those_of_differences(name: str, tmp_path: Path) -> None:
    _, unit = make_unit(SCENES[name](), tmp_path, sources_only=False)
    unknowns = [key for key in unit.reference if key.startswith(("der(", "member_", "node_position."))]
    states = [key for key in unit.reference if key.startswith(("coordinate.", "velocity."))]
    others = [key for key in unit.reference if key.startswith("input.")]
    seed = np.random.default_rng(3).normal(size=len(states) + len(others))
    knowns = states + others
    start = unit.get(*knowns)
    values = []
    for sign in (1.0, -1.0):
        unit.good("Reset")
        assert unit.set_all(dict(zip(knowns, start + sign * 1e-7 * seed, strict=True))) == 0
        unit.start()
        values.append(unit.get(*unknowns))
    unit.good("Reset")
    unit.start()
    found = unit.derivative(unknowns, knowns, list(seed))
    differences = (values[0] - values[1]) / 2e-7
    scale = np.abs(found).max()
    assert scale > 1.0
    assert np.abs(found - differences).max() < 1e-5 * scale
    unit.free()


@pytest.mark.thorough
def test_radau_integrates_a_unit_with_stiff_bars(tmp_path: Path) -> None:
    document = tomllib.loads(LOOSE)
    document["classes"]["bar"]["spring_constant"] = 2e8
    scene, unit = make_unit(document, tmp_path, method="radau")
    model = compile_scene(scene, for_="simulate", method="radau")
    ours = simulate(model, T_END, samples=21, rtol=1e-6, method="radau")
    unit.start(1e-6)
    for times in (ours.time, None):
        if times is None:  # steps that are shorter than those of the integrator
            unit.good("Reset")
            unit.start(1e-6)
            times = np.linspace(0.0, T_END, 2001)
        for first, last in itertools.pairwise(times):
            assert unit.step(first, last - first) == 0, unit.messages
        names = [f"node_position.{node}.{axis}" for node in ours.node_name for axis in "xyz"]
        assert np.abs(unit.get(*names) - ours.node_position[-1].ravel()).max() < 1e-5
    unit.free()
