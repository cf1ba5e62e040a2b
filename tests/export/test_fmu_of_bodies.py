"""Units of rigid bodies: positions of their points, and what these depend on."""

from pathlib import Path

import numpy as np

from tensegrity_codegen.export.export_fmu import export_fmu
from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tests.codegen.quickly import without_optimisation
from tests.export.importer import Unit2
from tests.hung_disk import SCENE


def test_points_of_bodies_are_where_simulate_has_them(tmp_path: Path) -> None:
    with without_optimisation():
        export_fmu(SCENE, tmp_path / "hung.fmu")
        model = compile_scene(SCENE, for_="simulate")
    unit = Unit2(tmp_path / "hung.fmu", tmp_path / "unit", "cs")
    unit.start(1e-9)
    for k in range(4):
        unit.step(0.05 * k, 0.05)
    wanted = simulate(model, 0.2, samples=2, rtol=1e-10)
    names = [f"node_position.disk_p1.{axis}" for axis in "xyz"]
    node = model.manifest.node_name.index("disk_p1")
    np.testing.assert_allclose(unit.get(*names), wanted.node_position[-1, node], atol=1e-7)
    # By a state of one corner: its weight in the point.
    (body,) = model.manifest.body_places
    weight = np.array(body.weights[body.point.index(node)])
    corners = [f"coordinate.disk_corner{k + 1}_x" for k in range(4)]
    for corner, value in zip(corners, weight, strict=True):
        np.testing.assert_allclose(unit.derivative(names[:1], [corner], [1.0]), [value], atol=1e-12)
    unit.free()
