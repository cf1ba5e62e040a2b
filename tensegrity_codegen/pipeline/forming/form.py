"""Shapes in balance from force densities, forces and lengths of members, and rest lengths that hold them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.pipeline.analyses import find_needs
from tensegrity_codegen.pipeline.build_library import FEW_CALLS, build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.pipeline.forming.force_density import check_lengths, find_density_shape, sum_forces
from tensegrity_codegen.pipeline.forming.formed import Form
from tensegrity_codegen.pipeline.forming.statements import read_statements
from tensegrity_codegen.pipeline.forming.targets import Numbers, find_nearest_shape, read_targets
from tensegrity_codegen.pipeline.settle import with_statics
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.scene.describe import describe_structure
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.structure.limits import Limits
from tensegrity_codegen.structure.sliding import require_no_rings
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_mapping, check_switch
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    FormulationError,
    InvalidValueError,
)
from tensegrity_codegen.system.summaries import count_names
from tensegrity_codegen.tables.request import ModelRequest

OF = "values by member, group, class or kind"
NO_LENGTH = 1e-12  # of the structure's size: rest length of springs with forces in proportion to lengths
LONG = 1e3  # of the structure's size: rest length of springs that push with nearly the same force everywhere
FARTHEST = 100.0  # of the structure's size: a member that pushes and is longer is held by nothing
TOLERANCE = 1e-12  # of equilibria
MOST_SHAPES, UNMOVED = 200, 1e-11  # shapes that forces take, and motion over the size at which they end


def form(
    scene: str | Path | Mapping[str, Any] | Scene,
    *,
    density: Mapping[str, float] | None = None,
    force: Mapping[str, float] | None = None,
    length: Mapping[str, float] | None = None,
    target_length: Numbers | None = None,
    target_force: Numbers | None = None,
    length_range: Mapping[str, Sequence[float]] | None = None,
    least_load_path: bool = False,
    compiler: str | None = None,
) -> Form:
    """Find a shape in which the forces balance, and the rest lengths that hold it.

    Parameters
    ----------
    scene : str, Path, mapping or Scene
        As for `read_scene`: nodes, anchors, loads, members with their stiffnesses. Positions are where the
        search begins, rest lengths are not used.
    density, force, length : mapping of str to float
        Force density [N/m], tension [N] or length [m] by member, group, class, ``"cables"`` or ``"bars"``;
        what is stated of fewer members comes first: of a member before that of its group, class and kind.
        Bars of which nothing is stated keep the lengths that they have in the scene.
    target_length, target_force : mapping of str to float or (float, float), optional
        Lengths [m] and tensions [N] to come near to, by the same names: value, or value and weight. With
        these, ranges or a least load path the stated force densities are where a search over all of them
        begins, each keeps its sign, and the sum of weight (value - target)^2 is minimised.
    length_range : mapping of str to (float, float), optional
        Least and largest length [m].
    least_load_path : bool
        Whether the load path ``sum |t| l`` [N m] is minimised, in addition to what targets miss.
    compiler : str, optional
        C compiler.

    Returns
    -------
    Form
        The shape, tensions, rest lengths, and whether it is stable.

    Raises
    ------
    UnknownNameError, DuplicateNameError, InvalidValueError
        A name that is none, two statements of one member, a value that no member can have, a cable of which
        nothing is stated.
    ConvergenceError
        There is no such shape, or it is not determined.
    FormulationError
        A structure of bodies, or on the ground.

    Notes
    -----
    Without stated lengths the shape follows from linear equations (Schek 1974), with stated forces from
    Newton's method. Lengths are kept by rigid bars, between springs whose force is in proportion to their
    length; the shape is a minimum of the energy of these, found as `find_equilibrium` does. Where all cables
    have a length, bars of a negative density take the largest ``sum |q| l^2``: the longest struts, as in the
    nonlinear programs of Pellegrino (Tibert and Pellegrino 2003). Positive force
    densities between anchors are stable whatever the stiffnesses are; all else is judged by the equilibrium
    with the stiffnesses of the scene.

    Examples
    --------
    >>> from tensegrity_codegen import form
    >>> found = form("two_nodes.toml", density={"cables": 5.0})
    >>> found.status, found.member_name
    ('stable', ('member1',))
    """
    subject, request = load_scene(scene)
    structure = require_nodes(subject, "form finding")
    given = {"density": density, "force": force, "length": length}
    stated = read_statements(structure, *(check_mapping(value, name, OF) for name, value in given.items()))
    check_switch(least_load_path, "least_load_path")
    near = {"target_length": target_length, "target_force": target_force, "length_range": length_range}
    lengths, forces, ranges = (check_mapping(value, name, OF) for name, value in near.items())
    targets = read_targets(structure, lengths, forces, ranges, least_load_path)
    if not targets.is_stated:
        position, q = _find_shape(structure, request, *stated, compiler)
        return _settle(structure, request, position, q, compiler)
    if np.isnan(stated[0]).any():
        names = [structure.member_name[e] for e in np.flatnonzero(np.isnan(stated[0]))]
        raise InvalidValueError(
            "targets need a force density of every member, where the search begins",
            where=structure.name,
            given=f"none of {count_names(names)}",
            allowed="a force density of each member, below 0 where it pushes",
        )
    shape = find_nearest_shape(structure, stated[0], targets)
    found = _settle(structure, request, shape.node_position, shape.force_density, compiler)
    return replace(found, message=f"{found.message}; load path {found.load_path:.9g} N m")


def require_nodes(subject: Any, what: str) -> Structure:
    """Return a structure of nodes in the air; raises FormulationError. what: "form finding", for messages."""
    if not isinstance(subject, Structure) or subject.ground is not None:
        raise FormulationError(
            f"only nodes, bars and cables between anchors or in the air are supported here: {what}",
            where=subject.name,
            given="bodies" if not isinstance(subject, Structure) else "a ground",
            hint="leave out the ground, and settle on it afterwards",
        )
    require_no_rings(subject, what)
    return subject


def _find_shape(
    structure: Structure,
    request: ModelRequest,
    density: FloatArray,
    force: FloatArray,
    length: FloatArray,
    compiler: str | None,
) -> tuple[FloatArray, FloatArray]:
    """Return positions (n_nodes, 3) and force densities (n_members,) in balance."""
    if np.isnan(length).all():
        shape = find_density_shape(structure, density, force)
        return shape.node_position, shape.force_density
    kept, is_force = np.isfinite(length), np.isfinite(force)
    size = float(np.ptp(structure.node_position, axis=0).max())
    pushes = ~kept & (np.where(is_force, force, density) < 0.0)
    rest = np.where(kept, length, np.where(pushes, LONG, NO_LENGTH) * size)

    def find_constants(own: FloatArray) -> FloatArray:
        far = np.flatnonzero(pushes & (own > FARTHEST * size))
        if far.size:
            names = count_names([structure.member_name[e] for e in far])
            raise ConvergenceError(
                "nothing holds members that push: they grow without end",
                evidence={"members": names},
                where=structure.name,
                hint="state lengths of the cables around them",
            )
        return np.where(kept, 0.0, np.where(is_force, force, density * own) / np.where(kept, 1.0, own - rest))

    q = find_constants(structure.member_length())
    springs = structure.with_changes(
        is_bar=kept,
        tension_only=np.zeros(structure.n_members, dtype=bool),
        rest_length=rest,
        spring_constant=q,
        axial_stiffness=np.zeros(structure.n_members),
        damping=np.zeros(structure.n_members),
        law_parameter={},
        inputs=(),
        actuators=(),
        sensors=(),
        limits=Limits(),
        collision=None,
        interference=(),
    )
    free = tuple(np.flatnonzero(~kept).tolist())
    parameters = {"spring_constant": free} if free else {}
    asked = replace(request, formulation="rigid_bar", parameters={}, integrators=(), options={}, events=None)
    model = build_library(
        springs, _ask(springs, asked, parameters), compiler=compiler, calls=FEW_CALLS
    ).load()

    def settle(start: FloatArray | None) -> Equilibrium:
        given = {"spring_constant": q[list(free)]} if free else {}
        return find_equilibrium(model, coordinate=start, arguments=given, tolerance=TOLERANCE)

    found = settle(None)
    for _ in range(MOST_SHAPES):
        if not (is_force | pushes).any():
            break
        q = find_constants(found.member_length)
        again = settle(found.coordinate)
        motion = float(np.abs(again.node_position - found.node_position).max())
        found = again
        if motion <= UNMOVED * size:
            break
    else:
        raise ConvergenceError(
            "the forces have no shape in balance",
            evidence={"shapes": MOST_SHAPES, "last_motion": motion, "size": size},
            where=structure.name,
        )
    own = check_lengths(structure, found.node_position, size)
    return found.node_position, found.member_tension / own


def _ask(structure: Structure, request: ModelRequest, parameters: dict[str, tuple[int, ...]]) -> ModelRequest:
    """Return the request for what an equilibrium takes, with these run-time parameters alone."""
    statics = with_statics(structure, request)
    return replace(find_needs("equilibrium", structure, statics).alone(statics), parameters=parameters)


def _settle(
    structure: Structure, request: ModelRequest, position: FloatArray, q: FloatArray, compiler: str | None
) -> Form:
    """Return the shape with the stiffnesses of the scene: rest lengths, balance, stability."""
    moved = structure.with_changes(node_position=position, node_velocity=np.zeros_like(position))
    length = moved.member_length()
    tension = q * length
    _check_tensions(structure, tension)
    moved = moved.with_changes(rest_length=length)  # which rigid bars keep
    rest = moved.require_rest_length(length, tension, "smaller force densities, or a stiffer member")
    held = moved.with_changes(rest_length=rest)
    forces = sum_forces(structure, position, q)
    forces[structure.node_anchored] = 0.0
    residual = float(np.abs(forces[:, list(structure.axes)]).max(initial=0.0))
    if (q >= 0.0).all() and not structure.is_rigid.any():
        status, proof = "stable", "every member pulls, so that no motion lowers the energy"
    else:
        status, proof = _judge(held, request, compiler)
    cables = tension[structure.tension_only]
    farthest = int(np.linalg.norm(position - structure.node_position, axis=1).argmax())
    way = float(np.linalg.norm(position[farthest] - structure.node_position[farthest]))
    pulls = f"cables {cables.min():.6g} to {cables.max():.6g} N" if cables.size else "no cables"
    return Form(
        status=status,
        message=f"{structure.n_members} members in balance, {pulls}; {structure.node_name[farthest]} moved "
        f"{way:.6g} m; {proof}",
        node_position=position,
        member_length=length,
        member_tension=tension,
        force_density=q,
        rest_length=held.rest_length,
        residual=residual,
        largest_force=float(np.abs(tension).max(initial=0.0)),
        proof=proof,
        structure=held,
        document=describe_structure(held, request),
    )


def _check_tensions(structure: Structure, tension: FloatArray) -> None:
    """Raise ConvergenceError where cables of a stated length would have to push."""
    pushed = structure.tension_only & (tension < 0.0)
    if pushed.any():
        names = [structure.member_name[e] for e in np.flatnonzero(pushed)]
        raise ConvergenceError(
            "cables of a stated length would have to push",
            evidence={"cables": count_names(names), "least_tension": float(tension[pushed].min())},
            where=structure.name,
            hint="state longer ones, or a force",
        )


def _judge(held: Structure, request: ModelRequest, compiler: str | None) -> tuple[str, str]:
    """Return whether the equilibrium at this shape is stable, and why."""
    wanted = _ask(held, request, {})
    model = build_library(held, wanted, compiler=compiler, calls=FEW_CALLS).load()
    found: Equilibrium = find_equilibrium(model, raise_on_failure=False)
    size = float(np.ptp(held.node_position, axis=0).max())
    stays = found.is_found and not found.is_start_unstable and found.change <= 1e-4 * size
    if stays:
        return "stable", f"smallest stiffness {found.smallest_eigenvalue:.6g} N/m"
    where = f"it settles {found.change:.3g} m away" if found.is_found else found.message
    return "unstable", f"with its stiffnesses the structure leaves the shape: {where}"
