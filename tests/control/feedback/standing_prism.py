"""A prism of three bars that stands on the ground by its weight, a winch in each of its nine cables."""

from pathlib import Path

import numpy as np

from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.model.model import CompiledModel
from tests.codegen.quickly import without_optimisation

CABLES = tuple(range(3, 12))
Q = np.concatenate([np.full(18, 1e4), np.full(18, 4.0)])
R = np.full(9, 1e4)
SCENE = """
name = "standing"
gravity = [0, 0, -9.81]

[classes.bar]
kind = "bar"
spring_constant = 2e5
damping = 5
mass = 0.1
radius = 0.006

[classes.cable]
kind = "cable"
spring_constant = 2000
damping = 2

[shape]
kind = "prism"
bars = 3
bottom_radius = 0.15
top_radius = 0.12
height = 0.30
node_mass = 0.02
prestress = 20

[ground]
stiffness = 2e4
restitution = { value = 0.5, speed = 1.0 }
friction = 0.5
""" + "".join(
    f'\n[[actuators]]\nname = "w_{part}{k}"\nmembers = "{part}{k}"\nrate = 0.1\n'
    for part in ("bottom", "top", "vertical")
    for k in (1, 2, 3)
)


def build_standing(folder: Path, change: tuple[str, str] = ("", "")) -> CompiledModel:
    """Return the model; change: a text of the scene, and what stands in its place."""
    text = SCENE.replace(*change) if change[0] else SCENE
    path = folder / "standing.toml"
    path.write_text(text, encoding="utf-8")
    with without_optimisation():
        return compile_scene(path, for_=("equilibrium", "control"))
