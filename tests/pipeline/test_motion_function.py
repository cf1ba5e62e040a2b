"""Motions as CasADi functions: values and derivatives of the library, and a problem solved with them."""

import casadi as ca
import numpy as np
import pytest

from tensegrity_codegen.pipeline.motion_function import motion_function
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.system.errors import FormulationError, UnknownNameError
from tests.models import simulator
from tests.runtime.integrate.test_columns import fall

BY = ("velocity", "rest_length", "node_load")
PARAMETERS = {"rest_length": (0,), "node_load": (0, 1)}


def test_values_and_jacobians_are_those_of_the_motion() -> None:
    """A weight that falls onto a damped cable, whose force jumps as it is pulled taut."""
    model = simulator(fall(), "rk853", more=("adjoint_rate",), parameters=PARAMETERS)
    whole = simulator(fall(), "rk853", parameters=PARAMETERS, columns=BY)
    times = [0.0, 0.5, 1.3]
    motion = simulate(
        whole, 1.3, samples=times, method="rk853", rtol=1e-11, stepping=Stepping(control="steps")
    )
    shoot = motion_function(model, 1.3, BY, samples=times, rtol=1e-11)
    given = [ca.DM(model.nominal(name).T) for name in BY]
    states = np.array(shoot(*given))
    np.testing.assert_allclose(states[0], motion.coordinate[:, 0], rtol=1e-9)
    assert motion.columns is not None
    arguments = [ca.MX.sym(name, *value.shape) for name, value in zip(BY, given, strict=True)]
    whole_jacobian = ca.jacobian(ca.vec(shoot(*arguments)), ca.vertcat(*map(ca.vec, arguments)))
    found = np.array(ca.Function("jacobian", arguments, [whole_jacobian])(*given))
    np.testing.assert_allclose(found, motion.columns.reshape(found.shape), rtol=1e-7, atol=1e-9)


def test_single_shooting_finds_the_throw_that_comes_back_at_a_height() -> None:
    model = simulator(fall(), "rk853", more=("adjoint_rate",), parameters={"rest_length": (0,)})
    shoot = motion_function(model, 1.0, ["velocity", "rest_length"])
    problem = ca.Opti()
    velocity, rest = problem.variable(), problem.variable()
    problem.set_initial(rest, 1.0)
    problem.minimize(velocity**2 + 10.0 * (rest - 1.0) ** 2)
    problem.subject_to(shoot(velocity, rest)[0, -1] == -0.9)
    quiet = {"print_time": False, "ipopt.print_level": 0, "ipopt.hessian_approximation": "limited-memory"}
    problem.solver("ipopt", quiet)
    found = problem.solve()
    throw, length = float(found.value(velocity)), float(found.value(rest))
    motion = simulate(model, 1.0, velocity=[throw], arguments={"rest_length": [length]}, rtol=1e-10)
    assert motion.coordinate[-1, 0] == pytest.approx(-0.9, abs=1e-6)
    assert 0.0 < abs(throw) + abs(length - 1.0) < 2.0


def test_wrong_arguments_and_libraries_are_named() -> None:
    with pytest.raises(UnknownNameError, match="gravity"):
        motion_function(simulator(fall(), "rk853", more=("adjoint_rate",)), 1.0, ["gravity"])
    with pytest.raises(FormulationError, match="adjoint_rate"):
        motion_function(simulator(fall(), "rk853"), 1.0, ["velocity"])
