"""Stress and buckling margin: closed forms in every formulation and emitter; members without section."""

import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tensegrity_codegen.cli.app import app
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.outline import outline_tendons
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.runtime.build import prism

EXAMPLES = Path(__file__).resolve().parents[3] / "tensegrity_codegen/scene/examples"
WANTED = ("member_tension", "member_stress", "buckling_margin")


def tubes() -> Structure:
    """A prism with tubes for bars and round cables, tight enough to compress the bars."""
    structure = prism(strain=0.2, bar_stiffness=2e5)
    return structure.with_changes(
        radius=np.where(structure.is_bar, 0.01, 0.002),
        inner_radius=np.where(structure.is_bar, 0.008, 0.0),
        rest_length=np.where(structure.is_bar, structure.rest_length * 1.0005, structure.rest_length),
    )


def check_results(structure: Structure, results: dict[str, np.ndarray], stiffness: np.ndarray) -> None:
    """Compare stress and margin with those of the tensions; stiffness: E A of all members [N]."""
    outer = structure.radius**2
    inner = np.zeros_like(outer) if structure.inner_radius is None else structure.inner_radius**2
    area, moment = np.pi * (outer - inner), np.pi / 4 * (outer**2 - inner**2)
    tension = results["member_tension"]
    assert results["member_stress"] == pytest.approx(tension / area, rel=1e-12)
    load = np.pi**2 * stiffness / area * moment / structure.member_length() ** 2
    with np.errstate(divide="ignore"):
        margin = np.where(tension < 0, np.minimum(load / np.abs(tension), 1e6), 1e6)
    assert results["buckling_margin"] == pytest.approx(margin, rel=1e-12)


@pytest.mark.parametrize(
    ("formulation", "emitter"),
    [
        *product(("node_position",), ("unrolled", "table")),
        ("rigid_bar", "unrolled"),
        *thorough(("node_distance", "unrolled")),
    ],
)
def test_stress_and_margin_follow_from_the_tension(formulation: str, emitter: str) -> None:
    structure = tubes()
    options = {"bars": "all"} if formulation == "rigid_bar" else {}
    request = ModelRequest(WANTED, formulation=formulation, emitter=emitter, options=options)
    model = build_library(structure, request).load()
    results = {name: model.compute(name) for name in WANTED}
    assert (results["member_tension"][structure.is_bar] < 0).all()
    assert (results["buckling_margin"][structure.is_bar] < 1e6).all()
    check_results(structure, results, structure.mu * structure.rest_length)


def test_batches_have_the_same_stress() -> None:
    model = build_library(tubes(), ModelRequest(WANTED, batch_width=4)).load()
    start = model.nominal("coordinate")
    for name in WANTED[1:]:
        found = model.compute_batch(name, coordinate=np.stack([start] * 5))
        assert found == pytest.approx(np.stack([model.compute(name)] * 5), rel=1e-13)


def test_tendons_of_bodies_have_a_stress() -> None:
    system, _ = load_scene(EXAMPLES / "lin_prism.toml")
    assert isinstance(system, BodySystem)
    system = system.with_changes(radius=np.full(system.n_members, 0.003))
    model = build_library(system, ModelRequest(WANTED, formulation="bodies")).load()
    results = {name: model.compute(name) for name in WANTED}
    check_results(outline_tendons(system), results, system.mu * system.rest_length)


@pytest.mark.parametrize("emitter", ["unrolled", "table"])
@pytest.mark.parametrize("quantity", WANTED[1:])
def test_members_without_a_section_are_named(quantity: str, emitter: str) -> None:
    structure = tubes()
    bare = structure.with_changes(
        radius=np.where(np.arange(12) == 0, 0.0, structure.radius), inner_radius=None
    )
    with pytest.raises(FormulationError, match="needs the section") as caught:
        build_library(bare, ModelRequest((quantity,), emitter=emitter))
    assert "e0 without radius" in str(caught.value)
    assert "give radius [m]" in caught.value.hint


def test_cables_need_no_section_for_a_margin() -> None:
    structure = tubes()
    radius = np.where(structure.is_bar, structure.radius, 0.0)
    model = build_library(structure.with_changes(radius=radius), ModelRequest(("buckling_margin",))).load()
    assert (model.compute("buckling_margin")[~structure.is_bar] == 1e6).all()


def test_bars_without_stiffness_have_no_margin() -> None:
    structure = tubes()
    rigid = structure.with_changes(
        spring_constant=np.where(structure.is_bar, 0.0, structure.spring_constant),
        rest_length=np.where(structure.is_bar, structure.member_length(), structure.rest_length),
    )
    with pytest.raises(FormulationError, match="needs the stiffness"):
        build_library(rigid, ModelRequest(("buckling_margin",), formulation="rigid_bar"))


@pytest.mark.parametrize(("radius", "code"), [("radius = 0.002\n", 0), ("", 2)])
def test_the_command_line_builds_them_or_names_the_section(tmp_path: Path, radius: str, code: int) -> None:
    scene = (EXAMPLES / "two_nodes.toml").read_text(encoding="utf-8")
    path = tmp_path / "scene.toml"
    path.write_text(scene.replace("spring_constant = 80", f"{radius}spring_constant = 80"), encoding="utf-8")
    result = CliRunner().invoke(app, ["build", str(path), "-q", "member_stress", "--json"])
    assert result.exit_code == code
    if code == 0:
        assert "member_stress" in json.loads(result.stdout)["functions"]
    else:
        assert "needs the section" in result.stderr
