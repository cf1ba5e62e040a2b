"""Simulation, linear model and cost of models in node distances, compiled."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.errors import InvalidValueError
from tensegrity_codegen.pipeline import (
    build_library,
    linearize_quantities,
    load_scene,
    settle_structure,
    simulation_quantities,
)
from tensegrity_codegen.request import ModelRequest
from tensegrity_codegen.runtime.linearize import linearize
from tensegrity_codegen.runtime.model import CompiledModel
from tensegrity_codegen.runtime.simulate import simulate
from tensegrity_codegen.structure import ActuatedInput, Structure
from tests.runtime.build import cable, make_structure, prism, spring

EXAMPLES = Path(__file__).resolve().parents[2] / "tensegrity_codegen/scene/examples"


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
    request = ModelRequest(
        (*simulation_quantities(formulation), *quantities),
        integrators=("rk4", "rk54"),
        parameters={"rest_length": (5,)} if structure.inputs else {},
        formulation=formulation,
        options=options,
    )
    return build_library(structure, request).load()


@pytest.mark.parametrize(("method", "most"), [("rk54", 1e-6), ("auto", 2e-8)])
def test_adaptive_steps_meet_their_tolerance(method: str, most: float) -> None:
    """rk54 keeps each step within the tolerance, auto the samples."""
    structure = structure_with_everything()
    exact = simulate(build(structure, "node_position"), 1.0, samples=11, method="rk4", step=1e-5)
    found = simulate(build(structure, "node_distance"), 1.0, samples=11, method=method, rtol=1e-8, atol=1e-8)
    assert found.status == "ok"
    assert np.abs(found.node_position - exact.node_position).max() < most


@pytest.mark.parametrize("pairs", ["connected", "full"])
@pytest.mark.parametrize("order", ["uvec321", "uvec123"])
def test_trajectories_are_those_of_node_positions(pairs: str, order: str) -> None:
    structure = structure_with_everything()
    arguments = {"input": np.array([-0.1, 0.5]), "rest_length": np.array([0.7])}
    runs = [
        simulate(model, 2.0, samples=21, method="rk4", step=1e-3, arguments=arguments)
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
    run = simulate(model, 5.0, samples=11, method="rk4", step=1e-3)
    for coordinate in run.coordinate:
        assert np.abs(model.compute("constraint_residual", coordinate=coordinate)).max() < 1e-15


def test_a_structure_without_cycles_has_nothing_to_keep() -> None:
    structure = make_structure([[0, 0, 0], [1, 0, 0]], [spring(0, 1, 0.9)])
    model = build(structure, "node_distance")
    assert not model.has("consistent_coordinate")
    assert simulate(model, 0.5, samples=3, method="rk4", step=1e-3).status == "ok"


@pytest.mark.parametrize("name", ["coordinate", "velocity"])
def test_a_state_that_contradicts_itself_is_refused(name: str) -> None:
    model = build(prism(), "node_distance")
    state = model.nominal(name)
    state[4] += 0.01
    with pytest.raises(InvalidValueError, match="do not add up") as caught:
        simulate(model, 0.1, method="rk4", step=1e-3, **{name: state})
    assert caught.value.where.startswith("simulate: n")


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


def test_equilibria_are_found_in_node_positions() -> None:
    structure, _ = load_scene(EXAMPLES / "prism.toml")
    assert isinstance(structure, Structure)
    settled = settle_structure(structure, ModelRequest((), formulation="node_distance"))
    model = build(settled, "node_distance")
    assert np.abs(model.compute("acceleration")).max() < 1e-6
    assert np.abs(settled.node_position - structure.node_position).max() > 1e-4


@pytest.mark.parametrize("name", ["prism", "icosahedron", "planar", "tower"])
def test_the_right_hand_side_takes_at_most_a_tenth_more_operations(name: str) -> None:
    structure, _ = load_scene(EXAMPLES / f"{name}.toml")
    counts = []
    for formulation in ("node_position", "node_distance"):
        source = emit(structure, ModelRequest(("acceleration",), formulation=formulation))
        counts.append(source.manifest.functions[0].operations)
    assert counts[1] <= 1.1 * counts[0]
