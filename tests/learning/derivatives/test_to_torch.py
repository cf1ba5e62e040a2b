"""Functions of PyTorch: values, transformations, derivatives by its own checks, refusals."""

import sys
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.learning.derivatives.to_torch import to_torch, to_torch_motion
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.system.errors import (
    FormulationError,
    InvalidValueError,
    MissingExtraError,
    UnknownNameError,
)
from tests.learning.derivatives.products import REFUSED
from tests.learning.derivatives.test_motion import T_END

# Where PyTorch sets up forward derivatives, it uses what it no longer recommends.
pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")


@pytest.fixture
def torch() -> Any:
    return pytest.importorskip("torch", reason="needs the package torch")


def variable(torch: Any, value: Any) -> Any:
    return torch.tensor(np.asarray(value), dtype=torch.float64, requires_grad=True)


@pytest.mark.peers
@pytest.mark.parametrize("quantity", ["acceleration", "member_tension"])
def test_quantities_pass_the_checks_of_torch(torch: Any, quantities: CompiledModel, quantity: str) -> None:
    function = to_torch(quantities, quantity)
    q, v = (variable(torch, quantities.nominal(name)) for name in ("coordinate", "velocity"))
    length, winch = variable(torch, [0.55]), variable(torch, [0.01])

    def compute(q: Any, v: Any, length: Any, winch: Any) -> Any:
        return function(q, v, rest_length=length, input=winch)

    found = compute(q, v, length, winch).detach().numpy()
    np.testing.assert_array_equal(found, quantities.compute(quantity, rest_length=[0.55], input=[0.01]))
    assert torch.autograd.gradcheck(compute, (q, v, length, winch), check_forward_ad=True)
    many = variable(torch, q.detach() + 1e-2 * torch.linspace(0.0, 1.0, 3)[:, None])
    assert torch.autograd.gradcheck(compute, (many, v, length, winch), check_forward_ad=True)
    # vmap is one call of a batch; rows and columns of a Jacobian are the same.
    each = torch.func.vmap(function)(many.detach())
    assert torch.equal(each, function(many.detach()))
    gradient = torch.func.grad(lambda q, length: function(q, rest_length=length).sum(), argnums=(0, 1))
    by_each = torch.func.vmap(gradient, in_dims=(0, None))(many.detach(), length.detach())
    assert [tuple(part.shape) for part in by_each] == [(3, 6), (3, 1)]
    forward, backward = torch.func.jacfwd(function)(q.detach()), torch.func.jacrev(function)(q.detach())
    assert torch.allclose(forward, backward, rtol=1e-12)


@pytest.mark.peers
def test_motions_through_contacts_pass_the_checks_of_torch(torch: Any, motions: CompiledModel) -> None:
    """Steps of differences at 1e-6 with a relative tolerance of steps of 1e-10 know 4 digits."""
    drop = to_torch_motion(motions, T_END, rtol=1e-10, outputs=("coordinate", "member_tension"))
    q, v = (variable(torch, motions.nominal(name)) for name in ("coordinate", "velocity"))

    def observe(q: Any, v: Any, length: Any) -> Any:
        found = drop(q, v, rest_length=length)
        return found["coordinate"], found["member_tension"] / 100.0

    options = {"check_forward_ad": True, "eps": 1e-6, "rtol": 1e-4, "atol": 1e-4}
    assert torch.autograd.gradcheck(observe, (q, v, variable(torch, [0.55])), **options)
    schedule = Profile([0.0, 0.1, T_END], {"winch": [0.0, -0.01, -0.02]})
    drive = to_torch_motion(motions, T_END, rtol=1e-10, schedule=schedule)
    knots = variable(torch, [[0.0, -0.01, -0.02], [0.01, 0.0, 0.0]])
    assert torch.autograd.gradcheck(lambda knots: drive(winch=knots)["velocity"], (knots,), **options)


@pytest.mark.peers
def test_failures_types_and_second_derivatives(torch: Any, quantities: CompiledModel) -> None:
    function = to_torch(quantities, "acceleration", on_error="nan", dtype="float32")
    q = torch.tensor(np.tile(quantities.nominal("coordinate"), (3, 1)), dtype=torch.float32)
    q[1, 0] = float("nan")
    q.requires_grad_()
    found = function(q)
    assert found.dtype == torch.float32
    assert torch.isnan(found).any(dim=1).tolist() == [False, True, False]
    (gradient,) = torch.autograd.grad(found[0].sum(), q, create_graph=True)
    assert gradient.dtype == torch.float32
    with pytest.raises(FormulationError, match="no second derivatives"):
        gradient.sum().backward()
    with pytest.raises(FormulationError, match="no second derivatives"):
        torch.func.hessian(lambda q: function(q).sum())(q.detach()[0])
    with pytest.raises(UnknownNameError, match="float64"):
        to_torch(quantities, "acceleration", dtype="double")


@pytest.mark.peers
def test_a_motion_that_fails_has_no_gradient_and_others_have(torch: Any, motions: CompiledModel) -> None:
    drop = to_torch_motion(motions, 0.05, outputs="coordinate", on_error="nan")
    q = torch.tensor(np.stack([motions.nominal("coordinate"), np.full(6, np.nan)]))
    gradient = torch.func.grad(lambda q: drop(q)["coordinate"].sum())
    assert torch.isnan(torch.func.vmap(gradient)(q)).tolist() == [[False] * 6, [True] * 6]
    assert torch.isnan(gradient(q[1])).all()


@pytest.mark.peers
def test_arguments_that_are_no_real_numbers_of_this_shape_are_refused(
    torch: Any, quantities: CompiledModel, motions: CompiledModel
) -> None:
    for function in (to_torch(quantities, "acceleration"), to_torch_motion(motions, 0.05)):
        for arguments, problem in (*REFUSED, ({"coordinate": torch.ones(6) * 1j}, "real numbers")):
            with pytest.raises(InvalidValueError, match=problem):
                function(**arguments)


def test_the_package_is_named_where_it_is_missing(
    quantities: CompiledModel, motions: CompiledModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(MissingExtraError, match="pip install torch"):
        to_torch(quantities, "acceleration")
    with pytest.raises(MissingExtraError, match="pip install torch"):
        to_torch_motion(motions, 0.1)
