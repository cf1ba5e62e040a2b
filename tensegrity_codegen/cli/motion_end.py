"""The end of a motion as a scene, which `simulate --scene-out` writes."""

from pathlib import Path
from typing import TYPE_CHECKING

from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.scene.names import name_list
from tensegrity_codegen.structure.applied_inputs import add_inputs_to_rest_length
from tensegrity_codegen.structure.bodies import BodySystem

if TYPE_CHECKING:
    from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory


def write_end(output: Output, scene: Path, motion: "Trajectory", out: Path, *, overwrite: bool) -> None:
    """Write a scene as its motion ends: places, velocities, and rest lengths with the inputs there."""
    from tensegrity_codegen.pipeline.compile_scene import load_scene
    from tensegrity_codegen.scene.describe_bodies import describe_subject
    from tensegrity_codegen.scene.write import write_scene

    subject, request = load_scene(scene)
    values = {} if motion.input is None else dict(zip(motion.input_name, motion.input[-1], strict=True))
    subject = subject.with_changes(rest_length=add_inputs_to_rest_length(subject, values))
    is_bodies = isinstance(subject, BodySystem)
    names = ("coordinate", "velocity") if is_bodies else ("node_position", "node_velocity")
    subject = subject.with_changes(**{name: getattr(motion, name)[-1] for name in names})
    write_scene(describe_subject(subject, request), out, overwrite=overwrite)
    lost = [name for name in motion.internal_name if "_stick" not in name]  # feet stick again where they are
    if lost:
        output.warn(f"{out} begins without internal states: {name_list(lost, most=10)}")
