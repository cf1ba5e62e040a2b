"""The example scene prism12: its equilibrium, actuators and limits; with and without masses."""

import tomllib
from importlib.resources import files

import numpy as np
import pytest

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.checks.scene_warnings import find_warnings
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.scene.shapes.selfstress import equilibrium_matrix
from tensegrity_codegen.structure.structure import Structure

TEXT = files("tensegrity_codegen.scene").joinpath("examples", "prism12.toml").read_text(encoding="utf-8")


def read(text: str) -> tuple[Structure, tuple[str, ...]]:
    structure, request = assemble(parse_scene(tomllib.loads(text)))
    return structure, request.quantities


@pytest.mark.parametrize("with_masses", [True, False])
def test_it_starts_in_equilibrium_within_its_limits(with_masses: bool) -> None:
    lines = [line for line in TEXT.splitlines() if with_masses or "node_mass" not in line]
    structure, quantities = read("\n".join(lines))
    assert ("acceleration" in quantities) == with_masses
    tension = structure.static_tension()
    residual = equilibrium_matrix(structure.node_position, structure.connectivity) @ tension
    np.testing.assert_allclose(residual, 0.0, atol=1e-9)
    cables = ~structure.is_bar
    assert (cables.sum(), tension[cables].max()) == (12, pytest.approx(20.0, abs=1e-9))
    assert tension[cables].min() == pytest.approx(2.459, abs=5e-4)
    assert find_warnings(structure) == ()


def test_its_motors_act_on_the_cables_between_the_rings() -> None:
    structure, _ = read(TEXT)
    names = [structure.member_name[e] for item in structure.actuators for e in item.members]
    assert names == [*(f"vertical{k}" for k in (1, 2, 3)), *(f"opposite{k}" for k in (1, 2, 3))]
    assert structure.limits.clearance == 0.002
    assert (structure.limits.least_tension[~structure.is_bar] == 1.0).all()
