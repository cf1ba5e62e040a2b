"""The work of the verb `equilibrium`: a scene settles under loads and inputs, and what is said of it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.cli.inputs import read_inputs
from tensegrity_codegen.cli.options import parse_loads
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.scene.names import name_list
from tensegrity_codegen.structure.applied_inputs import add_inputs_to_rest_length
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.sliding import slip_rest_lengths
from tensegrity_codegen.system.errors import ConvergenceError

if TYPE_CHECKING:
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
    from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
    from tensegrity_codegen.structure.structure import Structure
    from tensegrity_codegen.tables.request import ModelRequest


def settle_scene(
    output: Output,
    scene: Path,
    load: Sequence[str],
    inputs: list[str] | None,
    out: Path | None,
    *,
    overwrite: bool,
    **options: Any,
) -> "Equilibrium":
    """Find, write and report the equilibrium of a scene with the values of --load and --input.

    options: compiler, tolerance, method and frictionless.
    """
    from tensegrity_codegen.scene.write import write_scene

    structure, request = output.load(scene, settles=True)
    added = parse_loads(list(load), structure)
    held = _find_held(structure, added)
    if held:
        output.warn(f"a part of the load acts on anchored axes and has no effect: {', '.join(held)}")
    values = read_inputs(inputs, structure, output)
    found, data = _settle(output, structure, request, added, values, **options)
    data |= {"held_load": held, "inputs": values, "out": None}
    rest = add_inputs_to_rest_length(structure, values)
    actuated = structure.with_changes(rest_length=slip_rest_lengths(structure.sliding, rest, found.slid))
    if out is not None and found.is_found:
        write_scene(_describe_settled(actuated, request, found), out, overwrite=overwrite)
        data["out"] = str(out)
    _report(output, actuated, found, data)
    return found


def _settle(
    output: Output,
    structure: "Structure | BodySystem",
    request: "ModelRequest",
    added: NDArray[np.float64],
    inputs: Mapping[str, float],
    *,
    compiler: str | None,
    **options: Any,
) -> "tuple[Equilibrium, dict[str, Any]]":
    """Return the equilibrium under loads added (n_nodes, 3) [N] and inputs, and what the JSON says of it."""
    from tensegrity_codegen.pipeline.analyses import find_needs
    from tensegrity_codegen.pipeline.build_library import FEW_CALLS, build_library
    from tensegrity_codegen.pipeline.segment_error import add_segment_error
    from tensegrity_codegen.pipeline.settle import move_back, move_near_origin, with_statics
    from tensegrity_codegen.runtime.paths.find_equilibrium import find_equilibrium

    statics = replace(
        with_statics(structure, request), parameters={"node_load": tuple(range(structure.n_nodes))}
    )
    near, offset = move_near_origin(structure, request)
    wanted = find_needs("equilibrium", structure, statics).alone(statics)
    model = build_library(near, wanted, compiler=compiler, calls=FEW_CALLS).load()
    arguments: dict[str, Any] = dict(inputs)
    if added.any():
        arguments["node_load"] = (structure.node_load + added)[:, list(structure.axes)]
    with output.progress("checking for snap-through"):
        found = find_equilibrium(model, arguments=arguments, raise_on_failure=False, **options)
    try:
        found = add_segment_error(found, request, compiler=compiler)
    except ConvergenceError as error:
        output.warn(f"the discretisation error of cables in segments is unknown: {error.problem}")
    output.warn(*found.warnings)
    found = move_back(found, structure, offset, added, inputs)
    return found, equilibrium_data(model, found)


def _report(
    output: Output, structure: "Structure | BodySystem", found: "Equilibrium", data: dict[str, Any]
) -> None:
    """Print the equilibrium: nodes, members, residual, motion."""
    from tensegrity_codegen.report.tables import feet_table, members_table, nodes_table, segments_table
    from tensegrity_codegen.runtime.contacts.rest_memory import describe_plastic, describe_slip
    from tensegrity_codegen.structure.member_limits import describe_tensions, summarise_tensions
    from tensegrity_codegen.structure.outline import outline_tendons

    unit = "in the units of the coordinates" if isinstance(structure, BodySystem) else "N/m"
    drawn = outline_tendons(structure)
    tables = [
        nodes_table(drawn, found.node_position),
        members_table(drawn, found.member_length, found.member_tension, found.members),
    ]
    if found.feet is not None:
        feet = found.feet
        tables.insert(0, feet_table(structure.name, feet.node_name, feet.force, feet.state, feet.penetration))
    if found.segments:
        tables.append(segments_table(structure.name, found.segments))
    tensions = describe_tensions(summarise_tensions(structure, found.member_tension))
    said = [*([found.message] if found.message else []), *([tensions] if found.is_found else [])]
    flaws = [] if found.members is None else found.members.describe()
    beyond = "exceeds limits; " if found.members is not None and found.members.is_beyond else ""
    output.result(
        data,
        f"{beyond}{found.status}: {'; but '.join(['; '.join(said), *flaws])}",
        *(tables if found.is_found else []),  # else those of no equilibrium would hide the reason
        *describe_plastic(found.plastic_elongation),
        *describe_slip(found.slid),
        f"largest residual {found.residual:.3g} N of largest member force {found.largest_force:.6g} N; "
        f"smallest eigenvalue {found.smallest_eigenvalue:.6g} {unit}",
        *(_describe_motion(found) if found.is_found else []),
    )


def _find_held(structure: "Structure | BodySystem", added: NDArray[np.float64]) -> list[str]:
    """Return "NODE.axis" of the added loads (n_nodes, 3) [N] that go straight into a support."""
    if isinstance(structure, BodySystem):
        return []
    where = np.argwhere((added != 0.0) & structure.node_anchored)
    return [f"{structure.node_name[node]}.{'xyz'[axis]}" for node, axis in where]


def _describe_motion(found: "Equilibrium") -> list[str]:
    """Return how far nodes moved, and which motions cost nothing, a line each."""
    lines = ["no node moved"]
    if found.displacement:
        lines = [f"node {found.displaced_node} moved farthest, {found.displacement:.6g} m"]
    if found.neutral_motion_names:
        free = f"free to {_join_motions(found.neutral_motion_names)}, without change of energy"
        if found.displacement:
            is_moved = found.change > 1e-12 * found.extent  # otherwise rounding
            moved = f"node {found.changed_node} moved farthest, {found.change:.6g} m"
            lines = [
                f"{moved if is_moved else 'no node moved'}, without these motions "
                f"(with them: node {found.displaced_node}, {found.displacement:.6g} m)"
            ]
        lines = [free, *lines]
    return lines


def _join_motions(names: Sequence[str]) -> str:
    """Return names of neutral motions as one text: "slide along x, y; turn about z"."""
    words = []
    for kind in ("slide along ", "turn about "):
        found = [name.removeprefix(kind) for name in names if name.startswith(kind)]
        words += [kind + ", ".join(found)] if found else []
    others = names.count("mechanism")
    words += [f"move in {others} mechanism{'s' * (others > 1)}"] if others else []
    return "; ".join(words)


def _describe_settled(
    structure: "Structure | BodySystem", request: "ModelRequest", found: "Equilibrium"
) -> dict[str, Any]:
    """Return the scene document of the settled structure, at rest."""
    from tensegrity_codegen.scene.describe_bodies import describe_subject

    if isinstance(structure, BodySystem):
        at_rest = {"coordinate": found.coordinate, "velocity": 0 * structure.velocity}
    else:
        at_rest = {"node_position": found.node_position, "node_velocity": 0 * structure.node_velocity}
    return describe_subject(structure.with_changes(**at_rest), request)


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


def equilibrium_data(model: "CompiledModel", found: "Equilibrium") -> dict[str, Any]:
    """Return the equilibrium as one JSON-ready object, nodes and members by name."""
    manifest = model.manifest
    position = np.asarray(found.node_position)
    return {
        **found.as_evidence(),
        "node_position": dict(zip(manifest.node_name, position.tolist(), strict=True)),
        "member_length": dict(zip(manifest.member_name, found.member_length.tolist(), strict=True)),
        "member_tension": dict(zip(manifest.member_name, found.member_tension.tolist(), strict=True)),
    }
