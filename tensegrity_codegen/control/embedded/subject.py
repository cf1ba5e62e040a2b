"""What a controller is built for: a scene file or a compiled model, a motion or an equilibrium."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.control.feedback.design.linear_samples import build_rest
from tensegrity_codegen.pipeline.compile_scene import compile_scene, load_scene
from tensegrity_codegen.runtime.model.interface import Described
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.named_inputs import INPUT, merge_inputs
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.system.errors import InvalidValueError, LibraryError
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.request import ModelRequest

LEAST = ("member_length",)  # quantities of a description


@dataclass(frozen=True)
class _Description:
    """A model that is described but not compiled."""

    manifest: Manifest
    structure: Subject


def find_described(
    scene: str | Path | CompiledModel, motion: Motion | Equilibrium
) -> tuple[Described, ModelRequest]:
    """Return the model of a scene or a compiled one, and the request for nothing of it but its formulation.

    Raises what `load_scene` raises; LibraryError for a library that was loaded without its structure.
    """
    if isinstance(scene, CompiledModel):
        if scene.structure is None:
            raise LibraryError(
                "the model does not contain its structure",
                where=str(scene.path),
                given="a library that was loaded alone",
                allowed="a model of compile_scene, or the scene file",
            )
        manifest = scene.manifest
        return scene, ModelRequest((), formulation=manifest.formulation, emitter=manifest.emitter)
    structure, request = load_scene(scene)
    alone = ModelRequest(
        (), formulation=request.formulation, emitter=request.emitter, options=request.options
    )
    if isinstance(motion, Equilibrium):
        return compile_scene(scene, for_=("control",)), alone
    return _Description(emit(structure, replace(alone, quantities=LEAST)).manifest, structure), alone


def find_motion(
    model: Described, motion: Motion | Equilibrium, arguments: Mapping[str, Any] | None = None
) -> Motion:
    """Return the motion; an equilibrium as a motion that stays there. Raises what `build_rest` raises.

    arguments: inputs of an equilibrium; InvalidValueError for other parameters, which are constants in C, and
    for those of a motion, which has its own inputs.
    """
    given = merge_inputs(model.manifest, arguments)
    if isinstance(motion, Motion) and not given:
        return motion
    if isinstance(motion, Motion) or set(given) - {INPUT}:
        raise InvalidValueError(
            "these arguments have no place in a controller",
            where="arguments",
            given=", ".join(arguments or {}),
            allowed="inputs of an equilibrium" if isinstance(motion, Equilibrium) else "none with a Motion",
            hint="state loads and stiffnesses in the scene",
        )
    if not isinstance(motion, Equilibrium) or not isinstance(model, CompiledModel):
        raise InvalidValueError(
            "not a motion", where="motion", given=type(motion).__name__, allowed="a Motion or an Equilibrium"
        )
    return build_rest(model, motion, arguments=given)
