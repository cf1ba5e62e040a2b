"""Units in Ecos, an importer in C++: the motion of `simulate`, and two units that are coupled."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.export.export_fmu import export_fmu
from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tests.export.scenes import write_loose

pytestmark = pytest.mark.peers


def load_ecos() -> Any:
    try:
        import ecospy
    except (ImportError, OSError) as error:  # its library needs libtbb.so.12
        pytest.skip(f"needs ecospy and libtbb12 (pip install ecospy, apt install libtbb12): {error}")
    return ecospy


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_two_coupled_units_move_as_in_simulate(fmi: str, tmp_path: Path) -> None:
    ecos = load_ecos()
    scene, out = write_loose(tmp_path), tmp_path / "loose.fmu"
    export_fmu(scene, out, fmi=fmi, kind="cs", rtol=1e-8)
    ours = simulate(compile_scene(scene, for_="simulate"), 0.3, samples=31, rtol=1e-8)
    with ecos.EcosSimulationStructure() as structure:
        for name in ("one", "two"):
            structure.add_model(name, str(out))
        structure.make_real_connection("one::member_tension.bar1", "two::input.push")
        with ecos.EcosSimulation(structure=structure, step_size=0.01) as simulation:
            simulation.init()
            for row in ours.node_position[:, 3]:
                found = [simulation.get_real(f"one::node_position.t1.{axis}") for axis in "xyz"]
                assert np.abs(np.array(found) - row).max() < 1e-6
                simulation.step()
            pushed = simulation.get_real("two::node_position.t2.y")
            assert abs(pushed - simulation.get_real("one::node_position.t2.y")) > 1e-4
