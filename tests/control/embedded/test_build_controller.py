"""What build_controller takes and refuses, and what it leaves in the folder."""

from dataclasses import replace
from pathlib import Path

import pytest

from tensegrity_codegen.control.embedded.build_controller import ControllerBundle, build_controller
from tensegrity_codegen.control.embedded.loaded import load_controller
from tensegrity_codegen.control.embedded.parts import ControllerCode
from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorLimits
from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.system.errors import (
    InvalidNameError,
    InvalidValueError,
    LibraryError,
    OutputError,
    UnknownNameError,
)
from tests.codegen.quickly import without_optimisation

EXAMPLES = Path(__file__).resolve().parents[3] / "tensegrity_codegen" / "scene" / "examples"
WINCH = '[[actuators]]\nname = "winch"\nmembers = "cord"\n'


def test_parts_of_another_model_sample_or_range_are_refused(
    model: CompiledModel, motion: Motion, gains: Gains, estimator: Estimator, tmp_path: Path
) -> None:
    out = tmp_path / "ctl"
    with pytest.raises(InvalidValueError, match="another model or motion"):
        build_controller(model, motion, replace(gains, actuators=("x",) * 9), out=out)
    with pytest.raises(InvalidValueError, match="another sample time"):
        build_controller(model, motion, gains, estimator=replace(estimator, sample=0.01), out=out)
    with pytest.raises(InvalidValueError, match="starts outside of the range"):
        build_controller(model, motion, gains, limits=ActuatorLimits(range=[0.26, 0.5]), out=out)
    with pytest.raises(InvalidValueError, match="too fast for an actuator"):
        build_controller(model, motion, gains, limits=ActuatorLimits(rate=0.01), out=out)
    with pytest.raises(InvalidValueError, match="no place in a controller"):
        build_controller(model, motion, gains, arguments={"m_top1": 0.01}, out=out)
    with pytest.raises(InvalidValueError, match="a whole number from 2 on"):
        build_controller(model, motion, gains, code=ControllerCode(knots=1), out=out)
    with pytest.raises(UnknownNameError, match="unknown precision"):
        build_controller(model, motion, gains, code=ControllerCode(precision="half"), out=out)
    with pytest.raises(InvalidNameError):
        build_controller(model, motion, gains, code=ControllerCode(name="not a name"), out=out)
    assert not out.exists()


def test_files_of_others_are_kept(
    bundle: ControllerBundle, model: CompiledModel, motion: Motion, gains: Gains, tmp_path: Path
) -> None:
    (tmp_path / "example.c").write_text("int mine;\n", encoding="utf-8")
    with pytest.raises(OutputError, match="of these names already"):
        build_controller(model, motion, gains, out=tmp_path, code=ControllerCode(library=False))
    assert [path.name for path in tmp_path.iterdir()] == ["example.c"]
    assert set(bundle.files) | {"SHA256SUMS"} <= {path.name for path in bundle.folder.iterdir()}


def test_folders_without_a_controller_are_refused(
    model: CompiledModel, motion: Motion, gains: Gains, tmp_path: Path
) -> None:
    with pytest.raises(LibraryError, match="no manifest of a controller"):
        load_controller(tmp_path)
    (tmp_path / "manifest.json").write_text("[1, 2]\n", encoding="utf-8")
    with pytest.raises(LibraryError, match="not the manifest of a controller"):
        load_controller(tmp_path)
    bare = build_controller(model, motion, gains, out=tmp_path / "ctl", code=ControllerCode(library=False))
    with pytest.raises(LibraryError, match="has no library"):
        bare.load()


def test_an_equilibrium_with_other_inputs_is_held_with_them(tmp_path: Path) -> None:
    scene = tmp_path / "lift.toml"
    text = (EXAMPLES / "two_nodes.toml").read_text(encoding="utf-8")
    scene.write_text('axes = "z"\n' + text + WINCH, encoding="utf-8")
    with without_optimisation():
        model = compile_scene(scene, for_=("equilibrium", "control"))
        found = find_equilibrium(model, arguments={"winch": 0.1})
        bundle = build_controller(model, found, out=tmp_path / "ctl", arguments={"winch": 0.1})
    controller = bundle.load()
    controller.init()
    status, rest = controller.step_state(0.0, [*found.coordinate, 0.0])
    structure = model.structure
    assert status == "ok"
    assert structure is not None
    assert rest == pytest.approx(structure.rest_length[:1] + 0.1, rel=1e-12)
    with pytest.raises(InvalidValueError, match="no place in a controller"):
        build_controller(model, found, out=tmp_path / "other", arguments={"node_load": [[0.0]]})
