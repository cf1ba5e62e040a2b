"""Single precision: the same functions, rounded to float; nothing converts unasked."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.emitter import prune
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.rk4 import integrate_rk4
from tensegrity_codegen.runtime.linear.linearize import linearize
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.paths.c_equilibrium import EquilibriumSolver
from tensegrity_codegen.runtime.paths.model_path import ModelPath
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.studies.papers.sk.offset import evaluate_in
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.system.errors import (
    AbiMismatchError,
    FormulationError,
    InvalidValueError,
    LibraryError,
    NonFiniteError,
    UnknownNameError,
)
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.codegen.compilers import EACH_FAMILY, require_compiler
from tests.codegen.running_error import evaluate_with_bound
from tests.codegen.subjects import bare, everything, in_single_precision, offered
from tests.ground_cases import make_prism
from tests.runtime.integrate.test_ground import rotate

ROUNDING = float(np.finfo(np.float32).eps) / 2
EXAMPLES = Path(__file__).resolve().parents[2] / "tensegrity_codegen/scene/examples"
LARGEST = float(np.finfo(np.float32).max)


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    return build_library(*in_single_precision(everything)).load()


def nearby(model: CompiledModel, seed: int) -> dict[str, np.ndarray]:
    """Return arguments a little off the nominal ones, float32."""
    rng = np.random.default_rng(seed)
    found = {}
    for spec in model.manifest.arguments:
        nominal = model.nominal(spec.name)
        scale = 1e-3 * np.maximum(np.abs(nominal), 0.1)
        found[spec.name] = (nominal + rng.uniform(-1, 1, nominal.shape) * scale).astype(np.float32)
    return found


def stored(model: CompiledModel, quantity: str, arguments: dict[str, np.ndarray]) -> np.ndarray:
    """Return the numbers of a quantity as C stores them."""
    function = model.function(quantity)
    return np.ravel(function.values([arguments[name] for name in function.arguments]))


# --- numbers ---------------------------------------------------------------------------------------


@pytest.mark.optimised
@pytest.mark.parametrize("family", EACH_FAMILY)
@pytest.mark.parametrize("subject", [*thorough(everything), bare], ids=["everything", "bare"])
def test_every_operation_is_rounded_to_float(subject: Any, family: str) -> None:
    """Bit for bit what NumPy computes with float32, one operation after the other."""
    require_compiler(family)
    structure, request = in_single_precision(subject)
    model, functions = build_library(structure, request, compiler=family).load(), offered(structure, request)
    compared = 0
    for seed in range(3):
        arguments = nearby(model, seed)
        for quantity in request.quantities:
            try:
                expected = evaluate_in(np.float32, functions[quantity], arguments)
            except FormulationError:  # an operation that this evaluation does not know
                continue
            found = stored(model, quantity, arguments)
            assert found.dtype == np.float32
            np.testing.assert_array_equal(found, expected, err_msg=quantity)
            compared += 1
    assert compared >= len(request.quantities)


@pytest.mark.parametrize("subject", [*thorough(everything), bare], ids=["everything", "bare"])
def test_it_agrees_with_double_precision_within_the_rounding_of_its_terms(subject: Any) -> None:
    structure, request = in_single_precision(subject)
    model, functions = build_library(structure, request).load(), offered(structure, request)
    for seed in range(3):
        arguments = nearby(model, seed)
        for quantity in request.quantities:
            exact, bound = evaluate_with_bound(functions[quantity], arguments, ROUNDING)
            off = np.abs(stored(model, quantity, arguments) - exact)
            assert (off <= 1.01 * bound).all(), quantity
            assert bound.max() <= 1e-3 * np.abs(exact).max(), f"{quantity}: a bound that says nothing"


@pytest.mark.thorough
@pytest.mark.parametrize("scene", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.stem)
def test_every_shipped_scene_has_its_functions_in_single_precision(scene: Path) -> None:
    structure, request = load_scene(scene)
    model = build_library(structure, replace(request, precision="single", solvers=())).load()
    arguments = {spec.name: model.nominal(spec.name) for spec in model.manifest.arguments}
    for function in prune(build_model(structure, request), request.quantities):
        # Sines and cosines of <math.h> are right within a unit in the last place, twice the rounding.
        exact, bound = evaluate_with_bound(function, arguments, 2 * ROUNDING)
        assert (np.abs(stored(model, function.quantity.name, arguments) - exact) <= 1.01 * bound).all()


def test_nominal_values_are_the_scene_s_rounded_once(model: CompiledModel) -> None:
    whole = build_library(*everything()).load()
    for spec in model.manifest.arguments:
        assert model.nominal(spec.name).dtype == np.float32
        np.testing.assert_array_equal(model.nominal(spec.name), whole.nominal(spec.name).astype(np.float32))


# --- integrators -----------------------------------------------------------------------------------


def integrate(model: CompiledModel, name: str, span: float) -> tuple[int, np.ndarray, np.ndarray]:
    """Call an integrator of the library itself; return status, final state and sample at half the span."""
    ffi, real = model.library.ffi, model.dtype
    spec = next(item for item in model.manifest.integrators if item.name == name)

    def pointer(array: np.ndarray) -> Any:
        return ffi.from_buffer("double[]" if array.dtype == np.float64 else "float[]", array)

    state = np.concatenate([model.nominal("coordinate"), model.nominal("velocity")])
    state = np.concatenate([state, np.zeros(len(model.manifest.internal_name), real)])
    samples = np.zeros((1, state.size), real)
    times, work = np.array([span / 2]), np.empty(spec.work_size, real)
    passed = [pointer(model.nominal(argument)) for argument in spec.arguments]
    count, done = ffi.new("long long *"), ffi.new("long long *")
    tail = [*passed, 1, pointer(times), pointer(samples), count, done]
    if name == "rk4":
        steps = 1000
        head = [0.0, span / steps, 0, steps, pointer(state)]
        status = model.library.symbol(spec.symbol)(*head, *tail, pointer(work))
    else:
        time, step = ffi.new("double *", 0.0), ffi.new("double *", 0.0)
        head = [span, 1e-5, 1e-6, 100_000, time, step, pointer(state)]
        run = ffi.new("integrator_run *")
        status = model.library.symbol(f"{spec.symbol}_run")(*head, *tail[:-1], run, pointer(work))
        assert run.n_accepted > 1
        assert time[0] == span
    assert count[0] == 1
    return status, state, samples[0]


@pytest.mark.parametrize("name", ["rk54", "rk853"])
def test_structures_on_the_ground_bounce_slip_and_stick(name: str) -> None:
    """A tilted prism of springs that lands 0.1 s after its drop; its bristles are states too."""
    prism = make_prism(rotate((0.0, 0.3, 0.2)))
    place = prism.node_position - [0.0, 0.0, 0.45]
    prism = prism.with_changes(
        spring_constant=np.where(prism.is_bar, 2e4, prism.spring_constant), node_position=place
    )
    quantities = ("acceleration", "contact_force", "contact_margin", "stick_margin", "internal_rate")
    found = {}
    for precision in ("single", "double"):
        request = ModelRequest(quantities, integrators=(name,), precision=precision, events=())
        model = build_library(prism, request).load()
        status, state, _ = integrate(model, name, 0.11)
        assert status == 0
        at = {"coordinate": state[:18], "velocity": state[18:36], "internal": state[36:]}
        force = model.compute("contact_force", **at)
        assert np.abs(force).max() > 1.0
        found[precision] = state
    assert found["single"].dtype == np.float32
    error = np.abs(found["single"] - found["double"])
    assert error[:36].max() < 1e-3 * np.abs(found["double"][:36]).max()
    assert error[36:].max() < 0.05 * np.abs(found["double"][36:]).max()


@pytest.mark.parametrize("name", ["rk4", "rk54", "rk853"])
def test_integrators_follow_the_motion_in_double_precision(model: CompiledModel, name: str) -> None:
    whole = build_library(*everything()).load()
    for found, expected in zip(integrate(model, name, 0.2), integrate(whole, name, 0.2), strict=True):
        if isinstance(found, int):
            assert found == expected == 0
        else:
            assert found.dtype == np.float32
            # Each step is right within 1e-5; the motion has kinks where cables go slack.
            assert np.abs(found - expected).max() < 3e-4 * np.abs(expected).max()


# --- types -----------------------------------------------------------------------------------------


def test_results_are_float32(model: CompiledModel) -> None:
    assert model.compute("member_tension").dtype == np.float32
    assert model.compute("tangent_stiffness").dtype == np.float32
    out = np.empty(6, np.float32)
    assert model.compute("member_tension", out=out) is out


def test_numbers_without_a_type_are_rounded(model: CompiledModel) -> None:
    listed = [0.1 * k for k in range(8)]
    expected = model.compute("member_length", coordinate=np.array(listed, np.float32))
    np.testing.assert_array_equal(model.compute("member_length", coordinate=listed), expected)


def test_an_array_of_doubles_is_not_rounded_silently(model: CompiledModel) -> None:
    with pytest.raises(InvalidValueError, match="would round") as caught:
        model.compute("member_length", coordinate=np.zeros(8))
    assert (caught.value.where, caught.value.given) == ("coordinate", "float64")
    assert "float32" in caught.value.hint


def test_an_out_of_doubles_is_refused(model: CompiledModel) -> None:
    with pytest.raises(InvalidValueError, match="`out` has the wrong type or shape"):
        model.compute("member_tension", out=np.empty(6))


def test_a_number_beyond_float_is_not_finite(model: CompiledModel) -> None:
    with pytest.raises(NonFiniteError, match=r"'coordinate' is not finite at \(0,\)"):
        model.compute("member_length", coordinate=[1e39] * 8)


@pytest.mark.parametrize(("built", "asked"), [("double", "single"), ("single", "double")])
def test_a_library_of_the_other_precision_is_refused(built: str, asked: str) -> None:
    structure, request = bare()
    library = build_library(structure, replace(request, precision=built))
    with pytest.raises(LibraryError, match=f"of {built} precision, where {asked} precision") as caught:
        library.load(precision=asked)
    assert asked in caught.value.hint
    with pytest.raises(LibraryError):
        CompiledModel(library.path, precision=asked)
    assert library.load(precision=built).library.precision.name == built


def test_an_unknown_precision_of_a_library_lists_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match="unknown precision") as caught:
        build_library(*bare()).load(precision="half")
    assert caught.value.allowed == "double, single"


def test_a_manifest_of_another_precision_is_noticed() -> None:
    library = build_library(*bare())
    with pytest.raises(AbiMismatchError, match="different precision"):
        CompiledModel(library.path, replace(library.manifest, precision="single"))


# --- what needs double precision -------------------------------------------------------------------

SPAN = np.array([0.0, 0.1])
ANALYSES = {
    "simulate": lambda model: simulate(model, 0.1),
    "simulate by SciPy": lambda model: simulate(model, 0.1, method="scipy_rk45"),
    "rk4": lambda model: integrate_rk4(Motion(model, np.zeros(16), SPAN), RunOptions("rk4", step=1e-3)),
    "rk853": lambda model: simulate(model, 0.1, method="rk853"),
    "equilibrium": find_equilibrium,
    "equilibrium in C": EquilibriumSolver,
    "linearize": linearize,
    "load path": lambda model: ModelPath(model, np.zeros((4, 3))),
    "contact": lambda model: simulate(model, 0.1, until="contact"),
}


@pytest.mark.parametrize("analysis", ANALYSES)
def test_analyses_from_python_need_double_precision(model: CompiledModel, analysis: str) -> None:
    with pytest.raises(LibraryError, match="needs a library of double precision") as caught:
        ANALYSES[analysis](model)
    assert caught.value.where == "braced: model.precision"
    assert "double precision" in caught.value.hint


def test_solvers_need_double_precision() -> None:
    structure, request = in_single_precision(everything)
    with pytest.raises(FormulationError, match="solvers need double precision") as caught:
        emit(structure, replace(request, solvers=("equilibrium",)))
    assert caught.value.where == "braced: model.solvers"
    assert "equilibrium" in caught.value.given
    assert "double" in caught.value.hint


@pytest.mark.thorough
def test_casadi_cannot_call_it_and_is_not_offered_to() -> None:
    name = "braced_member_tension_n_in"
    structure, request = everything()
    assert name in emit(structure, replace(request, interfaces=("casadi",))).files["braced.c"]
    structure, request = in_single_precision(everything)
    assert "casadi_int" not in emit(structure, request).files["braced.c"]
    with pytest.raises(FormulationError, match="interfaces need double precision"):
        emit(structure, replace(request, interfaces=("casadi",)))


# --- numbers too large -----------------------------------------------------------------------------


def test_an_unknown_precision_is_refused_with_the_known_ones() -> None:
    structure, request = bare()
    with pytest.raises(UnknownNameError, match="unknown precision") as caught:
        emit(structure, replace(request, precision="float"))
    assert (caught.value.where, caught.value.allowed) == ("model.precision", "double, single")


@pytest.mark.parametrize(
    ("field", "index", "owner"),
    [
        ("rest_length", 2, "e2"),
        *thorough(("spring_constant", 0, "e0"), ("node_mass", 1, "n1"), ("gravity", 2, "2")),
    ],
)
def test_a_value_beyond_float_is_named(field: str, index: int, owner: str) -> None:
    structure, request = in_single_precision(everything)
    request = replace(request, quantities=("acceleration",), integrators=())
    values = getattr(structure, field).copy()
    values[index] = 1e40
    large = structure.with_changes(**{field: values})
    with pytest.raises(InvalidValueError, match="too large for single precision") as caught:
        emit(large, request)
    assert caught.value.where == f"braced: {field} of {owner}"
    assert caught.value.given == 1e40
    assert "double" in caught.value.hint
    emit(large, replace(request, precision="double"))


def test_a_product_beyond_float_is_named_by_its_function() -> None:
    structure, request = in_single_precision(bare)
    large = structure.with_changes(
        spring_constant=np.zeros(3), rest_length=np.full(3, 1e-20), axial_stiffness=np.full(3, 1e30)
    )
    with pytest.raises(InvalidValueError, match="too large for single precision") as caught:
        emit(large, replace(request, quantities=("member_tension",)))
    assert "a constant of" in caught.value.where


def test_the_largest_float_itself_is_fine() -> None:
    structure, request = in_single_precision(bare)
    values = structure.node_mass.copy()
    values[0] = LARGEST
    assert emit(structure.with_changes(node_mass=values), request).manifest.precision == "single"
