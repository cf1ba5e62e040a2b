"""What `check` passes can be built, and what `build` refuses `check` refuses with the same words."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tensegrity_codegen.cli.app import app

MAST = """
name = "mast"
gravity = [0, 0, -9.81]
[model]
{model}
[classes.tube]
kind = "bar"
{stiffness}
[classes.rope]
kind = "cable"
spring_constant = 500
prestress = 20
damping = 0.5
[nodes]
foot = {{ position = [0, 0, 0], anchored = true }}
head = {{ position = [0, 0, 1.2], mass = 0.2 }}
a = {{ position = [1, 0, 0], anchored = true }}
b = {{ position = [-0.5, 1, 0], anchored = true }}
c = {{ position = [-0.5, -1, 0], anchored = true }}
[members]
mast = {{ class = "tube", nodes = ["foot", "head"] }}
s1 = {{ class = "rope", nodes = ["head", "a"] }}
s2 = {{ class = "rope", nodes = ["head", "b"] }}
s3 = {{ class = "rope", nodes = ["head", "c"] }}
"""
RIGID, STIFF = "", "axial_stiffness = 1e5"


def answer(verb: str, scene: Path) -> tuple[int, dict[str, object]]:
    result = CliRunner().invoke(app, [verb, str(scene), "--json"])
    return result.exit_code, json.loads(result.stdout)


def write(folder: Path, model: str, stiffness: str) -> Path:
    scene = folder / "mast.toml"
    scene.write_text(MAST.format(model=model, stiffness=stiffness))
    return scene


@pytest.mark.parametrize(
    ("model", "stiffness", "given"),
    [
        ('quantities = ["multiplier"]', STIFF, "'multiplier'"),
        ('quantities = ["rest_length_jacobian"]', RIGID, "'rest_length_jacobian'"),
        ('quantities = ["bar_distance"]', STIFF, None),
        ('quantities = ["parameter_jacobian"]', STIFF, None),
        ('quantities = ["acceleration"]\nemitter = "table"', RIGID, "'acceleration'"),
        ('quantities = ["multiplier"]\nformulation = "node_distance"', STIFF, "'connected'"),
        (
            'quantities = ["acceleration"]\nintegrators = ["radau"]\nformulation = "node_distance"',
            STIFF,
            None,
        ),
        ('quantities = ["member_tension"]\nintegrators = ["rk4"]', STIFF, "'rk4'"),
        ('quantities = ["member_tension"]\nsolvers = ["equilibrium"]', STIFF, None),
        ('quantities = ["acceleration"]\nkeep = ["energy"]\nintegrators = ["rk54"]', STIFF, None),
        ('quantities = ["member_tension"]\nprecision = "single"\nintegrators = ["radau"]', STIFF, None),
    ],
)
def test_check_refuses_what_build_refuses(
    tmp_path: Path, model: str, stiffness: str, given: str | None
) -> None:
    scene = write(tmp_path, model, stiffness)
    (code, checked), (also, built) = answer("check", scene), answer("build", scene)
    assert (code, also) == (2, 2)
    same = ("error", "problem", "where", "given", "allowed", "hint")
    assert [checked[key] for key in same] == [built[key] for key in same]
    assert given is None or checked["given"] == given


def test_rigid_bars_have_reactions_and_matrices(tmp_path: Path) -> None:
    wanted = ("support_reaction", "damping_matrix", "equilibrium_matrix", "material_stiffness")
    model = f"quantities = {json.dumps([*wanted, 'geometric_stiffness'])}"
    scene = write(tmp_path, model, RIGID)
    assert answer("check", scene)[0] == answer("build", scene)[0] == 0
