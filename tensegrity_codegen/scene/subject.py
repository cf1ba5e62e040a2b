"""The subject of a scene: nodes and members, or bodies and tendons."""

from typing import TypeAlias

from tensegrity_codegen.scene.assemble.assemble import SCENE, assemble
from tensegrity_codegen.scene.assemble.assemble_bodies import assemble_bodies
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.checks import check_instance
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.request import ModelRequest

Subject: TypeAlias = Structure | BodySystem


def assemble_scene(scene: Scene, where: str = "scene") -> tuple[Subject, ModelRequest]:
    """Return the Structure of `scene`, or its BodySystem if it has bodies, and its request."""
    check_instance(scene, Scene, "scene", SCENE)
    return assemble_bodies(scene, where) if has_angles(scene) else assemble(scene, where)


def has_angles(scene: Scene) -> bool:
    """Return whether bodies of a scene have minimal coordinates: it has tendons, or bars or fixed bodies."""
    kinds = {table.kind for table in scene.bodies.values()}
    stated = bool(scene.bodies) and find_formulation(scene.model.formulation).of_bodies
    return stated or bool(scene.tendons) or bool(kinds - {"rigid"})
