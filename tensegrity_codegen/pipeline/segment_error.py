"""The discretisation error of cables in segments at rest: n and 2 n segments, extrapolated."""

from dataclasses import replace

from tensegrity_codegen.pipeline.analyses import find_needs
from tensegrity_codegen.pipeline.build_library import FEW_CALLS, build_library
from tensegrity_codegen.pipeline.settle import with_statics
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium, SegmentError
from tensegrity_codegen.structure.segments import find_chains, halve_segments, measure_chains
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.formulations import choose_formulation
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
    structure = found.structure
    if not isinstance(structure, Structure) or not found.is_found or not find_chains(structure):
        return found
    if request is None:
        formulation = choose_formulation(rigid_bars=bool(structure.is_rigid.any())).name
        request = ModelRequest((), formulation=formulation)
    # The same loads and inputs, from the positions that were found.
    load = structure.node_load if found.node_load is None else found.node_load
    fine = halve_segments(structure.with_changes(node_position=found.node_position, node_load=load))
    statics = with_statics(fine, request)
    wanted = find_needs("equilibrium", fine, statics).alone(replace(statics, parameters={}, integrators=()))
    model = build_library(fine, wanted, compiler=compiler, calls=FEW_CALLS).load()
    arguments = {} if found.input is None else {"input": found.input}
    finer = find_equilibrium(model, arguments=arguments)
    one = measure_chains(structure, found.node_position, found.member_tension)
    two = measure_chains(fine, finer.node_position, finer.member_tension)
    rows = [
        SegmentError(
            name,
            one[name].n_segments,
            one[name].end_tension,
            (4 * two[name].end_tension - one[name].end_tension) / 3,
            one[name].sag,
            (4 * two[name].sag - one[name].sag) / 3,
        )
        for name in one
    ]
    return replace(found, segments=tuple(rows))
