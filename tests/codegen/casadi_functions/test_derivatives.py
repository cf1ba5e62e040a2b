"""Derivatives through casadi.external: those of the symbolic functions, in every emitter, and no others."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from tensegrity_codegen.codegen import casadi_functions
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.emitter import prune
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.codegen.quickly import without_optimisation
from tests.codegen.subjects import bare, everything
from tests.codegen.table.subjects import served
from tests.ground_cases import make_belt

WANTED = ("member_tension", "force_density", "node_residual", "total_energy", "acceleration")
MATRICES = ("mass_matrix", "equilibrium_matrix")


def in_tables() -> tuple[Structure, ModelRequest]:
    structure, request = everything()
    structure = structure.with_changes(member_mass=0 * structure.member_mass)
    request = replace(request, emitter="table")
    offered = served(structure, request)
    return structure, request.wanting(*(name for name in (*WANTED, *MATRICES) if name in offered))


def in_space() -> tuple[Structure, ModelRequest]:
    structure, request = everything()
    return structure, request.wanting(*WANTED, *MATRICES)


def of_bodies() -> tuple[Any, ModelRequest]:
    return load_scene("tensegrity_codegen/scene/examples/lin_prism.toml")


def in_plane() -> tuple[Structure, ModelRequest]:
    structure, request = bare()
    return structure, request.wanting(*WANTED)


def on_ground() -> tuple[Structure, ModelRequest]:
    wanted = ("acceleration", "state_derivative", "contact_force", "total_energy", "friction_power")
    return make_belt(0.2), ModelRequest(wanted, parameters={"ground": (0, 2, 3)})


SUBJECTS = {
    "space": in_space,
    "table": in_tables,
    "bodies": of_bodies,
    "plane": in_plane,
    "ground": on_ground,
}


@dataclass(frozen=True)
class Pair:
    """A library with derivatives, and the symbolic functions of the same quantities."""

    model: CompiledModel
    symbolic: dict[str, ca.Function]

    def external(self, quantity: str) -> ca.Function:
        return ca.external(f"{self.model.manifest.name}_{quantity}", str(self.model.path))

    def values(self, quantity: str) -> list[ca.DM]:
        """Values of the arguments near those of the scene, none of them zero."""
        random = np.random.default_rng(0)
        names = self.symbolic[quantity].name_in()
        nominal = [np.atleast_1d(self.model.nominal(name)) for name in names]
        return [ca.DM((value + 0.01 * random.uniform(0.5, 1.0, value.shape)).T) for value in nominal]


@pytest.fixture(scope="module", params=["plane", "ground", *thorough("bodies", "table", "space")])
def pair(request: pytest.FixtureRequest) -> Pair:
    structure, wanted = SUBJECTS[request.param]()
    wanted = replace(wanted, interfaces=("casadi_hessian",), integrators=())
    with without_optimisation():
        built = build_library(structure, wanted).load()
    model = build_model(structure, wanted)
    found = {}
    for spec in built.manifest.functions:
        expression = model.expression(spec.quantity)
        symbols = [model.arguments[name].symbol for name in spec.arguments]
        dense = ca.densify(expression) if spec.pattern is None else expression
        found[spec.quantity] = ca.Function(spec.quantity, symbols, [dense], list(spec.arguments), ["out"])
    return Pair(built, found)


def assert_close(found: ca.DM, expected: ca.DM, what: str) -> None:
    first, second = np.array(ca.DM(found)), np.array(ca.DM(expected))
    assert first.shape == second.shape, what
    scale = max(np.abs(second).max(initial=0.0), 1e-6)
    assert np.abs(first - second).max(initial=0.0) <= 1e-11 * scale, what


def test_jacobians_are_those_of_the_symbolic_functions(pair: Pair) -> None:
    checked = 0
    for name, own in pair.symbolic.items():
        if own.n_in() == 0:
            continue
        found, values = pair.external(name).jacobian(), pair.values(name)
        result = own(*values)
        expected = own.jacobian().call([*values, result])
        for k, block in enumerate(found.call([*values, result])):
            assert_close(block, expected[k], f"{name} by {own.name_in(k)}")
            checked += block.nnz()
    assert checked > 20


def test_patterns_are_sparse_and_named_as_casadi_names_them(pair: Pair) -> None:
    for name, own in pair.symbolic.items():
        if own.n_in() == 0:
            continue
        found = pair.external(name).jacobian()
        assert found.class_name() == "External"
        assert found.name_in() == [*own.name_in(), f"out_{name}"]
        assert found.name_out() == [f"jac_{name}_{argument}" for argument in own.name_in()]
        for k in range(own.n_in()):
            assert found.sparsity_out(k).is_subset(own.jac_sparsity(0, k))
            assert pair.external(name).jac_sparsity(0, k) == found.sparsity_out(k)


def test_second_derivatives_are_those_of_the_symbolic_functions(pair: Pair) -> None:
    sparse = {spec.quantity for spec in pair.model.manifest.functions if spec.pattern is not None}
    for name, own in pair.symbolic.items():
        if own.n_in() == 0 or name in sparse:
            continue
        symbols = [ca.MX.sym(own.name_in(k), *own.size_in(k)) for k in range(own.n_in())]
        weight = ca.MX.sym("weight", *own.size_out(0))
        hessians = []
        for function in (pair.external(name), own):
            product = ca.dot(weight, function(*symbols))
            hessian = ca.hessian(product, ca.veccat(*symbols))[0]
            hessians.append(ca.Function("hessian", [*symbols, weight], [hessian]))
        values = [*pair.values(name), np.random.default_rng(1).normal(size=own.size_out(0))]
        assert_close(hessians[0](*values), hessians[1](*values), name)


def test_a_gradient_needs_no_jacobian(pair: Pair) -> None:
    name = "member_tension" if "member_tension" in pair.symbolic else next(iter(pair.symbolic))
    function, own = pair.external(name), pair.symbolic[name]
    assert function.reverse(1).class_name() == "External"
    symbols = [ca.MX.sym(own.name_in(k), *own.size_in(k)) for k in range(own.n_in())]
    seed = ca.MX.sym("seed", *own.size_out(0))
    values = [*pair.values(name), np.random.default_rng(2).normal(size=own.size_out(0))]
    gradients = [
        ca.Function("g", [*symbols, seed], [ca.gradient(ca.dot(seed, f(*symbols)), symbols[0])])
        for f in (function, own)
    ]
    assert_close(gradients[0](*values), gradients[1](*values), name)


def test_a_bad_argument_is_an_error(pair: Pair) -> None:
    name = next(iter(pair.symbolic))
    function, values = pair.external(name).jacobian(), pair.values(name)
    with pytest.raises(RuntimeError):
        function(ca.DM(values[0]) * np.nan, *values[1:], pair.symbolic[name](*values))


def names_of(structure: Any, request: ModelRequest) -> set[str]:
    text = emit(structure, request).files[f"{structure.name}.c"]
    return set(re.findall(r"^\w+_API casadi_int (\w+)_n_in\(void\);", text, re.MULTILINE))


def parts_of(structure: Any, request: ModelRequest) -> dict[str, Any]:
    return {part.name: part for part in emit(structure, request).manifest.parts}


def test_second_derivatives_are_there_on_request_only() -> None:
    structure, request = bare()
    name = structure.name
    request = request.wanting("member_tension", "tangent_stiffness")
    functions = {f"{name}_member_tension", f"{name}_tangent_stiffness"}
    first = functions | {f"jac_{name}_member_tension"}
    second = {
        f"adj1_{name}_member_tension",
        f"jac_adj1_{name}_member_tension",
        f"jac_{name}_tangent_stiffness",
    }
    assert names_of(structure, request) == set()
    assert names_of(structure, replace(request, interfaces=("casadi",))) == first
    assert names_of(structure, replace(request, interfaces=("casadi_hessian",))) == first | second
    both = replace(request, interfaces=("casadi", "casadi_hessian"))
    assert names_of(structure, both) == first | second


def test_what_is_too_long_is_left_out_and_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    structure, request = bare()
    request = replace(request.wanting(*WANTED), interfaces=("casadi_hessian",))
    functions = prune(build_model(structure, request), request.quantities)
    room = sum(f.operations for f in functions) + 150
    monkeypatch.setattr(casadi_functions, "MAX_OPERATIONS", room)
    parts = parts_of(structure, request)
    assert "too long for unrolled code: " in parts["casadi_derivatives"].why
    some = {name for name in names_of(structure, request) if name.startswith(("jac_", "adj1_"))}
    assert some
    assert not [name for name in some if name in parts["casadi_derivatives"].why]
    monkeypatch.setattr(casadi_functions, "MAX_MEMBERS", 2)
    request = replace(request, quantities=tuple(q for q in request.quantities if q != "node_residual"))
    parts = parts_of(structure, request)
    assert not parts["casadi_derivatives"].is_included
    assert "jac_acceleration" in parts["casadi_derivatives"].why
    assert not [name for name in names_of(structure, request) if name.startswith(("jac_", "adj1_"))]


def test_the_jacobian_of_the_static_force_of_a_large_structure_is_its_stiffness(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(casadi_functions, "MAX_MEMBERS", 2)
    structure, request = bare()
    request = replace(
        request.wanting("node_residual", "acceleration"), interfaces=("casadi",), emitter="table"
    )
    part = parts_of(structure, request)["casadi_derivatives"]
    assert part.is_included
    assert part.why == "interfaces names casadi: 1 function; too long for unrolled code: jac_acceleration"
    with without_optimisation():
        built = build_library(structure, request)
    found = ca.external(f"{structure.name}_node_residual", str(built.path))
    model = build_model(structure, request)
    symbol = model.arguments["coordinate"].symbol
    own = ca.Function(
        "own", [symbol], [ca.densify(model.expression("node_residual"))], ["coordinate"], ["out"]
    )
    value = built.load().nominal("coordinate") + 0.01
    jacobian = found.jacobian()
    assert jacobian.class_name() == "External"
    assert_close(jacobian(value, found(value)), own.jacobian()(value, own(value)), "node_residual")
    with_parameter = replace(request, parameters={"rest_length": (0,)})
    assert "jac_node_residual" in parts_of(structure, with_parameter)["casadi_derivatives"].why


def test_the_parts_say_which_derivatives_there_are() -> None:
    structure, request = bare()
    assert "casadi_derivatives" not in parts_of(structure, request)
    first = parts_of(structure, replace(request, interfaces=("casadi",)))
    assert first["casadi_derivatives"].is_included
    assert first["casadi_second_derivatives"].why == "interfaces does not name casadi_hessian"


def test_a_function_of_no_argument_has_no_derivative() -> None:
    structure, request = bare()
    names = names_of(structure, replace(request.wanting("mass_matrix"), interfaces=("casadi_hessian",)))
    assert names == {f"{structure.name}_mass_matrix"}


Make = Callable[[], tuple[Any, ModelRequest]]


@pytest.mark.parametrize("make", [in_plane, *thorough(in_space, in_tables)], ids=["plane", "space", "table"])
def test_the_other_functions_keep_their_text(make: Make) -> None:
    structure, request = make()
    without = emit(structure, request).files[f"{structure.name}.c"]
    with_it = emit(structure, replace(request, interfaces=("casadi",))).files[f"{structure.name}.c"]
    hashes = re.compile(r'"[0-9a-f]{64}"')
    start = hashes.sub("", without).rpartition("\n#ifndef")[0].rstrip()  # the texts of statuses are the last
    assert hashes.sub("", with_it).startswith(start)
