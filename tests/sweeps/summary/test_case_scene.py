"""The scene of a case, written and read again, is the structure that the sweep computed."""

from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.scene.write import write_scene
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.sweeps.apply.assembler import build_assembler, read_scene_document
from tensegrity_codegen.sweeps.cases.cases import Axis, Cases
from tensegrity_codegen.sweeps.summary.results import build_case_scene
from tests.sweeps.store.conftest import make_contents

pytest.importorskip("zarr")
EXAMPLES = Path(__file__).resolve().parents[3] / "tensegrity_codegen" / "scene" / "examples"
FIELDS = ("rest_length", "spring_constant", "axial_stiffness", "damping", "node_load", "gravity")
NODES = ("node_position", "node_velocity", "node_mass")
BODIES = ("coordinate", "velocity")
CASES = {
    "numbers of the file": ("prism", {"shape.height": 0.31, "classes.cable.spring_constant": 180.0}),
    "nodes of the shape": ("prism", {"nodes.t1.position[2]": 0.32, "loads[0].force[2]": -1.5}),
    "values of members and nodes": (
        "prism", {"rest_length.vertical1": 0.2, "node_velocity.t1[0]": 0.1, "node_load.t2[1]": -0.5},
    ),
    "moved away": ("two_nodes", {"node_position.n1[0]": 1000.0, "node_position.n2[0]": 1000.0}),
    "a planar scene": ("planar", {"gravity[1]": -5.0}),
    "inputs": ("prism12", {"input.v1": -0.003, "shape.height": 0.31}),
    "bodies": ("lin_prism", {"classes.spring.spring_constant": 150.0}),
    "values of bodies": ("lin_prism", {"rest_length.side1": 0.3}),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_the_scene_of_a_case_is_that_structure(name: str, tmp_path: Path) -> None:
    from tensegrity_codegen.sweeps.store.store import create_store

    example, keys = CASES[name]
    document, _ = read_scene_document(EXAMPLES / f"{example}.toml")
    cases = Cases(tuple(Axis(key, np.array([value])) for key, value in keys.items()))
    create_store(tmp_path / "a.zarr", make_contents(cases, 4, scene=document))
    write_scene(build_case_scene(tmp_path / "a.zarr", keys), tmp_path / "case.toml")
    found, _ = load_scene(tmp_path / "case.toml")
    expected = build_assembler(document, list(keys)).assemble(list(keys.values())).subject
    assert found.member_name == expected.member_name
    for field in (*FIELDS, *(BODIES if isinstance(expected, BodySystem) else NODES)):
        np.testing.assert_allclose(
            getattr(found, field), getattr(expected, field), rtol=1e-14, atol=1e-15, err_msg=field
        )
