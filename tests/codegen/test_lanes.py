"""Four members at a time: the bits of the virtual machine, the statuses of the plain statements."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegrity_codegen.codegen.compilation.compile import compile_library
from tensegrity_codegen.codegen.compilation.flags import FLAG_SETS, FlagSet
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.lanes.emitter import FORCE_QUANTITIES
from tensegrity_codegen.codegen.lanes.kernel import BLOCKS, KernelKind, build_kernel
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import NonFiniteError
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import draws, thorough
from tests.codegen.compilers import EACH_FAMILY, require_compiler
from tests.codegen.subjects import all_parameters, everything, offered
from tests.codegen.test_generated_c import arguments_near, assert_same_bits, raw_call
from tests.comparison import dense, run_in_casadi
from tests.random_structures import make_structure, structures
from tests.runtime.build import bar, cable, prism
from tests.runtime.build import make_structure as node_structure

SLOW = draws(2)
EVERY_WISH = ("gravity", "damping", "loads", "velocity", "anchors", "bar_mass", "inputs", "slack")
VECTORS = "lanes_xyz force_"


def in_space(seed: int, n_nodes: int = 9) -> Structure:
    return make_structure(np.random.default_rng(seed), n_nodes, (0, 1, 2), dict.fromkeys(EVERY_WISH, True))


def in_lanes(structure: Structure, changeable: bool) -> tuple[ModelRequest, dict[str, object]]:
    parameters = all_parameters(structure) if changeable else {}
    functions = offered(structure, ModelRequest((), parameters=parameters))
    wanted = {
        name: function for name, function in functions.items() if name in FORCE_QUANTITIES or name in BLOCKS
    }
    return ModelRequest(tuple(wanted), parameters=parameters, emitter="lanes"), wanted


def build(structure: Structure, request: ModelRequest, **how: str) -> CompiledModel:
    return build_library(structure, request, **how).load()


@given(structures(most_nodes=5), st.booleans(), st.integers(0, 2**32 - 1))
@SLOW
def test_random_structures_equal_the_virtual_machine(
    structure: Structure, changeable: bool, seed: int
) -> None:
    request, functions = in_lanes(structure, changeable)
    model = build(structure, request)
    arguments = arguments_near(model, seed)
    for name, function in functions.items():
        assert_same_bits(model.compute(name, **arguments), run_in_casadi(function, arguments), name)


@pytest.mark.thorough
@pytest.mark.optimised
@pytest.mark.parametrize("flags", ["reference", "native"])
@pytest.mark.parametrize("family", EACH_FAMILY)
@pytest.mark.parametrize("changeable", [False, True])
def test_every_compiler_and_both_flag_sets_give_the_same_bits(
    family: str, flags: str, changeable: bool
) -> None:
    require_compiler(family)
    seed = int(changeable)
    structure = in_space(seed)
    request, functions = in_lanes(structure, changeable)
    model = build(structure, request, compiler=family, flags=flags)
    arguments = arguments_near(model, seed)
    for name, function in functions.items():
        assert_same_bits(model.compute(name, **arguments), run_in_casadi(function, arguments), name)


def test_without_registers_of_vectors_bits_and_statuses_are_the_same(tmp_path: Path) -> None:
    structure = in_space(2, 6)
    for request in (in_lanes(structure, True)[0], ModelRequest(("node_residual",), emitter="lanes")):
        source, vectors = emit(structure, request), build(structure, request)
        flags = FlagSet("alone", (*FLAG_SETS["reference"].options, "-DTENSEGRITY_NO_LANES"))
        name = source.manifest.name
        files = {file: source.files[file] for file in (f"{name}.c", f"{name}.h")}
        made = compile_library(files, name=name, compiler=find_compiler(), flags=flags)
        path = tmp_path / f"{len(request.quantities)}_{made.file_name}"
        path.write_bytes(made.library)
        alone = CompiledModel(path, source.manifest)
        arguments = arguments_near(vectors, 2)
        for quantity in request.quantities:
            expected = raw_call(vectors, quantity, **arguments)[1]
            assert_same_bits(raw_call(alone, quantity, **arguments)[1], expected, quantity)
            for value in (np.nan, np.inf, 1e120, 1e308):
                changed = vectors.nominal("coordinate")
                changed.flat[-1] = value
                assert (
                    raw_call(alone, quantity, coordinate=changed)[0]
                    == (raw_call(vectors, quantity, coordinate=changed)[0])
                )


@pytest.mark.thorough
@pytest.mark.parametrize("flags", ["reference", *thorough("native")])
def test_every_status_is_that_of_the_unrolled_code(flags: str) -> None:
    structure = in_space(3)
    request, _ = in_lanes(structure, True)
    lanes = build(structure, request, flags=flags)
    plain = build(structure, replace(request, emitter="unrolled"), flags=flags)
    for spec in lanes.manifest.functions:
        assert raw_call(lanes, spec.quantity)[0] == "ok"
        for name in spec.arguments:
            for entry in range(lanes.nominal(name).size):
                value = (np.nan, np.inf, 1e308)[entry % 3]
                changed = lanes.nominal(name)
                changed.flat[entry] = value
                status, result = raw_call(lanes, spec.quantity, **{name: changed})
                expected, values = raw_call(plain, spec.quantity, **{name: changed})
                assert status == expected, (spec.quantity, name, entry, value)
                np.testing.assert_array_equal(result, values)


@pytest.mark.parametrize("precision", ["double", *thorough("single")])
@pytest.mark.parametrize("emitter", ["unrolled", "lanes", "table"])
def test_a_slack_cable_between_coincident_nodes_does_not_pull(emitter: str, precision: str) -> None:
    place = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    members = [cable(1, 2, 0.5, damping=2.0), cable(0, 1, 0.9, damping=2.0), bar(2, 3, 1.5, mu=100.0)]
    structure = node_structure(place, members)
    request = ModelRequest(("node_force", "state_jacobian"), emitter=emitter, precision=precision)
    model = build(structure, request)
    push = 100.0 * (1.5 - np.sqrt(2.0)) / np.sqrt(2.0)
    force = [[10.0, 0, 0], [-10.0, 0, 0], [push, -push, 0], [-push, push, 0]]
    found = model.compute("node_force")
    np.testing.assert_allclose(found.reshape(4, 3), force, atol=1e-4 if precision == "single" else 1e-13)
    assert np.isfinite(dense(model.compute("state_jacobian", velocity=list(range(12))))).all()
    coordinate = np.array(place, dtype=model.dtype)
    coordinate[2] = coordinate[3]
    with pytest.raises(NonFiniteError, match="the result is not finite"):  # of the bar
        model.compute("node_force", coordinate=coordinate.ravel())


@pytest.mark.parametrize("flags", ["reference", *thorough("native")])
def test_coincident_nodes_are_reported_and_give_nan(flags: str) -> None:
    structure = in_space(4)
    i, j = structure.connectivity[0]
    position = structure.node_position.copy()
    position[j] = position[i]
    request = ModelRequest(("node_residual", "acceleration"), emitter="lanes")
    model = build(structure.with_changes(node_position=position), request, flags=flags)
    for quantity in request.quantities:
        status, result = raw_call(model, quantity)
        assert status == "non_finite_result"
        assert np.isnan(result).all()


def slack_net(n_nodes: int, load: float = 0.0) -> Structure:
    """Cables alone, all slack: whatever a coordinate is, they do not pull."""
    rng = np.random.default_rng(8)
    members = [cable(k, (k + 1) % 5, 100.0) for k in range(5)]
    return node_structure(rng.normal(size=(n_nodes, 3)), members, load={0: (load, 0.0, 0.0)})


@pytest.mark.parametrize(
    ("structure", "by_sums"),
    [
        (slack_net(5), True),
        *thorough((slack_net(6), False), (prism(150.0), True), (slack_net(5, 1e300), False)),
    ],
)
def test_sums_over_members_miss_no_argument_and_no_result(structure: Structure, by_sums: bool) -> None:
    wanted = ("node_residual", "node_force", "tangent_stiffness")
    request = ModelRequest(wanted, emitter="lanes")
    lanes = build(structure, request)
    plain = build(structure, replace(request, emitter="unrolled"))
    assert ("pack_is_below(length_sum + density_sum" in source_of(structure, request)) == by_sums
    for quantity in wanted:
        assert lanes.function(quantity).arguments == ("coordinate",)
        for entry in range(lanes.nominal("coordinate").size):
            for value in (np.nan, np.inf, -np.inf, 1e99, 1e120, 1e160, -1e308, 1e-160, 5e-324):
                changed = lanes.nominal("coordinate")
                changed.flat[entry] = value
                found, expected = (raw_call(model, quantity, coordinate=changed) for model in (lanes, plain))
                assert found[0] == expected[0], (quantity, entry, value)
                np.testing.assert_array_equal(found[1], expected[1])


def test_a_stiffness_too_large_to_add_up_is_looked_at_entry_by_entry() -> None:
    structure = in_space(7, 5)
    stiff = structure.with_changes(
        spring_constant=np.full(structure.n_members, 1e301), axial_stiffness=np.zeros(structure.n_members)
    )
    model = build(stiff, ModelRequest(("material_stiffness",), emitter="lanes"))
    assert raw_call(model, "material_stiffness")[0] == "ok"
    huge = stiff.with_changes(spring_constant=np.full(structure.n_members, 1.7e308))
    model = build(huge, ModelRequest(("material_stiffness",), emitter="lanes"))
    status, result = raw_call(model, "material_stiffness")
    assert (status, np.isnan(result).all()) == ("non_finite_result", True)


def test_a_slack_cable_pulls_with_exact_zeros() -> None:
    structure = in_space(5)
    none = np.zeros(structure.n_members)
    slack = structure.with_changes(
        tension_only=none == 0,
        is_bar=none != 0,
        member_mass=none,
        rest_length=2 * structure.member_length(),
        gravity=np.zeros(3),
        node_load=np.zeros((structure.n_nodes, 3)),
        damping=none,
    )
    model = build(slack, ModelRequest(("node_force",), emitter="lanes"))
    np.testing.assert_array_equal(dense(model.compute("node_force")), 0.0)


def test_only_forces_in_space_in_doubles_are_written_in_vectors() -> None:
    structure, request = everything()
    assert len(structure.axes) == 3 or VECTORS not in source_of(structure, request)
    space = in_space(6)
    wanted = ModelRequest(("node_residual", "elastic_energy"), emitter="lanes")
    text = source_of(space, wanted)
    assert VECTORS in text
    assert "sqrt(x_" not in text[text.index("node_residual_kernel") : text.index("compute_node_residual")]
    assert VECTORS not in source_of(space, replace(wanted, quantities=("elastic_energy",)))
    assert VECTORS not in source_of(space, replace(wanted, emitter="unrolled"))
    assert VECTORS not in source_of(space, replace(wanted, precision="single"))


def source_of(structure: Structure, request: ModelRequest) -> str:
    source = emit(structure, request)
    return source.files[f"{source.manifest.name}.c"]


def test_a_kernel_takes_only_what_its_law_needs() -> None:
    static = build_kernel(KernelKind(("spring_constant", "rest_length"), True, False), "k")
    assert static.parameters == ("x", "y", "z", "spring_constant", "rest_length")
    assert not any("pack_less" in line for line in static.lines)
    mixed = build_kernel(
        KernelKind(("spring_constant", "rest_length", "damping"), False, True, is_mixed=True), "k"
    )
    assert mixed.parameters[3:6] == ("x_rate", "y_rate", "z_rate")
    assert mixed.parameters[-1] == "two_sided"
    assert any("pack_or" in line for line in mixed.lines)
