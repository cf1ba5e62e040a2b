"""The prism of three bars as the shipped scene has it, with other sides, bars or springs where asked."""

import functools
import tomllib
from importlib.resources import files
from typing import Any

import numpy as np

from tensegrity_codegen.pipeline.analyses import equilibrium_quantities
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.statics.c_equilibrium import EquilibriumSolver, SolvedPath
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.scene.subject import assemble_scene
from tensegrity_codegen.system.arrays import FloatArray

SCENE = "lin_prism"
PRINTED_SIDE = 0.41  # a [m]
PRINTED_LENGTH = 0.578  # L [m]
LOADS = -np.arange(11.0)  # F_3z of the tables [N]
TOPS = ("bar1_B", "bar2_B", "bar3_B")  # B_1, B_2, B_3
# Springs in the order of the tables' columns dL1..dL6, by their ends and by their names in the scene.
COLUMNS = ("B1B2", "B3B1", "B2B3", "A1B2", "A3B1", "A2B3")
SPRINGS = ("top1", "top3", "top2", "side1", "side3", "side2")


@functools.cache
def compile_prism(
    side: float = PRINTED_SIDE, bar_length: float = PRINTED_LENGTH, tension_only: bool = False
) -> CompiledModel:
    """Return the compiled prism; loads on its tops and spring constants may change at run time.

    side: distance of two anchors [m]; bar_length [m], whose mass goes with it; tension_only: springs that go
    slack, in place of the paper's linear ones.
    """
    text = files("tensegrity_codegen.scene").joinpath("examples", f"{SCENE}.toml").read_text(encoding="utf-8")
    document: dict[str, Any] = tomllib.loads(text)
    points = document["bodies"]["base"]["points"]
    for name, place in points.items():
        points[name] = [x * (side / PRINTED_SIDE) for x in place]
    for name, body in document["bodies"].items():
        if name != "base":
            body["length"] = bar_length
    document["classes"]["spring"]["tension_only"] = tension_only
    system, request = assemble_scene(parse_scene(document, SCENE), SCENE)
    wanted = request.wanting(
        *equilibrium_quantities(system, request),
        "member_extension",
        "bar_distance",
        solvers=("equilibrium",),
        parameters={
            "node_load": tuple(system.node_name.index(name) for name in TOPS),
            "spring_constant": tuple(range(system.n_members)),
        },
    )
    return build_library(system, wanted).load()


def place_load(top: int, force: Any) -> FloatArray:
    """Return the loads on all tops, (3, 3) [N], with one force (3,) on top 1, 2 or 3."""
    loads = np.zeros((len(TOPS), 3))
    loads[top - 1] = force
    return loads


def settle(model: CompiledModel, loads: FloatArray, **arguments: Any) -> SolvedPath:
    """Return the equilibria under loads (n, 3, 3) [N], found in C one from the other, beginning without load.

    Raises ConvergenceError where there is none.
    """
    solver = EquilibriumSolver(model)
    start = solver.find(tolerance=1e-11, **arguments).check()
    return solver.follow(loads, start.coordinate[0], tolerance=1e-11, **arguments).check()
