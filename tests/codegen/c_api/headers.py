"""Headers of three libraries that together have every kind of declaration, made once for all tests."""

import functools
from dataclasses import replace

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.integrators.integrators import INTEGRATORS
from tensegrity_codegen.codegen.integrators.solvers import SOLVERS
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tests.codegen.subjects import everything
from tests.models import EXAMPLES


@functools.cache
def prism() -> str:
    """What the example scene asks for, pairs of bars and events."""
    structure, request = load_scene(EXAMPLES / "prism.toml")
    wanted = (*request.quantities, "bar_distance")
    return emit(structure, replace(request, quantities=wanted, events=("auto",))).files["prism.h"]


@functools.cache
def braced() -> str:
    """All integrators, batches, profiles, all quantities."""
    structure, request = everything()
    return emit(structure, replace(request, batch_width=8, integrators=tuple(INTEGRATORS))).files["braced.h"]


@functools.cache
def lin_prism() -> str:
    """Bodies, with the solver of equilibria."""
    structure, request = load_scene(EXAMPLES / "lin_prism.toml")
    wanted = ("potential_energy", "coordinate_force", "tangent_stiffness", "acceleration", "total_energy")
    loads = {"node_load": tuple(range(structure.n_nodes))}
    request = request.wanting(*wanted, integrators=("rk853",), solvers=tuple(SOLVERS), parameters=loads)
    return emit(structure, replace(request, events=("auto",))).files["lin_prism.h"]


HEADERS = {"prism": prism, "braced": braced, "lin_prism": lin_prism}
