"""The start of a plan: the scene's equilibrium, or the proof that there is none."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.planning.infeasible import find_shape_certificate
from tensegrity_codegen.control.planning.limits import PlanLimits
from tensegrity_codegen.control.planning.plan_point import PlanModel, PlanPoint
from tensegrity_codegen.runtime.analysis.certificate import Certificate
from tensegrity_codegen.runtime.model.named_inputs import INPUT
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.neutral_motion import find_neutral
from tensegrity_codegen.runtime.statics.newton import find_stability
from tensegrity_codegen.runtime.statics.static_problem import StaticProblem
from tensegrity_codegen.structure.applied_inputs import add_inputs_to_rest_length
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import SingularStiffnessError, StructureError, UnstableError

ZERO_EIGENVALUE = 1e-9  # of the stiffness: eigenvalues that count as zero
TAUT_TOLERANCE = 1e-9  # of the length: a cable as long as its rest length is not slack
N_NAMED = 3  # nodes that are named in a motion without resistance
SEARCH_RADIUS = 1e-3  # of the longest member: motion to the equilibrium that is not worth a warning


@dataclass(frozen=True)
class Start:
    """The equilibrium that a plan starts from; with a certificate, a point that no plan starts from."""

    at: PlanPoint
    certificate: Certificate | None = None
    message: str = ""
    shape: FloatArray | None = None
    warnings: tuple[str, ...] = ()


def find_start(plan_model: PlanModel, limits: PlanLimits) -> Start:
    """Return the equilibrium that a plan starts from.

    limits: cables with a least tension must be in tension.
    Returns: the equilibrium at the stated positions if they are one. Else, without loads, the proof that no
        tensions make them one, if there is such a proof; else the equilibrium that find_equilibrium finds.
    Raises ConvergenceError, UnstableError: no stable equilibrium is found.
    Raises StructureError: the stiffness at the start is singular.
    """
    model, change = plan_model.model, plan_model.start
    # The equilibrium near the stated positions.
    stated = plan_model.to_search_coordinate(model.nominal("coordinate").ravel())
    problem = plan_model.problem(change)
    point = problem.find_point(stated)
    longest = 1.0 if point is None else point.longest
    near = None if point is None else plan_model.find_point(change, stated, SEARCH_RADIUS * longest)
    # Without one that is stable and taut: the proof that no tensions make them one.
    if point is not None and (near is None or not _is_sound(near, limits)):
        required = _find_required(plan_model, problem, stated, limits)
        certificate, loaded = find_shape_certificate(plan_model, problem, stated, required)
        if certificate is not None and (near is not None or not loaded):
            beginning = near or plan_model.complete(problem, change, point)
            return Start(beginning, certificate, _describe_stated(limits), stated)
    if near is not None:
        return Start(near)
    # The equilibrium that is found from there.
    arguments = {**plan_model.arguments, INPUT: plan_model.inputs(change)}
    found = find_equilibrium(model, arguments=arguments)
    settled = plan_model.find_point(
        change, plan_model.to_search_coordinate(found.coordinate), SEARCH_RADIUS * longest
    )
    if settled is None:
        raise StructureError(
            "the equilibrium to start from is not found exactly enough",
            where=model.manifest.name,
            given=f"residual {found.residual:.3g} N, smallest eigenvalue {found.smallest_eigenvalue:.3g} N/m",
            allowed="a stable equilibrium with a regular stiffness",
            hint="anchor nodes, or give the structure prestress",
        )
    text = (
        "the stated positions are no equilibrium: the plan starts from the equilibrium that is found, where "
        f"node {found.changed_node} is {found.change:.3g} m away"
    )
    return Start(settled, warnings=(text, *found.warnings))


def _find_required(
    plan_model: PlanModel, problem: StaticProblem, stated: FloatArray, limits: PlanLimits
) -> NDArray[np.bool_]:
    """Return which members must be in tension: with a least tension, or cables that are not slack."""
    structure = plan_model.model.structure
    assert structure is not None
    length = np.asarray(problem.compute("member_length", stated)).ravel()
    _, tension = problem.forces(stated)
    inputs = zip(plan_model.model.manifest.input_name, plan_model.base.ravel().tolist(), strict=True)
    rest = add_inputs_to_rest_length(structure, dict(inputs))
    is_taut = (tension > 0.0) | (np.abs(length - rest) <= TAUT_TOLERANCE * length)
    return np.asarray((limits.least_tension > 0.0) | (structure.tension_only & is_taut))


def _describe_stated(limits: PlanLimits) -> str:
    """Return what is proved of the stated shape, and what to do."""
    least = " or that have a least tension" if bool(np.any(limits.least_tension > 0.0)) else ""
    return (
        "at the stated shape no tensions, whatever the rest lengths, are in balance with the cables in "
        f"tension that are not slack there{least}: no plan starts from the stated shape. A plan may exist "
        f"from another shape: settle the scene first "
        "(`equilibrium SCENE -o NEW.toml`) and plan from there"
    )


def _is_sound(at: PlanPoint, limits: PlanLimits) -> bool:
    """Return whether an equilibrium is stable, with all members in tension that have a least tension."""
    stiffest = float(abs(at.stiffness).max()) if at.stiffness.nnz else 0.0
    is_stable = len(at.eigenvalue) == 0 or float(at.eigenvalue[0]) > ZERO_EIGENVALUE * stiffest
    return is_stable and bool(np.all(at.tension[limits.least_tension > 0.0] > 0.0))


def check_stability(plan_model: PlanModel, at: PlanPoint) -> None:
    """Raise where an equilibrium is unstable, or neutral: a stiffness of zero to rounding is not unstable.

    Raises UnstableError: the smallest eigenvalue is negative beyond rounding.
    Raises SingularStiffnessError: it is zero to rounding; the nodes that move most are named.
    """
    problem, name = plan_model.problem(at.change), plan_model.model.manifest.name
    stability = find_stability(problem, at.point)
    if stability.is_unstable:
        raise UnstableError(
            "the start is an unstable equilibrium",
            where=name,
            evidence={"smallest_eigenvalue": stability.model_eigenvalue},
            hint="start from a stable one: find it with `equilibrium`, or raise the prestress",
        )
    if not stability.is_neutral:
        return
    count = find_neutral(problem, at.coordinate, stability).mechanism.shape[2]
    field = problem.node_velocities(at.coordinate, stability.direction[:, None])[:, :, 0]
    size = np.linalg.norm(field, axis=1)
    nodes = [plan_model.model.manifest.node_name[k] for k in np.argsort(-size, kind="stable")[:N_NAMED]]
    many = f"{count} independent motions" if count > 1 else "a motion"
    whole = " besides rigid motions of the whole" if at.neutral.shape[1] else ""
    raise SingularStiffnessError(
        f"the start is neutral: nothing resists {many}{whole}, such as one of the nodes {', '.join(nodes)}",
        where=name,
        evidence={"smallest_eigenvalue": stability.model_eigenvalue, "rounding": stability.rounding},
        hint="prestress the structure, or anchor or join unconnected parts; `analyse` shows the motions",
    )
