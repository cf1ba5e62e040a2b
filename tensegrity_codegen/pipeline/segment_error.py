"""The discretisation error of cables in segments at rest: n and 2 n segments, extrapolated."""

from dataclasses import replace

from tensegrity_codegen.pipeline.analyses import find_needs
from tensegrity_codegen.pipeline.build_library import FEW_CALLS, build_library
from tensegrity_codegen.pipeline.settle import with_statics
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium, SegmentError
from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.describe import describe_structure
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.structure.pieces import find_chains, measure_chain
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.checks import check_instance
from tensegrity_codegen.tables.request import ModelRequest


def add_segment_error(
    found: Equilibrium, request: ModelRequest | None = None, *, compiler: str | None = None
) -> Equilibrium:
    """Return an equilibrium with the discretisation error of its cables in segments.

    Parameters
    ----------
    found : Equilibrium
        With its structure, as `find_equilibrium` returns it, with loads and inputs. Other run-time parameters
        must be those of the scene.
    request : ModelRequest, optional
        Its formulation and options are used; by default those that suit the structure.
    compiler : str, optional
        As for build_library.

    Returns
    -------
    Equilibrium
        The same with `segments`, one `SegmentError` for each cable in segments; itself where there is none.

    Raises
    ------
    ConvergenceError, UnstableError
        No equilibrium with twice as many segments was found: the error is not known.
    FormulationError, CompilerMissingError, CompileError
        As for build_library.

    Notes
    -----
    A chain of n segments errs by O(1 / n^2), so that x_n and x_2n give (4 x_2n - x_n) / 3 (Richardson).

    Examples
    --------
    >>> from tensegrity_codegen import add_segment_error, compile_scene, find_equilibrium
    >>> line = {"kind": "cable", "nodes": ["a", "b"], "axial_stiffness": 1e3, "rest_length": 10.5}
    >>> model = compile_scene({
    ...     "name": "span", "axes": "xz", "gravity": [0, -10],
    ...     "nodes": {"a": {"position": [0, 0], "anchored": True},
    ...               "b": {"position": [10, 0], "anchored": True}},
    ...     "members": {"line": line | {"mass_per_length": 0.1, "segments": 16}},
    ... }, for_="equilibrium")
    >>> found = add_segment_error(find_equilibrium(model)).segments[0]
    >>> round(found.sag, 3), round(found.extrapolated_sag, 3)  # the catenary: 1.52250 m
    (1.525, 1.522)
    """
    check_instance(found, Equilibrium, "found", "what find_equilibrium(...) returns")
    if request is not None:
        check_instance(request, ModelRequest, "request", "ModelRequest(...), or None")
    structure = found.structure
    if not isinstance(structure, Structure) or not found.is_found or not find_chains(structure):
        return found
    load = structure.node_load if found.node_load is None else found.node_load
    fine, fine_request = _halve(structure.with_changes(node_position=found.node_position, node_load=load))
    statics = with_statics(fine, request or fine_request)
    needs = find_needs("equilibrium", fine, statics).alone(replace(statics, parameters={}))
    model = build_library(fine, needs, compiler=compiler, calls=FEW_CALLS).load()
    finer = find_equilibrium(model, arguments={} if found.input is None else {"input": found.input})
    errors = []
    for name, rows in find_chains(structure).items():
        coarse = measure_chain(structure, rows, found.node_position, found.member_tension)
        two = measure_chain(fine, find_chains(fine)[name], finer.node_position, finer.member_tension)
        # Richardson: the error of a chain falls with the square of the length of its segments.
        tension, sag = ((4 * b - a) / 3 for a, b in zip(coarse, two, strict=True))
        errors.append(SegmentError(name, len(rows), coarse[0], tension, coarse[1], sag))
    return replace(found, segments=tuple(errors))


def _halve(structure: Structure) -> tuple[Structure, ModelRequest]:
    """Return the structure with each segment of its cables cut in two, and a request that suits it."""
    document = describe_structure(structure.with_changes(actuators=()))
    for e in {e for rows in find_chains(structure).values() for e in rows}:
        document["members"][structure.member_name[e]]["segments"] = 2
    sections = {key: value for key, value in document.items() if key not in ("sensors", "limits")}
    return assemble(parse_scene(sections, structure.name), structure.name)
