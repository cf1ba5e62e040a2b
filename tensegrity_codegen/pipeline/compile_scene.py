"""The whole way, one function an arrow.

scene.toml --read_scene--> Scene --assemble_scene--> Structure or BodySystem, ModelRequest
  --emit--> C source, manifest --compile--> library in the cache --load--> CompiledModel --> results
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tensegrity_codegen.pipeline.analyses import Needs, balance_energy, want_analyses
from tensegrity_codegen.pipeline.build_library import MANY_CALLS, build_library
from tensegrity_codegen.pipeline.settle import choose_request
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.scene.read import name_source, read_scene
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.scene.subject import Subject, assemble_scene
from tensegrity_codegen.structure.applied_inputs import actuate_members
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.checks import check_instance, check_names, check_positive, check_whole
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest


def load_scene(path: str | Path | Mapping[str, Any] | Scene) -> tuple[Subject, ModelRequest]:
    """Read a scene.

    Parameters
    ----------
    path : str, Path, mapping or Scene
        Scene file (TOML), or the scene itself, as for `read_scene`.

    Returns
    -------
    structure : Structure or BodySystem
        The structure that the scene describes.
    request : ModelRequest
        The requested quantities and options.

    Raises
    ------
    SceneError
        The file cannot be read, or a key or value is wrong; the message names file, key and value.

    Examples
    --------
    >>> from tensegrity_codegen import load_scene
    >>> structure, request = load_scene("prism.toml")
    >>> structure.n_nodes, structure.n_members, request.formulation
    (6, 12, 'node_position')
    """
    return assemble_scene(read_scene(path), name_source(path))


def load_nodes(path: str | Path) -> Structure:
    """Read a scene of nodes and members; raises FormulationError for a scene of bodies."""
    subject, _ = load_scene(path)
    if not isinstance(subject, Structure):
        problem = "this needs a scene of nodes and members"
        allowed = "scenes with the sections nodes and members, or a shape"
        raise FormulationError(problem, where=f"{path}: bodies", given="a scene of bodies", allowed=allowed)
    return subject


def compile_scene(
    path: str | Path | Mapping[str, Any] | Scene,
    *,
    for_: Iterable[str] = (),
    method: str = "",
    rtol: float = 1e-6,
    quantities: tuple[str, ...] = (),
    integrators: tuple[str, ...] = (),
    solvers: tuple[str, ...] = (),
    parameters: Mapping[str, tuple[int, ...]] | None = None,
    actuate: Sequence[str] = (),
) -> CompiledModel:
    """Read a scene, generate and compile its library, and load it.

    Parameters
    ----------
    path : str, Path, mapping or Scene
        Scene file (TOML), or the scene itself, as for `read_scene`.
    for_ : str or tuple of str
        Analyses for which the model is used: ``"simulate"``, ``"simulate_batch"``, ``"step"`` (of a
        `Stepper`), ``"equilibrium"``, ``"equilibria"``, ``"sensitivity"``, ``"linearize"``, ``"load_path"``,
        ``"analyse"``, ``"plan"``, ``"time_motion"``, ``"control"``, ``"derivatives"`` of quantities,
        ``"motion_derivatives"``. Their quantities, integrators with events and (for ``"control"``) run-time
        parameters are added. Where they are none of motions and the scene's formulation does not serve them,
        the library is in node positions, or has rigid bars.
    method : str
        Method of the simulations, as for `simulate`; it decides which integrators the library has.
    rtol : float
        Relative tolerance of the simulations, as for `simulate`.
    quantities : tuple of str
        Quantities in addition to those of the scene and of the analyses.
    integrators : tuple of str
        Integrators in addition, for example ``("rk853", "rk4")``; their steps end at events if the scene
        names some, or `for_` an analysis of motions.
    solvers : tuple of str
        Solvers in addition to those of the scene.
    parameters : mapping of str to tuple of int, optional
        Run-time parameters in addition to those of the scene: name -> indices of nodes or members.
    actuate : sequence of str
        Members that get an actuator each, of their names, beside the actuators of the scene: names of
        members, groups and classes, ``"cables"`` or ``"all"``.

    Returns
    -------
    CompiledModel
        The loaded library; it comes from the cache if it was built before.

    Raises
    ------
    UnknownNameError
        An unknown analysis, method or quantity.
    SceneError
        The scene has an error.
    FormulationError
        The formulation or emitter does not support the request.
    CompilerMissingError, CompileError
        No C compiler was found, or it failed.

    Examples
    --------
    >>> from tensegrity_codegen import compile_scene
    >>> model = compile_scene("two_nodes.toml")
    >>> model.compute("member_tension", coordinate=[0.0, 0.0, -1.5])
    array([40.])
    """
    check_instance(method, str, "method", "a text")
    check_positive(rtol, "rtol")
    check_instance(parameters, (Mapping, type(None)), "parameters", "a dictionary: name -> indices, or None")
    for name, indices in (parameters or {}).items():
        check_instance(indices, (tuple, list), f"parameters.{name}", "indices of nodes or members")
        for index in indices:
            check_whole(index, f"parameters.{name}", 0)
    structure, request = load_scene(path)
    chosen = check_names(actuate, "actuate")
    if chosen:
        structure, _ = actuate_members(structure, chosen)
    analyses = check_names(for_, "for_")
    besides = Needs(
        check_names(quantities, "quantities"),
        check_names(integrators, "integrators"),
        parameters or {},
        solvers=check_names(solvers, "solvers"),
    )
    if "simulate" in analyses and set(analyses) <= {"simulate", "equilibrium"}:
        structure = balance_energy(structure, request)
    request = choose_request(structure, request, analyses)
    request = want_analyses(structure, request, analyses, method=method, rtol=rtol, besides=besides)
    return build_library(structure, request, calls=MANY_CALLS).load()
