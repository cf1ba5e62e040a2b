"""Load paths on the ground, against closed forms of a block that slides and a frame that tips."""

import pytest

from tensegrity_codegen.runtime.paths.ground_path import follow_ground_path
from tensegrity_codegen.runtime.paths.model_path import build_path
from tensegrity_codegen.runtime.statics.equilibrium import equilibrium_quantities
from tests.cases import thorough
from tests.ground_cases import GRAVITY, make_block, make_ground
from tests.models import load
from tests.runtime.build import bar, make_structure


def test_a_block_slides_at_its_friction() -> None:
    """F = mu m g."""
    block = make_block([0.0, 0.0, 0.0])
    model = load(block, *equilibrium_quantities("node_position"), parameters={"node_load": (0,)})
    found = follow_ground_path(build_path(model, [[1.0, 0.0, 0.0]]), most=10.0)
    assert found.status == "stopped"
    assert found.events[-1].kind == "slides"
    assert found.events[-1].load_factor == pytest.approx(0.5 * GRAVITY, rel=1e-6)
    assert follow_ground_path(build_path(model, [[1.0, 0.0, 0.0]]), most=4.0).status == "completed"


@pytest.mark.parametrize(("friction", "end", "push"), [(2.0, "tips", 0.5), *thorough((0.3, "slides", 0.3))])
def test_a_frame_of_stiff_bars_slides_or_tips_about_its_foot(friction: float, end: str, push: float) -> None:
    """F = mu m g, or F h = m g b of a triangle, b from its centre to the foot: 3 kg, 0.5 m, 1 m high."""
    corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.0, 1.0]]
    members = [bar(i, j, length, 1e6) for i, j, length in ((0, 1, 1.0), (0, 2, 1.25**0.5), (1, 2, 1.25**0.5))]
    frame = make_structure(corners, members, gravity=(0.0, 0.0, -GRAVITY), axes="xz")
    stiff = {"stiffness": 1e6, "stick_stiffness": 1e6, "friction": friction, "stick_damping": 1e3}
    frame = frame.with_changes(ground=make_ground(3, **stiff))
    model = load(frame, *equilibrium_quantities("node_position"), parameters={"node_load": (2,)})
    found = follow_ground_path(build_path(model, [[1.0, 0.0]]), most=30.0)
    assert found.status == "stopped"
    assert found.events[-1].kind == end
    assert found.events[-1].load_factor == pytest.approx(3 * GRAVITY * push, rel=1e-4)
