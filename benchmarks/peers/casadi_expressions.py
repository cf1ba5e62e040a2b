"""The physics as a CasADi user writes it: SX member by member, or MX with a map over the members."""

from typing import Any

import casadi as ca
import numpy as np
from harness.problem import Problem
from harness.tools import Unavailable


def unrolled(problem: Problem, quantity: str) -> ca.Function:
    """Return f(coordinate) as one SX expression; Jacobians by CasADi's own differentiation."""
    q = ca.SX.sym("q", len(problem.free))
    if quantity == "state_jacobian":
        velocity = ca.SX.sym("v", len(problem.free))
        force = ca.vec(_force(problem, q)[0])[problem.free.tolist()]
        rate = ca.vertcat(velocity, force / problem.mass)
        result = ca.jacobian(rate, ca.vertcat(q, velocity))
    else:
        force, energy = _force(problem, q)
        free = ca.vec(force)[problem.free.tolist()]
        results = {
            "node_force": lambda: ca.vec(force),
            "elastic_energy": lambda: energy,
            "tangent_stiffness": lambda: -ca.jacobian(free, q),
            "acceleration": lambda: free / problem.mass,
        }
        result = results[quantity]()
    return ca.Function("peer", [q], [ca.cse(result)])


def _force(problem: Problem, q: Any) -> tuple[Any, Any]:
    """Return the node forces (3, n_nodes) and the strain energy."""
    flat = ca.SX(problem.fixed_position)
    flat[problem.free.tolist()] = q
    nodes = [flat[3 * k : 3 * k + 3] for k in range(problem.n_nodes)]
    force = [ca.SX(row) for row in problem.external]
    energy = ca.SX(0)
    ends = zip(problem.first.tolist(), problem.second.tolist(), strict=True)
    for e, (i, j) in enumerate(ends):
        vector = nodes[i] - nodes[j]
        length = ca.sqrt(ca.dot(vector, vector))
        mu, rho = float(problem.mu[e]), float(problem.rest_length[e])
        density, strain = mu * (1 - rho / length), 0.5 * mu * (length - rho) ** 2
        if problem.tension_only[e]:
            density = ca.if_else(length > rho, density, 0)
            strain = ca.if_else(length > rho, strain, 0)
        force[i] = force[i] - density * vector
        force[j] = force[j] + density * vector
        energy = energy + strain
    return ca.horzcat(*force), energy


def own_expression(problem: Problem, quantity: str) -> ca.Function:
    """Return the package's own expression of the quantity, for CasADi to evaluate or to print."""
    from tensegrity_codegen.codegen.emitter import prune
    from tensegrity_codegen.symbolic.build import build_model

    pruned = prune(build_model(problem.structure, problem.request(quantity)), (quantity,))[0]
    if pruned.arguments != ("coordinate",):
        raise Unavailable(f"depends on {', '.join(pruned.arguments)}")
    return pruned.function


def mapped(problem: Problem, quantity: str) -> ca.Function:
    """Return f(coordinate) as MX: a member's SX function mapped over members, summed by sparse matrices."""
    kernel, size = _kernel(quantity)
    q = ca.MX.sym("q", len(problem.free))
    held = np.setdiff1d(np.arange(3 * problem.n_nodes), problem.free)
    order = np.argsort(np.concatenate([problem.free, held]), kind="stable")
    whole = q if problem.is_all_free else ca.vertcat(q, ca.DM(problem.fixed_position[held]))[order.tolist()]
    nodes = ca.reshape(whole, 3, problem.n_nodes)
    constants = (problem.mu, problem.rest_length, problem.tension_only.astype(float))
    rows = [ca.DM(row).T for row in constants]
    ends = (nodes[:, problem.first.tolist()], nodes[:, problem.second.tolist()])
    terms = kernel.map(problem.n_members)(*ends, *rows)
    if quantity == "node_force":
        result = ca.vec(ca.DM(problem.external.T) + ca.mtimes(terms, ca.DM(problem.incidence.T.tocsc())))
    elif quantity == "elastic_energy":
        result = ca.sum2(terms)
    else:
        adds = problem.stiffness_pattern.matrix(problem.n_members)
        result = ca.mtimes(ca.DM(adds.tocsc()), ca.reshape(terms, size * problem.n_members, 1))
    return ca.Function("peer", [q], [result])


def _kernel(quantity: str) -> tuple[ca.Function, int]:
    """Return the function of one member and how many values it has; raises Unavailable."""
    a, b = ca.SX.sym("a", 3), ca.SX.sym("b", 3)
    mu, rho, slackens = ca.SX.sym("mu"), ca.SX.sym("rho"), ca.SX.sym("slackens")
    d = a - b
    length = ca.sqrt(ca.dot(d, d))
    taut = ca.if_else(ca.logic_and(slackens, length <= rho), 0, mu)
    along = taut * rho / length
    results = {
        "node_force": (taut - along) * d,
        "elastic_energy": 0.5 * taut * (length - rho) ** 2,
        "tangent_stiffness": ca.vec(along / length**2 * ca.mtimes(d, d.T) + (taut - along) * ca.SX.eye(3)),
    }
    if quantity not in results:
        raise Unavailable("left to force, energy and stiffness")
    result = ca.densify(results[quantity])
    return ca.Function("member", [a, b, mu, rho, slackens], [result]), result.numel()
