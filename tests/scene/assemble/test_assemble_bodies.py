"""Scenes of bodies: what they become, and what is said of wrong ones."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.checks.scene_warnings import find_body_warnings
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.scene.subject import assemble_scene
from tensegrity_codegen.structure.bodies import Bar, Chart, FixedBody, RigidBody
from tensegrity_codegen.structure.kinematics import compute_node_position
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidNameError,
    InvalidValueError,
    SceneError,
    StructureError,
    UnknownKeyError,
    UnknownNameError,
)
from tests.body_scenes import EVERYTHING, assemble_document
from tests.scene.samples import ARCH, REMOVE, changed

FIXED = {"kind": "fixed", "points": {"p": [0, 0, 0]}}


def change(*path: Any, to: Any) -> dict[str, Any]:
    return changed(*path, to=to, base=EVERYTHING)


def write_place(keys: list[Any]) -> str:
    """Return a place as messages write it."""
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys)[1:]


def refused(document: dict[str, Any], kind: type[SceneError]) -> SceneError:
    with pytest.raises(kind) as caught:
        assemble_document(document)
    error = caught.value
    assert type(error) is kind
    assert error.where.startswith("bodies.toml")
    assert error.allowed or error.hint
    return error


# --- what scenes become ----------------------------------------------------------------------------


def test_bodies_of_each_kind() -> None:
    system, request = assemble_document(EVERYTHING)
    kinds = {body.name: type(body) for body in system.bodies}
    assert kinds["ground"] is FixedBody
    assert kinds["plate"] is RigidBody
    bars = {body.name: body for body in system.bodies if isinstance(body, Bar)}
    assert bars["mast"].mass == pytest.approx(1800 * np.pi * (0.01**2 - 0.005**2) * 1.1)
    assert bars["mast"].inertia == pytest.approx(
        bars["mast"].mass * (1.1**2 + 3 * (0.01**2 + 0.005**2)) / 12, rel=1e-12
    )
    assert bars["mast"].chart == Chart(2, "elevation", np.radians(35))
    assert (bars["leg"].held, system.node_name[bars["leg"].anchor]) == ("B", "plate_corner")
    assert bars["stick"].held == ""
    assert bars["stick"].chart.axis == 0
    assert request.formulation == "bodies"
    assert request.quantities[:2] == ("member_tension", "acceleration")


def test_angles_are_degrees_in_the_scene_and_radians_inside() -> None:
    system, _ = assemble_document(EVERYTHING)
    at = system.coordinate_name.index
    assert system.coordinate[at("mast_azimuth")] == pytest.approx(np.radians(-10))
    assert system.velocity[at("leg_declination")] == pytest.approx(np.radians(-30))
    assert system.velocity[at("plate_phi")] == pytest.approx(np.radians(50))


def test_points_are_where_anchors_and_directions_put_them() -> None:
    system, _ = assemble_document(EVERYTHING)
    place = dict(zip(system.node_name, compute_node_position(system), strict=True))
    np.testing.assert_array_equal(place["mast_A"], place["ground_a"])
    np.testing.assert_array_equal(place["boom_A"], place["mast_B"])
    np.testing.assert_array_equal(place["leg_B"], place["plate_corner"])
    azimuth, elevation = np.radians(25), np.radians(50)
    direction = np.array(
        [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)]
    )
    np.testing.assert_allclose(place["mast_B"] - place["mast_A"], 1.1 * direction, atol=1e-15)
    boom = np.array([0.2, 0.8, 0.5])
    np.testing.assert_allclose(
        place["boom_B"] - place["boom_A"], 0.7 * boom / np.linalg.norm(boom), atol=1e-15
    )
    np.testing.assert_allclose((place["stick_A"] + place["stick_B"]) / 2, [0.8, 0.6, 0.7], atol=1e-15)


def test_the_order_of_bodies_does_not_matter_for_anchors() -> None:
    # "leg" is held by "plate", which comes last.
    names = list(EVERYTHING["bodies"])
    assert names.index("leg") < names.index("plate")
    turned = {**EVERYTHING, "bodies": {name: EVERYTHING["bodies"][name] for name in reversed(names)}}
    first, second = assemble_document(EVERYTHING)[0], assemble_document(turned)[0]
    one = dict(zip(first.node_name, compute_node_position(first), strict=True))
    two = dict(zip(second.node_name, compute_node_position(second), strict=True))
    for name, place in one.items():
        np.testing.assert_array_equal(place, two[name])


def test_prestress_is_the_tension_at_the_start() -> None:
    document = change("tendons", "t1", "prestress", to=7.0)
    system, _ = assemble_document(document)
    ends = compute_node_position(system)[system.connectivity[0]]
    length = np.linalg.norm(ends[0] - ends[1])
    assert 80.0 * (length - system.rest_length[0]) == pytest.approx(7.0)


def test_loads_and_inputs_find_points_bodies_and_classes() -> None:
    system, _ = assemble_document(EVERYTHING)
    np.testing.assert_array_equal(system.node_load[system.find_node("stick_A")], [1, 2, 3])
    assert [load.kind for load in system.loads] == ["force", "torque", "torque"]
    winch, push, thrust, turn, spin = system.inputs
    assert winch.targets == (0, 2, 3)
    assert push.direction == pytest.approx((0, 0.6, 0.8))
    assert (thrust.frame, turn.kind, spin.frame) == ("body", "torque", "body")
    assert system.has_unpotential_load


def test_parameters_select_tendons_and_nodes() -> None:
    document = {
        **EVERYTHING,
        "parameters": {"rest_length": ["rope"], "node_load": ["stick_A"], "gravity": "all"},
    }
    _, request = assemble_document(document)
    assert dict(request.parameters) == {
        "rest_length": (0, 2, 3),
        "node_load": (assemble_document(EVERYTHING)[0].find_node("stick_A"),),
        "gravity": (),
    }


def test_a_scene_with_bodies_is_one_of_bodies() -> None:
    assert type(assemble_scene(parse_scene(EVERYTHING))[0]).__name__ == "BodySystem"
    assert type(assemble_scene(parse_scene(ARCH))[0]).__name__ == "Structure"


def test_doubts() -> None:
    document = change("loads", 0, to={"point": "ground.a", "force": [1, 0, 0]})
    document["tendons"]["t6"] = {"class": "rope", "points": ["ground.a", "ground.b"]}
    found = " / ".join(find_body_warnings(assemble_document(document)[0]))
    assert "a load on a fixed point moves nothing: ground_a" in found
    assert "tendons between two fixed points never move: t6" in found
    assert "extension above 50 %" in found


# --- wrong bodies ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("path", "value", "kind", "place", "problem"),
    [
        ("bodies.leg.mass", REMOVE, InvalidValueError, "", "without mass"),
        ("bodies.mast.mass", 1.0, InvalidValueError, "", "together"),
        ("bodies.leg.length", 0.0, InvalidValueError, "", "range"),
        ("bodies.leg.length", REMOVE, InvalidValueError, "", "missing"),
        ("bodies.mast.radius", REMOVE, InvalidValueError, "", "section"),
        ("bodies.stick.inertia", 0.0, InvalidValueError, "", "inertia"),
        ("bodies.stick.centre", REMOVE, InvalidValueError, "", "position"),
        ("bodies.mast.centre", [0, 0, 0], InvalidValueError, "", "held bar"),
        ("bodies.mast.anchor", "ground.c", UnknownNameError, "", "not exist"),
        ("bodies.mast.anchor", "ground", InvalidNameError, "", "name"),
        ("bodies.mast.azimuth_deg", REMOVE, InvalidValueError, "bodies.mast", "direction"),
        ("bodies.mast.declination_deg", 40, InvalidValueError, "bodies.mast", "direction"),
        ("bodies.boom.azimuth_deg", 4, InvalidValueError, "bodies.boom.direction", "angles"),
        ("bodies.boom.direction", [0, 0, 0], InvalidValueError, "", "zero"),
        ("bodies.mast.elevation_deg", 90, InvalidValueError, "bodies.mast", "pole"),
        ("bodies.leg.declination_deg", 180, InvalidValueError, "bodies.leg", "pole"),
        ("bodies.plate.phi_deg", -90, InvalidValueError, "", "pole"),
        ("bodies.plate.mass", REMOVE, InvalidValueError, "", "missing"),
        ("bodies.plate.inertia", [1, 1, 0], InvalidValueError, "", "inertia"),
        ("bodies.plate.inertia", [1, 1, 2.1], InvalidValueError, "", "sum of the others"),
        ("bodies.plate.inertia", [[1, 2, 0], [2, 1, 0], [0, 0, 1]], InvalidValueError, "", "inertia"),
        ("bodies.plate.points.centre", [0, 0, 0], DuplicateNameError, "", "name already"),
        ("bodies.leg.kind", "rod", InvalidValueError, "", "allowed words"),
        ("bodies.leg.lenght", 1, UnknownKeyError, "", "unknown key"),
        ("bodies", {"ground": FIXED}, StructureError, "", "nothing can move"),
        ("tendons", {}, StructureError, "", "no tendon"),
        ("tendons.t1.points", ["ground.b", "stick.C"], UnknownNameError, "", "does not exist"),
        ("tendons.t1.points", ["nothing.b", "stick.A"], UnknownNameError, "", "does not exist"),
        ("tendons.t1.points", ["stick.A", "stick.A"], StructureError, "", "tendon joins a point to itself"),
        ("tendons.t1.class", "rop", UnknownNameError, "", "class is not defined"),
        ("tendons.t1", {"points": ["ground.b", "stick.A"]}, InvalidValueError, "", "without stiffness"),
        ("classes.rope.kind", "bar", InvalidValueError, "tendons.t1.class", "a tendon is a cable"),
        ("tendons.t1.nodes", ["a", "b"], UnknownKeyError, "", "unknown key"),
        ("joint_friction.0.coefficient", 1.0, InvalidValueError, "", "range"),
        ("joint_friction.0.bodies", ["mast", "moon"], UnknownNameError, "", "not defined"),
        ("joint_friction.0.bodies", ["mast", "mast"], InvalidValueError, "", "joint"),
        ("loads.0.point", "stick.x", UnknownNameError, "", "does not exist"),
        ("loads.0", {"node": "a", "force": [0, 0, 1]}, InvalidValueError, "loads[0].node", "no nodes"),
        ("loads.0.frame", "body", InvalidValueError, "", "only a rigid body"),
        ("loads.2.body", "ground", InvalidValueError, "", "fixed body"),
        ("loads.2.torqe", [0, 0, 1], UnknownKeyError, "", "unknown key"),
        ("inputs.1.points", ["leg.C"], UnknownNameError, "", "does not exist"),
        ("inputs.1.direction", [0, 0, 0], InvalidValueError, "", "zero"),
        ("inputs.3.frame", "body", InvalidValueError, "", "only a rigid body"),
        ("inputs.1.name", "winch", DuplicateNameError, "", "one name"),
        ("inputs.0.members", ["ropes"], UnknownNameError, "", "not defined"),
        ("parameters", {"node_mass": "all"}, InvalidValueError, "parameters.node_mass", "no such"),
        ("gravity", [0, -9.81], InvalidValueError, "", "wrong size"),
        ("axes", "xz", InvalidValueError, "", "no such key"),
        ("nodes", {"a": {"position": [0, 0, 0]}}, InvalidValueError, "", "no such key"),
        ("model", {"formulation": "node_position"}, InvalidValueError, "model.formulation", "bodies"),
        ("model", {"options": {"pairs": "full"}}, UnknownKeyError, "model.options", "no such option"),
    ],
)
def test_what_is_wrong_in_a_scene_of_bodies_is_refused(
    path: str, value: Any, kind: type[SceneError], place: str, problem: str
) -> None:
    """The place is that of the changed key where none is stated."""
    keys = [int(key) if key.isdigit() else key for key in path.split(".")]
    error = refused(change(*keys, to=value), kind)
    assert error.where == f"bodies.toml: {place or write_place(keys)}"
    assert problem in error.problem


def test_a_tendon_that_is_slack_may_join_two_points_at_one_place() -> None:
    system, _ = assemble_scene(parse_scene(change("tendons", "t1", "points", to=["mast.B", "boom.A"])))
    assert system.rest_length[system.member_name.index("t1")] > 0.0


def test_bars_that_hold_each_other_in_a_circle_are_refused() -> None:
    document = change("bodies", "mast", "anchor", to="boom.B")
    error = refused(document, StructureError)
    assert "circle" in error.problem
    assert str(error.given) in ("mast on boom on mast", "boom on mast on boom")


def test_points_with_one_name_in_c_are_refused() -> None:
    document = change("bodies", "a", to={"kind": "fixed", "points": {"b_c": [0, 0, 0]}})
    document["bodies"]["a_b"] = {"kind": "fixed", "points": {"c": [1, 0, 0]}}
    error = refused(document, DuplicateNameError)
    assert error.given == "a_b_c"


def test_a_misspelt_point_gets_the_close_one() -> None:
    error = refused(change("tendons", "t2", "points", to=["mast.B", "plate.egde"]), UnknownNameError)
    assert "plate.edge" in error.hint


@pytest.mark.parametrize(
    "part",
    [
        {"tendons": EVERYTHING["tendons"]},
        {"joint_friction": EVERYTHING["joint_friction"]},
        {"loads": [EVERYTHING["loads"][0]]},
        {"inputs": [EVERYTHING["inputs"][4]]},
        {"model": {"formulation": "bodies"}},
    ],
)
def test_a_scene_of_nodes_has_nothing_of_bodies(part: dict[str, Any]) -> None:
    with pytest.raises(InvalidValueError, match="bodies"):
        assemble(parse_scene({**ARCH, **part}))


def test_the_inertia_of_a_flat_body_is_possible() -> None:
    system, _ = assemble_document(change("bodies", "plate", "inertia", to=[0.1, 0.2, 0.1 + 0.2]))
    assert system.bodies
