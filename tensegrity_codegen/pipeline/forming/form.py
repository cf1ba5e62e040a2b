"""Shapes in balance from force densities, forces and lengths of members, and rest lengths that hold them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.pipeline.analyses import find_needs
from tensegrity_codegen.pipeline.build_library import FEW_CALLS, build_library
from tensegrity_codegen.pipeline.forming.force_density import (
    DensityShape,
    check_lengths,
    find_density_shape,
    sum_forces,
)
from tensegrity_codegen.pipeline.forming.targets import (
    Numbers,
    find_nearest_shape,
    read_statements,
    read_targets,
)
from tensegrity_codegen.pipeline.settle import with_statics
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.scene.assemble.assemble import find_mass_per_length
from tensegrity_codegen.scene.describe import describe_structure
from tensegrity_codegen.scene.read import name_source, read_scene
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.scene.subject import assemble_scene
from tensegrity_codegen.structure.body_support import require_no_bodies
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
from tensegrity_codegen.system.summaries import ByName, Fact, Summarised, count_names, describe_range
from tensegrity_codegen.tables.request import ModelRequest


@dataclass(frozen=True, repr=False)
class Form(ByName, Summarised):
    """A shape in balance.

    Attributes
    ----------
    status : str
        ``"stable"``; ``"unstable"``: forces balance, and the structure with its stiffnesses leaves the shape.
    message : str
        A sentence.
    node_position : ndarray, shape (n_nodes, 3) [m]
        Positions.
    member_length, member_tension, force_density, rest_length : ndarray, shape (n_members,)
        Lengths [m], tensions [N], tensions over lengths [N/m], and rest lengths that hold them [m].
    residual, largest_force : float
        Largest force that is not balanced at a node, and largest tension [N].
    proof : str
        Why it is stable, or is not.
    structure : Structure
        The structure in this shape, at rest, with these rest lengths.
    document : mapping
        The same as a scene.
    """

    status: str
    message: str
    node_position: FloatArray
    member_length: FloatArray
    member_tension: FloatArray
    force_density: FloatArray
    rest_length: FloatArray
    residual: float
    largest_force: float
    proof: str
    structure: Structure
    document: Mapping[str, Any]

    @property
    def node_name(self) -> tuple[str, ...]:
        """Names of the nodes."""
        return self.structure.node_name

    @property
    def member_name(self) -> tuple[str, ...]:
        """Names of the members."""
        return self.structure.member_name

    @property
    def load_path(self) -> float:
        """Sum of ``|tension| length`` over all members [N m]."""
        return float(np.abs(self.member_tension) @ self.member_length)

    def as_evidence(self) -> dict[str, Any]:
        """Return all results by name, JSON-ready."""
        rows = zip(
            self.member_name,
            self.member_length,
            self.member_tension,
            self.force_density,
            self.rest_length,
            strict=True,
        )
        heads = ("length", "tension", "force_density", "rest_length")
        return {
            "status": self.status,
            "message": self.message,
            "proof": self.proof,
            "residual": self.residual,
            "largest_force": self.largest_force,
            "load_path": self.load_path,
            "node_position": dict(zip(self.node_name, self.node_position.tolist(), strict=True)),
            "members": {name: dict(zip(heads, map(float, values), strict=True)) for name, *values in rows},
        }

    def headline(self) -> str:
        """Return status and message."""
        return f"{self.status}: {self.message}"

    def facts(self) -> list[Fact]:
        """Return tensions, rest lengths and what is left of balance."""
        return [
            ("tension", describe_range(self.member_tension, "N")),
            ("rest length", describe_range(self.rest_length, "m")),
            ("residual", f"{self.residual:.3g} N of {self.largest_force:.6g} N"),
        ]


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
        search begins, rest lengths are not used. Masses stated by length are those of the shape found.
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
    source, source_name = read_scene(scene), name_source(scene)
    subject, request = assemble_scene(source, source_name)
    structure = require_nodes(subject, "form finding")
    mass_per_length = find_mass_per_length(source, structure, source_name)
    values = {"density": density, "force": force, "length": length}
    stated = read_statements(structure, *(check_mapping(value, name, OF) for name, value in values.items()))
    check_switch(least_load_path, "least_load_path")
    aims = {"target_length": target_length, "target_force": target_force, "length_range": length_range}
    lengths, forces, ranges = (check_mapping(value, name, OF) for name, value in aims.items())
    targets = read_targets(structure, lengths, forces, ranges, least_load_path)
    if targets.is_stated and np.isnan(stated[0]).any():
        names = [structure.member_name[e] for e in np.flatnonzero(np.isnan(stated[0]))]
        problem = "targets need a force density of every member, where the search begins"
        allowed = "a force density of each member, below 0 where it pushes"
        value = f"none of {count_names(names)}"
        raise InvalidValueError(problem, where=structure.name, given=value, allowed=allowed)
    limit = np.inf
    for _ in range(MOST_SHAPES):  # weights follow the lengths, and these the weights
        if targets.is_stated:
            shape = find_nearest_shape(structure, stated[0], targets)
        else:
            shape = _find_shape(structure, request, *stated, compiler)
        held = _hold(structure, shape, mass_per_length)
        growth = float(np.abs(held.member_mass - structure.member_mass).max(initial=0.0))
        largest = float(held.member_mass.max(initial=0.0))
        is_settled = not structure.gravity.any() or growth <= UNMOVED * largest
        limit = min(limit, FARTHEST * largest)
        if is_settled or largest >= limit:
            break
        structure = structure.with_changes(member_mass=held.member_mass)
    if not is_settled:
        raise ConvergenceError(
            "no shape carries the weights of its members: they grow with the lengths",
            evidence={"largest_mass": largest, "growth": growth},
            where=structure.name,
            hint="larger force densities or forces, or less mass_per_length or density",
        )
    formed = _settle(structure, held, request, shape.force_density, compiler)
    if not targets.is_stated:
        return formed
    return replace(formed, message=f"{formed.message}; load path {formed.load_path:.9g} N m")


def require_nodes(subject: Any, what: str) -> Structure:
    """Return a structure of nodes in the air; raises FormulationError. what: "form finding", for messages."""
    if not isinstance(subject, Structure) or subject.ground is not None:
        problem = f"only nodes, bars and cables between anchors or in the air are supported here: {what}"
        value = "bodies" if not isinstance(subject, Structure) else "a ground"
        hint = "leave out the ground, and settle on it afterwards"
        raise FormulationError(problem, where=subject.name, given=value, hint=hint)
    require_no_rings(subject, what)
    require_no_bodies(subject, what)
    return subject


def _find_shape(
    structure: Structure,
    request: ModelRequest,
    density: FloatArray,
    force: FloatArray,
    length: FloatArray,
    compiler: str | None,
) -> DensityShape:
    """Return positions and force densities in balance."""
    if np.isnan(length).all():
        return find_density_shape(structure, density, force)
    has_length, is_force = np.isfinite(length), np.isfinite(force)
    size = float(np.ptp(structure.node_position, axis=0).max())
    pushes = ~has_length & (np.where(is_force, force, density) < 0.0)
    rest_length = np.where(has_length, length, np.where(pushes, LONG, NO_LENGTH) * size)

    def find_constants(lengths: FloatArray) -> FloatArray:
        distant = np.flatnonzero(pushes & (lengths > FARTHEST * size))
        if distant.size:
            names = count_names([structure.member_name[e] for e in distant])
            raise ConvergenceError(
                "nothing holds members that push: they grow without end",
                evidence={"members": names},
                where=structure.name,
                hint="state lengths of the cables around them",
            )
        return np.where(
            has_length,
            0.0,
            np.where(is_force, force, density * lengths) / np.where(has_length, 1.0, lengths - rest_length),
        )

    q = find_constants(structure.member_length())
    springs = structure.with_changes(
        is_bar=has_length,
        tension_only=np.zeros(structure.n_members, dtype=bool),
        rest_length=rest_length,
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
    free = tuple(np.flatnonzero(~has_length).tolist())
    parameters = {"spring_constant": free} if free else {}
    rigid_request = replace(
        request, formulation="rigid_bar", parameters={}, integrators=(), options={}, events=None
    )
    model = build_library(
        springs, _ask(springs, rigid_request, parameters), compiler=compiler, calls=FEW_CALLS
    ).load()

    def settle(start: FloatArray | None) -> Equilibrium:
        fixed = {"spring_constant": q[list(free)]} if free else {}
        return find_equilibrium(model, coordinate=start, arguments=fixed, tolerance=TOLERANCE)

    equilibrium = settle(None)
    for _ in range(MOST_SHAPES):
        if not (is_force | pushes).any():
            break
        q = find_constants(equilibrium.member_length)
        again = settle(equilibrium.coordinate)
        motion = float(np.abs(again.node_position - equilibrium.node_position).max())
        equilibrium = again
        if motion <= UNMOVED * size:
            break
    else:
        problem, location = "the forces have no shape in balance", structure.name
        raise ConvergenceError(
            problem, evidence={"shapes": MOST_SHAPES, "last_motion": motion, "size": size}, where=location
        )
    member_length = check_lengths(structure, equilibrium.node_position, size)
    return DensityShape(equilibrium.node_position, equilibrium.member_tension / member_length)


def _ask(structure: Structure, request: ModelRequest, parameters: dict[str, tuple[int, ...]]) -> ModelRequest:
    """Return the request for what an equilibrium takes, with these run-time parameters alone."""
    statics = with_statics(structure, request)
    return replace(find_needs("equilibrium", structure, statics).alone(statics), parameters=parameters)


def _hold(structure: Structure, shape: DensityShape, mass_per_length: FloatArray) -> Structure:
    """Return the structure in a shape, with rest lengths that hold it and the masses of its members."""
    velocity = np.zeros_like(shape.node_position)
    moved = structure.with_changes(node_position=shape.node_position, node_velocity=velocity)
    length = moved.member_length()
    tension = shape.force_density * length
    _check_tensions(structure, tension)
    moved = moved.with_changes(rest_length=length)  # which rigid bars keep
    rest_length = moved.require_rest_length(
        length, tension, "smaller force densities or weights, or a stiffer member"
    )
    mass = mass_per_length * np.where(structure.is_bar, length, rest_length)
    mass = np.where(np.isnan(mass_per_length), structure.member_mass, mass)
    return moved.with_changes(rest_length=rest_length, member_mass=mass)


def _settle(
    structure: Structure, held: Structure, request: ModelRequest, q: FloatArray, compiler: str | None
) -> Form:
    """Return the shape with the stiffnesses of the scene: balance, stability. structure: at the start."""
    position, length = held.node_position, held.member_length()
    tension = q * length
    forces = sum_forces(held, position, q)
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
    needs = _ask(held, request, {})
    model = build_library(held, needs, compiler=compiler, calls=FEW_CALLS).load()
    equilibrium: Equilibrium = find_equilibrium(model, raise_on_failure=False)
    size = float(np.ptp(held.node_position, axis=0).max())
    stays = equilibrium.is_found and not equilibrium.is_start_unstable and equilibrium.change <= 1e-4 * size
    if stays:
        return "stable", f"smallest stiffness {equilibrium.smallest_eigenvalue:.6g} N/m"
    outcome = f"it settles {equilibrium.change:.3g} m away" if equilibrium.is_found else equilibrium.message
    return "unstable", f"with its stiffnesses the structure leaves the shape: {outcome}"
