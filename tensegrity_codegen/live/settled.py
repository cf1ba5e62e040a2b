"""Structures at their equilibrium, for pictures and pages."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tensegrity_codegen.pipeline.settle import find_settled
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.plan_result import PlanResult
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.scene.read import name_source, read_scene
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.scene.subject import Subject, assemble_scene
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.request import ModelRequest


def check_follow(follow: bool, subject: Any) -> None:
    """Raise InvalidValueError where something that does not move is to be followed."""
    if follow and not isinstance(subject, Trajectory | PlanResult):
        raise InvalidValueError(
            "nothing moves that could be followed", where="follow", given=True,
            allowed="a Trajectory or a PlanResult as the subject",
        )  # fmt: skip


def settle_drawable(subject: Any) -> tuple[Subject, Equilibrium]:
    """Return a scene, structure or model at its equilibrium, and the equilibrium.

    Raises InvalidValueError for anything else, ConvergenceError where there is no stable equilibrium.
    """
    found, request = find_request(subject)
    return find_settled(found, request)


def find_request(subject: Any) -> tuple[Subject, ModelRequest]:
    """Return structure and request of a scene, structure or model; raises InvalidValueError for others."""
    if isinstance(subject, str | Path | Mapping | Scene):
        return assemble_scene(read_scene(subject), name_source(subject))
    if isinstance(subject, CompiledModel) and subject.structure is not None:
        return subject.structure, _guess_request(subject.structure, subject.manifest.rigid_bar)
    if isinstance(subject, Structure | BodySystem):
        return subject, _guess_request(subject, ())
    raise InvalidValueError(
        "only a scene, structure or model has an equilibrium to be found",
        where="settle",
        given=type(subject).__name__,
        allowed="a scene, Structure, BodySystem or CompiledModel of `compile_scene`",
        hint="an Equilibrium is drawn as it is",
    )


def _guess_request(subject: Subject, rigid_bar: tuple[str, ...]) -> ModelRequest:
    """Return a request in the formulation for a structure, with these bars rigid."""
    if isinstance(subject, BodySystem):
        return ModelRequest((), formulation="bodies")
    if not subject.is_rigid.any() and not rigid_bar:
        return ModelRequest(())
    every = len(rigid_bar) > int(subject.is_rigid.sum())
    return ModelRequest((), formulation="rigid_bar", options={"bars": "all"} if every else {})
