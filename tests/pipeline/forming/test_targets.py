"""Shapes nearest to targets: jax_fdm's arch, exact derivatives, ranges that no shape reaches.

Pastrana, Oktay, Adams and Adriaenssens, "JAX FDM: a differentiable solver for inverse form-finding", 2023:
the arch of least load path with segments of 0.75 to 1 m.
"""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.pipeline.forming.form import form
from tensegrity_codegen.pipeline.forming.targets import _Problem, read_targets
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import ConvergenceError, InvalidValueError, UnknownNameError
from tests.pipeline.forming.test_form import arch, check_balance, net


def test_the_arch_of_least_load_path_between_two_lengths() -> None:
    """7.24260693842 N m, crown 2.99339 m; the arch is not symmetric, and its mirror image is as good."""
    found = form(arch(), density={"bars": -1.0}, length_range={"bars": (0.75, 1.0)}, least_load_path=True)
    assert found.load_path == pytest.approx(7.24260693842, abs=1e-10)
    assert found.node_position[:, 2].max() == pytest.approx(2.99339, abs=1e-5)
    assert found.member_length.min() == pytest.approx(0.75, abs=1e-7)
    assert found.member_length.max() == pytest.approx(1.0, abs=1e-7)
    heights = found.node_position[:, 2]
    assert np.abs(heights - heights[::-1]).max() > 0.01
    assert (found.member_tension < 0).all()
    check_balance(found)
    symmetric = form(
        arch(), density={"bars": -1.0}, length_range={"bars": (0.75, 1.0)}, target_length={"m0": 1}
    )
    assert symmetric.load_path > found.load_path


def test_lengths_and_forces_come_near_to_targets() -> None:
    """Two targets of 40 densities are met; of two that exclude each other the heavier counts."""
    found = form(net(5), density={"cables": 20.0}, target_force={"m0": 30.0}, target_length={"m5": 0.36})
    assert found.tension("m0") == pytest.approx(30.0, abs=1e-4)
    assert found.member_length[5] == pytest.approx(0.36, abs=1e-4)
    assert found.status == "stable"
    check_balance(found)
    heavy = form(arch(), density={"bars": -1.0}, target_length={"m0": (1.2, 1e6), "bars": 0.8})
    assert heavy.member_length[0] == pytest.approx(1.2, abs=1e-3)


def test_derivatives_are_those_of_differences() -> None:
    structure, _ = load_scene(arch())
    assert isinstance(structure, Structure)
    stated: dict[str, Any] = {"m2": 0.7, "m3": (0.6, 3.0)}
    targets = read_targets(structure, stated, {"m4": -0.8}, {"bars": (0.75, 1.0)}, True)
    problem = _Problem(structure, -np.ones(10), targets)
    z = 1.0 + 0.1 * np.random.default_rng(3).random(10)
    steps = 1e-6 * np.eye(10)
    slopes = [(problem.find_goal(z + s)[0] - problem.find_goal(z - s)[0]) / 2e-6 for s in steps]
    np.testing.assert_allclose(problem.find_goal(z)[1], slopes, atol=1e-8)
    margins = [(problem.find_margins(z + s) - problem.find_margins(z - s)) / 2e-6 for s in steps]
    np.testing.assert_allclose(problem.differentiate_margins(z), np.transpose(margins), atol=1e-8)


@pytest.mark.parametrize(
    ("call", "kind", "says"),
    [
        ({"length_range": {"bars": (0.1, 0.2)}}, ConvergenceError, "nearest to the targets"),
        ({"target_length": {"bars": 0.4}}, ConvergenceError, "nearest to the targets"),  # a straight line
        ({"length_range": {"bars": (0.2, 0.1)}}, InvalidValueError, "not a length range"),
        ({"length_range": {"bars": (0.2,)}}, InvalidValueError, "not a length range"),
        ({"length_range": {"bars": (np.nan, 1.0)}}, InvalidValueError, "not a length range"),
        ({"target_length": {"bars": -1.0}}, InvalidValueError, "not a target length"),
        ({"target_force": {"bars": (1.0, 0.0)}}, InvalidValueError, "not a target force"),
        ({"target_force": {"rope": 1.0}}, UnknownNameError, "unknown member, group, class or kind"),
        ({"least_load_path": "yes"}, InvalidValueError, "not a switch"),
        ({"density": {"m0": -1.0}, "least_load_path": True}, InvalidValueError, "of every member"),
    ],
)
def test_wrong_targets_are_named(call: dict[str, Any], kind: type[Exception], says: str) -> None:
    with pytest.raises(kind, match=says):
        form(arch(), **{"density": {"bars": -1.0}, **call})


def test_densities_of_both_signs_that_cancel_are_named() -> None:
    """Two members of opposite densities at one node: nothing is left of its stiffness."""
    density = {"bars": -1.0, "m0": 1.0}
    with pytest.raises(ConvergenceError, match="both signs cancel") as caught:
        form(arch(), density={**density, **{f"m{k}": 1.0 for k in range(1, 5)}}, least_load_path=True)
    assert "m" in caught.value.evidence["members"]


def test_too_many_members_are_refused_before_any_search() -> None:
    count = 1002
    nodes = {f"n{k}": {"position": [k, 0, 0], "mass": 1.0} for k in range(count)}
    nodes["n0"]["anchored"] = nodes[f"n{count - 1}"]["anchored"] = True
    members = {
        f"m{k}": {"kind": "cable", "nodes": [f"n{k}", f"n{k + 1}"], "axial_stiffness": 1.0}
        for k in range(count - 1)
    }
    document = {"name": "chain", "nodes": nodes, "members": members}
    with pytest.raises(InvalidValueError, match="too many members for targets"):
        form(document, density={"cables": 1.0}, least_load_path=True)
