"""Simulation, linear model and cost of models in node distances, compiled."""

import numpy as np
import pytest

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.pipeline.settle import settle_structure
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.linear.linearize import linearize, linearize_quantities
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.simulation_quantities import simulation_quantities
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.models import EXAMPLES, load
from tests.runtime.build import bar, cable, make_structure, prism, spring


def structure_with_everything() -> Structure:
    """Partly anchored, loaded, damped, slack in motion, actuated, with velocities."""
    position = [[0, 0, 0], [1, 0, 0], [0.4, 0.9, 0], [0.5, 0.4, 0.8], [0.6, 0.5, 1.6]]
    members = [
        *(spring(i, 3, 0.8, damping=0.3) for i in (0, 1, 2)),
        spring(0, 1, 0.9),
        spring(1, 2, 1.0),
        cable(3, 4, 0.75),
        cable(2, 4, 1.6),
    ]
    structure = make_structure(
        position,
        members,
        anchored={0: "xyz", 1: "yz", 2: "z"},
        gravity=(0, 0, -9.81),
        load={4: (1.0, 0.0, 12.0)},
        mass=[1, 1, 2, 0.5, 1],
        inputs=(
            ActuatedInput("pull", "rest_length", (5, 0)),
            ActuatedInput("push", "force", (3,), (0, 1, 0)),
        ),
    )
    velocity = np.zeros((5, 3))
    velocity[3:] = [[0.2, 0, 0.1], [0, 0.4, -1.0]]
    return structure.with_changes(node_velocity=velocity)


def build(structure: Structure, formulation: str, *quantities: str, **options: str) -> CompiledModel:
    return load(
        structure,
        *simulation_quantities(formulation),
        *quantities,
        integrators=("rk4", "rk54"),
        parameters={"rest_length": (5,)} if structure.inputs else {},
        formulation=formulation,
        options=options,
    )


@pytest.mark.thorough
@pytest.mark.parametrize(("method", "most"), [("rk54", 1e-6), ("auto", 2e-8)])
def test_adaptive_steps_meet_their_tolerance(method: str, most: float) -> None:
    """rk54 keeps each step within the tolerance, auto the samples."""
    structure = structure_with_everything()
    exact = simulate(
        build(structure, "node_position"), 1.0, samples=11, method="rk4", stepping=Stepping(step=1e-5)
    )
    found = simulate(
        build(structure, "node_distance"),
        1.0,
        samples=11,
        method=method,
        rtol=1e-8,
        stepping=Stepping(atol=1e-8),
    )
    assert found.status == "ok"
    assert np.abs(found.node_position - exact.node_position).max() < most


@pytest.mark.thorough
@pytest.mark.parametrize("pairs", ["connected", "full"])
@pytest.mark.parametrize("order", ["uvec321", "uvec123"])
def test_trajectories_are_those_of_node_positions(pairs: str, order: str) -> None:
    structure = structure_with_everything()
    arguments = {"input": np.array([-0.1, 0.5]), "rest_length": np.array([0.7])}
    runs = [
        simulate(model, 2.0, samples=21, method="rk4", stepping=Stepping(step=1e-3), arguments=arguments)
        for model in (
            build(structure, "node_position"),
            build(structure, "node_distance", pairs=pairs, order=order),
        )
    ]
    assert [run.status for run in runs] == ["ok", "ok"]
    assert (runs[0].member_tension[:, 5] == 0).any()  # the cable goes slack on the way
    for name in ("node_position", "node_velocity", "member_tension", "total_energy", "kinetic_energy"):
        first, second = (getattr(run, name) for run in runs)
        np.testing.assert_allclose(second, first, rtol=0, atol=1e-11 * max(1.0, np.abs(first).max()))


def test_constraints_are_kept_with_anchors() -> None:
    model = build(structure_with_everything(), "node_distance", "constraint_residual")
    run = simulate(model, 5.0, samples=11, method="rk4", stepping=Stepping(step=1e-3))
    for coordinate in run.coordinate:
        assert np.abs(model.compute("constraint_residual", coordinate=coordinate)).max() < 1e-15


def test_a_structure_without_cycles_has_nothing_to_keep() -> None:
    structure = make_structure([[0, 0, 0], [1, 0, 0]], [spring(0, 1, 0.9)])
    model = build(structure, "node_distance")
    assert not model.has("consistent_coordinate")
    assert simulate(model, 0.5, samples=3, method="rk4", stepping=Stepping(step=1e-3)).status == "ok"


@pytest.mark.parametrize("name", ["coordinate", "velocity"])
def test_a_state_that_contradicts_itself_is_refused(name: str) -> None:
    model = build(prism(), "node_distance")
    state = model.nominal(name)
    state[4] += 0.01
    with pytest.raises(InvalidValueError, match="do not add up") as caught:
        simulate(model, 0.1, method="rk4", stepping=Stepping(step=1e-3), **{name: state})
    assert caught.value.where.startswith("simulate: n")


def net(offset: float, *, is_free: bool = False) -> Structure:
    """A swinging net, some of its cables slack, whose places are exact at any offset up to 1e9 m."""
    rim = [[0, 0, 0], [1.5, 0, 0.25], [1.5, 1.5, 0], [0, 1.5, 0.25]]
    inner = [[0.5, 0.5, -0.125], [1, 0.5, -0.125], [1, 1, -0.125], [0.5, 1, -0.125]]
    position = np.array([*rim, *inner])
    ends = [*((k, 4 + k) for k in range(4)), *((4 + k, 4 + (k + 1) % 4) for k in range(4)), (4, 6), (1, 4)]
    length = [float(np.linalg.norm(position[i] - position[j])) for i, j in ends]
    members = [
        cable(i, j, rest * (1.04 if k > 7 else 0.96))
        for k, ((i, j), rest) in enumerate(zip(ends, length, strict=True))
    ]
    anchored = {} if is_free else {0: "xyz", 1: "xyz", 2: "yz", 3: "xyz"}
    structure = make_structure(position + offset, members, anchored=anchored, gravity=(0, 0, -9.81))
    velocity = np.zeros((8, 3))
    velocity[4:] = np.random.default_rng(1).normal(size=(4, 3))
    return structure.with_changes(node_velocity=velocity)


@pytest.mark.thorough
@pytest.mark.parametrize("method", ["rk54", *thorough("rk4", "rk853")])
def test_an_anchored_net_moves_the_same_however_far_from_the_origin(method: str) -> None:
    """Anchors enter by their differences, so that not one bit of the coordinates depends on the offset."""
    runs = []
    for offset in (0.0, 3e5, 1e9):
        model = load(
            net(offset),
            *simulation_quantities("node_distance"),
            integrators=(method,),
            formulation="node_distance",
        )
        step = 1e-3 if method == "rk4" else None
        run = simulate(model, 1.0, samples=11, method=method, stepping=Stepping(step=step), rtol=1e-8)
        assert (run.status, len(run.log.time) > 10) == ("ok", True)
        runs.append(run)
    for run, offset in zip(runs[1:], (3e5, 1e9), strict=True):
        place = run.node_position - offset
        np.testing.assert_allclose(place, runs[0].node_position, rtol=0, atol=np.spacing(offset))
        np.testing.assert_array_equal(run.coordinate, runs[0].coordinate)
        np.testing.assert_array_equal(run.velocity, runs[0].velocity)
        np.testing.assert_array_equal(run.member_tension, runs[0].member_tension)
        np.testing.assert_array_equal(run.log.time, runs[0].log.time)


@pytest.mark.thorough
def test_events_of_a_free_net_are_as_sharp_however_far_from_the_origin() -> None:
    """The centre of mass is large there, and no margin of a cable depends on it."""
    runs = []
    for offset in (0.0, 1e9):
        model = build(net(offset, is_free=True), "node_distance")
        runs.append(simulate(model, 1.0, samples=11, method="rk54", rtol=1e-8, stepping=Stepping(atol=1e-9)))
    assert runs[1].status == "ok"
    apart = ~model.manifest.is_centre
    assert apart.sum() == len(apart) - 3
    assert len(runs[0].log.time) == len(runs[1].log.time) > 10
    np.testing.assert_allclose(runs[1].log.time, runs[0].log.time, rtol=0, atol=1e-11)
    np.testing.assert_allclose(runs[1].coordinate[:, apart], runs[0].coordinate[:, apart], rtol=0, atol=1e-11)
    np.testing.assert_allclose(runs[1].velocity, runs[0].velocity, rtol=0, atol=1e-10)


@pytest.mark.thorough
@pytest.mark.parametrize("held", ["xyz", "x", ""])
def test_distances_of_bars_keep_their_digits_far_from_the_origin(held: str) -> None:
    position = np.array([[0, 0, 0], [1, 0, 0], [0.25, 0.5, -0.5], [0.25, 0.5, 0.5], [0, -1, 0.0]])
    members = [bar(0, 1, 1.0), bar(2, 3, 1.0), cable(4, 0, 0.9), cable(4, 1, 1.3), cable(4, 2, 1.5)]
    found = []
    for offset in (0.0, 1e9):
        structure = make_structure(position + offset, members, anchored={4: held} if held else {})
        structure = structure.with_changes(radius=np.array([0.05, 0.05, 0.0, 0.0, 0.0]))
        wanted = ("bar_distance", "bar_distance_jacobian", "bar_nearest_point")
        model = load(structure, *wanted, formulation="node_distance")
        q = model.nominal("coordinate")
        q[~model.manifest.is_centre] *= 1 + 2.0**-40  # more digits than places so far away have
        values = [model.compute(name, coordinate=q) for name in wanted]
        found.append((values[0], values[1].toarray(), values[2] - offset))
    np.testing.assert_allclose(found[1][0], found[0][0], rtol=1e-14)
    np.testing.assert_allclose(found[1][1], found[0][1], rtol=0, atol=1e-14)
    np.testing.assert_allclose(found[1][2], found[0][2], rtol=0, atol=4 * np.spacing(1e9))


def test_a_net_settles_far_from_the_origin_as_near_it() -> None:
    request = ModelRequest((), formulation="node_distance")
    near, far = (settle_structure(net(offset), request).node_position - offset for offset in (0.0, 1e9))
    np.testing.assert_allclose(far, near, rtol=0, atol=np.spacing(1e9))
    assert np.abs(near - net(0.0).node_position).max() > 1e-3


@pytest.mark.parametrize("is_free", [True, *thorough(False)])
def test_far_from_the_origin_constraints_are_checked_as_near_it(is_free: bool) -> None:
    model = build(net(1e9, is_free=is_free), "node_distance", "constraint_residual")
    assert np.abs(model.compute("constraint_residual")).max() == 0.0
    state = model.nominal("coordinate")
    state[4] += 0.01
    with pytest.raises(InvalidValueError, match="do not add up"):
        simulate(model, 0.1, coordinate=state)


@pytest.mark.thorough
@pytest.mark.parametrize("pairs", ["connected", "full"])
def test_linear_models_have_the_frequencies_of_node_positions(pairs: str) -> None:
    found = []
    for formulation, options in (("node_position", {}), ("node_distance", {"pairs": pairs})):
        quantities = linearize_quantities(formulation, with_inputs=False)
        request = ModelRequest(quantities, formulation=formulation, options=options)
        found.append(linearize(build_library(prism(), request).load()))
    np.testing.assert_allclose(found[1].natural_frequency, found[0].natural_frequency, rtol=1e-7)
    assert found[1].spectrum.growing == found[0].spectrum.growing
    first = "_".join(f"n{k}" for k in prism().connectivity[0])
    assert found[1].state_name[0] == f"{first}_x"
    a, x = found[1].A, found[1].state
    derivative = a @ x + found[1].c
    np.testing.assert_array_equal(derivative[: len(x) // 2], x[len(x) // 2 :])


@pytest.mark.thorough
def test_equilibria_are_found_in_node_positions() -> None:
    structure, _ = load_scene(EXAMPLES / "prism.toml")
    assert isinstance(structure, Structure)
    settled = settle_structure(structure, ModelRequest((), formulation="node_distance"))
    model = build(settled, "node_distance")
    assert np.abs(model.compute("acceleration")).max() < 1e-6
    assert np.abs(settled.node_position - structure.node_position).max() > 1e-4


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["prism", "icosahedron", "planar", "tower"])
def test_the_right_hand_side_takes_at_most_a_tenth_more_operations(name: str) -> None:
    structure, _ = load_scene(EXAMPLES / f"{name}.toml")
    counts = []
    for formulation in ("node_position", "node_distance"):
        source = emit(structure, ModelRequest(("acceleration",), formulation=formulation))
        counts.append(source.manifest.functions[0].operations)
    assert counts[1] <= 1.1 * counts[0]
