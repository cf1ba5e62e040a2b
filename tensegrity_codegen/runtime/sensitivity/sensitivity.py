"""The derivative of an equilibrium by rest lengths, by the implicit function theorem."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.model.arrays import check_finite, check_shape, check_tolerance, to_doubles
from tensegrity_codegen.runtime.model.interface import Model, require_model, require_quantities
from tensegrity_codegen.runtime.sensitivity.static_system import (
    REST_LENGTH_QUANTITIES,
    StaticSystem,
    build_system,
    factorise,
    find_gauge,
    find_node_velocities,
    has_springs,
    name_gauge,
)
from tensegrity_codegen.runtime.statics.equilibrium import build_problem
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.runtime.statics.static_problem import Point, StaticProblem
from tensegrity_codegen.structure.ground_support import refuse_ground
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_names
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    FormulationError,
    InvalidValueError,
    NonFiniteError,
    SingularStiffnessError,
    check_choice,
)
from tensegrity_codegen.system.summaries import Summarised
from tensegrity_codegen.tables.body_places import BodyPlace, find_shown, label_nodes, show_members

Columns = Sequence[str] | Mapping[str, Sequence[str]]
REST_LENGTH_TOLERANCE = 1e-9  # extension over length up to which a cable may go slack or taut
MAX_NAMED_NODES = 3  # nodes of a motion without resistance that the error names


@dataclass(frozen=True, repr=False)
class Sensitivity(Summarised):
    """Derivatives of an equilibrium by rest lengths.

    A column stands for one member, or for the members of an input or actuator, whose rest lengths change
    together.
    The column of a rigid bar is the derivative by the length that it keeps.

    Attributes
    ----------
    coordinate : ndarray, shape (n_coordinates, n_columns) [m/m]
        dq/drho; radians per metre where a coordinate is an angle.
    tension : ndarray, shape (n_members, n_columns) [N/m]
        dt/drho, with the motion of the nodes.
    node : ndarray, shape (n_nodes, 3, n_columns) [m/m]
        dr/drho of all nodes.
    coordinate_name, node_name, member_name, column_name : tuple of str
        Names of rows and columns.
    gauge : tuple of str
        Rigid motions that cost no force, and are set to zero: ``"slide along x"``, ``"turn about z"``.
    gauge_motion : ndarray, shape (n_coordinates, n_gauge)
        These motions. The motion of the nodes in each column is orthogonal to that in each of them: the
        mean of the nodes does not slide, and they do not turn on the whole.
    slack : tuple of str
        Slack cables: the structure does not follow changes of their rest lengths.
    one_sided : tuple of str
        Cables at their rest lengths, which go slack or taut with the smallest change: the derivatives hold on
        one side only.
    smallest_eigenvalue : float
        Eigenvalue of the stiffness nearest zero, without the gauge and within rigid bars [N/m]; negative
        where the equilibrium is unstable.
    rounding : float
        What one iterative refinement changed, as part of the largest dq/drho.
    residual, largest_force : float
        Largest node residual and member force of the equilibrium [N].
    bodies : tuple of BodyPlace
        Rigid bodies, whose corners and edges are the last nodes and members.
    """

    coordinate: FloatArray
    tension: FloatArray
    node: FloatArray
    coordinate_name: tuple[str, ...]
    node_name: tuple[str, ...]
    member_name: tuple[str, ...]
    column_name: tuple[str, ...]
    gauge: tuple[str, ...]
    gauge_motion: FloatArray
    slack: tuple[str, ...]
    one_sided: tuple[str, ...]
    smallest_eigenvalue: float
    rounding: float
    residual: float
    largest_force: float
    bodies: tuple[BodyPlace, ...] = ()

    def rank_for_node(self, node: str, axis: str = "z", most: int = 5) -> list[tuple[str, float]]:
        """Return the columns that move a node most along an axis.

        Parameters
        ----------
        node : str
            Name of the node.
        axis : str
            ``"x"``, ``"y"`` or ``"z"``.
        most : int
            Number of columns, at most.

        Returns
        -------
        list of (str, float)
            Name and derivative [m/m], the largest modulus first; zeros are left out.

        Raises
        ------
        UnknownNameError
            No such node or axis.
        InvalidValueError
            A number of columns below 1.
        """
        check_choice(node, self.node_name, "node", "node")
        check_choice(axis, "xyz", "axis", "axis")
        return self._rank(self.node[self.node_name.index(node), "xyz".index(axis)], most)

    def rank_for_tension(self, member: str, most: int = 5) -> list[tuple[str, float]]:
        """Return the columns that change the tension of a member most.

        Parameters
        ----------
        member : str
            Name of the member.
        most : int
            Number of columns, at most.

        Returns
        -------
        list of (str, float)
            Name and derivative [N/m], the largest modulus first; zeros are left out.

        Raises
        ------
        UnknownNameError
            No such member.
        InvalidValueError
            A number of columns below 1.
        """
        check_choice(member, self.member_name, "member", "member")
        return self._rank(self.tension[self.member_name.index(member)], most)

    def _rank(self, row: FloatArray, most: int) -> list[tuple[str, float]]:
        if most < 1:
            raise InvalidValueError("no columns are asked for", where="most", given=most, allowed="1 or more")
        order = np.argsort(-np.abs(row), kind="stable")[:most]
        return [(self.column_name[k], float(row[k])) for k in order if row[k] != 0.0]

    def as_evidence(self) -> dict[str, Any]:
        """Return the scalar results by name, JSON-ready."""
        names = (
            "gauge",
            "slack",
            "one_sided",
            "smallest_eigenvalue",
            "rounding",
            "residual",
            "largest_force",
        )
        return {name: getattr(self, name) for name in names}


def select_columns(model: Model, columns: Columns | None) -> tuple[tuple[str, ...], Any]:
    """Return names of columns, and the gain of each on the rest lengths (n_members, n_columns)."""
    member_name = model.manifest.member_name
    shown = show_members(member_name, model.manifest.body_places)
    if columns is None and shown:
        return tuple(shown), scipy.sparse.eye_array(len(member_name), len(shown), format="csc")
    names = check_names(columns or (), "columns")
    if not names:
        raise InvalidValueError(
            "no columns are chosen", where="columns", given=columns, allowed="one or more members or inputs",
            hint="None stands for all members",
        )  # fmt: skip
    _check_distinct(names, "columns")
    if isinstance(columns, Mapping):
        gains = [dict.fromkeys(_find_group(name, columns[name], member_name), 1.0) for name in names]
    else:
        structure = getattr(model, "structure", None)
        inputs = () if structure is None else structure.inputs
        gain_of = {column_gain.name: gain for column_gain in inputs if (gain := column_gain.rest_length_gain)}
        gain_of |= {name: {e: 1.0} for e, name in enumerate(member_name)}
        for name in names:
            check_choice(name, gain_of, "member or input", "columns")
        gains = [gain_of[name] for name in names]
    rows = np.concatenate([np.array(list(column_gain), dtype=np.int64) for column_gain in gains])
    values = np.concatenate([np.array(list(column_gain.values())) for column_gain in gains])
    column_of = np.repeat(np.arange(len(names)), [len(column_gain) for column_gain in gains])
    shape = (len(member_name), len(names))
    return names, scipy.sparse.csc_array((values, (rows, column_of)), shape=shape)


def _find_group(name: str, given: Sequence[str], member_name: Sequence[str]) -> tuple[int, ...]:
    location = f"columns.{name}"
    members = check_names(given, location)
    if not members:
        raise InvalidValueError("a group without members", where=location, allowed="one or more members")
    _check_distinct(members, location)
    for member in members:
        check_choice(member, member_name, "member", location)
    return tuple(member_name.index(member) for member in members)


def _check_distinct(names: Sequence[str], location: str) -> None:
    twice = [name for k, name in enumerate(names) if name in names[:k]]
    if twice:
        raise DuplicateNameError("given twice", where=location, given=twice[0], allowed="each name once")


def equilibrium_sensitivity(
    model: Model,
    equilibrium: Equilibrium | ArrayLike | None = None,
    arguments: Mapping[str, Any] | None = None,
    *,
    columns: Columns | None = None,
    tolerance: float = 1e-6,
) -> Sensitivity:
    """Compute the derivatives of an equilibrium by rest lengths.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"sensitivity"``, see compile_scene.
    equilibrium : Equilibrium or array_like, shape (n_coordinates,), optional
        The equilibrium or its coordinates [m]; by default the positions of the scene.
    arguments : mapping, optional
        Inputs and parameters by name, where they differ from the scene; those of the equilibrium.
    columns : sequence of str or mapping, optional
        Names of members, and of inputs and actuators, which change the rest lengths of their members
        together; or name of a group -> its members; by default all members.
    tolerance : float
        Largest node residual of an equilibrium, as part of the largest member force.

    Returns
    -------
    Sensitivity
        dq/drho, dt/drho and dr/drho, with their gauge.

    Raises
    ------
    InvalidValueError
        The state is no equilibrium, or an argument has a wrong shape or value.
    SingularStiffnessError
        A motion that is not rigid meets no resistance: a mechanism.
    UnknownNameError, DuplicateNameError
        A wrong column.
    NonFiniteError
        Forces or derivatives are not finite.
    FormulationError
        The model lacks a quantity, or a foot on the ground slips.

    Notes
    -----
    K dq = (df/drho) drho, dt = (dt/dq) dq + (dt/drho) drho with the tangent stiffness K, by one sparse
    factorisation. Rigid motions that cost no force are held by orthogonality, rigid bars by their lengths
    (docs/statics.md).

    Examples
    --------
    >>> from tensegrity_codegen import compile_scene, equilibrium_sensitivity, find_equilibrium
    >>> model = compile_scene("two_nodes.toml", for_=("equilibrium", "sensitivity"))
    >>> found = equilibrium_sensitivity(model, find_equilibrium(model))
    >>> found.node[1].round(9).tolist()  # a weight hangs lower by as much as its spring is longer
    [[0.0], [0.0], [-1.0]]
    """
    require_model(model)
    check_tolerance(tolerance, "tolerance")
    problem = build_problem(model, arguments)
    if problem.memory is not None and problem.memory.flow.size:
        raise FormulationError(
            "sensitivities of equilibria do not know plastic members",
            where=model.manifest.name,
            allowed="elastic members",
            hint="leave yield_force out, or compare two equilibria",
        )
    if has_springs(model.manifest):
        require_quantities(model, REST_LENGTH_QUANTITIES, "a sensitivity needs")
    names, column_members = select_columns(model, columns)
    point = _find_point(problem, equilibrium)
    system = build_system(problem, point)
    _check_balance(problem, point, system, tolerance)
    return _solve(problem, point, system, names, column_members)


def _hold_feet(problem: StaticProblem, equilibrium: Equilibrium | ArrayLike | None) -> None:
    """Let feet on the ground stick where they do in the equilibrium; FormulationError if one slips."""
    contacts = problem.contacts
    feet = equilibrium.feet if isinstance(equilibrium, Equilibrium) else None
    if contacts is None or not contacts.friction or (feet is not None and "slide" in feet.state):
        if contacts is not None:
            contacts.friction = False
        return
    if not isinstance(equilibrium, Equilibrium) or feet is None or "slip" in feet.state:
        raise refuse_ground(
            problem.model.manifest.name,
            "the sensitivity with feet that slip, or of positions alone, which do not say how feet stick",
            "pass the Equilibrium, or choose frictionless=True there, or more friction",
        )
    contacts.begin(equilibrium.node_position, feet.internal)


def _find_point(problem: StaticProblem, equilibrium: Equilibrium | ArrayLike | None) -> Point:
    _hold_feet(problem, equilibrium)
    if isinstance(equilibrium, Equilibrium):
        equilibrium = equilibrium.coordinate
    if equilibrium is None:
        start = problem.model.nominal("coordinate").ravel()
    else:
        start = np.array(
            to_doubles(equilibrium, "equilibrium", f"an Equilibrium, or shape ({problem.size},)")
        )
        check_shape(start, (problem.size,), "equilibrium")
        check_finite(start, "equilibrium")
    point = problem.find_point(problem.to_search_coordinate(start))
    if point is None:
        raise NonFiniteError(
            "the forces at this state are not finite", where=problem.model.manifest.name,
            hint="move coincident nodes apart",
        )  # fmt: skip
    return point


def _check_balance(problem: StaticProblem, point: Point, system: StaticSystem, tolerance: float) -> None:
    """Raise InvalidValueError for a state that is no equilibrium."""
    floor = problem.rounding_floor(system.stiffness, point)
    allowed = max(tolerance * point.largest_force, floor)
    if point.node_force <= allowed:
        return
    raise InvalidValueError(
        "the state is no equilibrium, and has no sensitivity",
        where=problem.model.manifest.name,
        given=f"a node residual of {point.node_force:.6g} N, with a largest member force of "
        f"{point.largest_force:.6g} N",
        allowed=f"at most {allowed:.3g} N",
        hint="find the equilibrium first, with find_equilibrium, and pass it with the same arguments",
    )


def _solve(
    problem: StaticProblem, point: Point, system: StaticSystem, names: tuple[str, ...], column_members: Any
) -> Sensitivity:
    # Hold the motions that cost no force (gauge) and the lengths of rigid bars, by rows beside the stiffness.
    gauge, rounding = find_gauge(problem, point, system)
    constraint_rows = scipy.sparse.vstack([system.constraint, system.build_gauge_rows(gauge)], format="csc")
    factors, is_regular = factorise(system.stiffness, constraint_rows, gauge, max(rounding, 1e-300))
    eigenvalue, direction = factors.find_softest()
    if not is_regular or abs(eigenvalue) <= rounding:
        raise _describe_unresisted_motion(
            problem, point, 0.0 if not is_regular else eigenvalue, rounding, direction
        )
    # Right-hand sides: forces of changed rest lengths, and the changed lengths of rigid bars.
    force = np.asarray((system.force @ column_members).toarray())
    constraint_change = np.zeros((constraint_rows.shape[0], len(names)))
    constraint_change[: len(system.bar)] = column_members[system.bar].toarray()
    displacement, multiplier, refinement_change = factors.solve(force, constraint_change)
    # Tensions: of elastic members by their laws, of rigid bars the multipliers of their lengths.
    tension = np.asarray(
        system.tension_jacobian @ displacement
        + scipy.sparse.diags_array(system.tension_rest_length_derivative) @ column_members
    )
    tension[system.bar] = multiplier[: len(system.bar)]
    manifest = problem.model.manifest
    return Sensitivity(
        coordinate=displacement / system.scale[:, None],
        tension=tension,
        node=find_node_velocities(problem, point, displacement),
        coordinate_name=manifest.coordinate_name,
        node_name=manifest.node_name,
        member_name=manifest.member_name,
        column_name=names,
        gauge=name_gauge(problem, point, gauge, eigenvalue, direction),
        gauge_motion=gauge / system.scale[:, None],
        slack=_find_slack(problem, point, system),
        one_sided=_find_one_sided(problem, point, system),
        smallest_eigenvalue=eigenvalue,
        rounding=refinement_change,
        residual=point.node_force,
        largest_force=point.largest_force,
        bodies=manifest.body_places,
    )


def _find_slack(problem: StaticProblem, point: Point, system: StaticSystem) -> tuple[str, ...]:
    is_slack = (system.tension_rest_length_derivative == 0.0) & (point.tension == 0.0)
    is_slack[system.bar] = False
    return tuple(problem.model.manifest.member_name[e] for e in np.flatnonzero(is_slack))


def _find_one_sided(problem: StaticProblem, point: Point, system: StaticSystem) -> tuple[str, ...]:
    """Return the cables at their rest lengths; none if the model does not compute extensions."""
    model = problem.model
    if not model.has("member_extension"):
        return ()
    extension, length = (
        np.array(problem.compute(name, point.coordinate)) for name in ("member_extension", "member_length")
    )
    is_near = np.abs(extension) <= REST_LENGTH_TOLERANCE * length
    is_near[system.bar] = False
    structure = getattr(model, "structure", None)
    if structure is not None:
        is_near &= structure.tension_only
    return tuple(model.manifest.member_name[e] for e in np.flatnonzero(is_near))


def _describe_unresisted_motion(
    problem: StaticProblem, point: Point, eigenvalue: float, rounding: float, direction: FloatArray
) -> SingularStiffnessError:
    """Return the error of a motion without resistance, with the nodes that move most in it."""
    node_velocity = find_node_velocities(problem, point, direction[:, None])[:, :, 0]
    bodies = problem.model.manifest.body_places
    speed = np.where(find_shown(len(node_velocity), bodies), np.linalg.norm(node_velocity, axis=1), 0.0)
    fastest = np.argsort(-speed, kind="stable")[:MAX_NAMED_NODES]
    largest_speed = speed.max(initial=0.0) or 1.0
    names = label_nodes(problem.model.manifest.node_name, bodies)
    motion = {
        names[k]: [round(float(v), 6) + 0.0 for v in node_velocity[k] / largest_speed]
        for k in fastest
        if speed[k] > 0
    }
    return SingularStiffnessError(
        f"nothing resists a motion of the nodes {', '.join(motion)}: the equilibrium has no sensitivity",
        evidence={"smallest_eigenvalue": eigenvalue, "rounding": rounding, "motion": motion},
        where=problem.model.manifest.name,
        hint="prestress the structure, tighten slack cables, or add members that resist this motion",
    )
