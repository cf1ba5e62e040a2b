"""Targets: texts, shape parameters against closed forms, derivatives, and sets of nodes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tensegrity_codegen.control.planning import shape_targets as shapes
from tensegrity_codegen.control.planning.shape_targets import find_nodes, find_rings, turn_near
from tensegrity_codegen.control.planning.target_text import parse_shape, read_targets, rewrite
from tensegrity_codegen.control.planning.targets import bind_targets
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError
from tests.control.planning.structures import actuate, build_prism, compile_plan, limit

PRISM = build_prism(155.0)
BASE, TOP = np.array([0, 1, 2]), np.array([3, 4, 5])
TURN = Rotation.from_rotvec([0.3, -1.2, 0.8]).as_matrix()


def tilted(towards: float, sideways: float) -> np.ndarray:
    """Return the prism with its top leaning by these angles [deg], towards b1 and sideways."""
    place = PRISM.node_position.copy()
    first = place[0] - place[BASE].mean(axis=0)
    first /= np.linalg.norm(first)
    lean = np.radians(np.array([towards, sideways]))
    axis = -lean[1] * first + lean[0] * np.cross([0.0, 0.0, 1.0], first)
    centre = place[TOP].mean(axis=0)
    place[TOP] = (place[TOP] - centre) @ Rotation.from_rotvec(axis).as_matrix().T + centre
    return place


@pytest.mark.parametrize("where", [lambda place: place, lambda place: place @ TURN.T + [3.0, -2.0, 5.0]])
def test_shape_parameters_do_not_depend_on_place_and_direction(where) -> None:
    place = start = where(PRISM.node_position)
    assert shapes.build_twist(TOP, BASE, start)(place)[0] == pytest.approx(155.0)
    assert shapes.build_height(TOP, BASE, start)(place)[0] == pytest.approx(0.3)
    np.testing.assert_allclose(shapes.build_tilt(TOP, BASE, start)(place), 0.0, atol=1e-9)
    leaning = where(tilted(12.0, -7.0))
    np.testing.assert_allclose(shapes.build_tilt(TOP, BASE, start)(leaning), [12.0, -7.0], rtol=1e-9)


@pytest.mark.parametrize("angle", [30.0, 89.0, 91.0, 154.0, 170.0, 179.0])
def test_normals_keep_the_side_of_the_start_where_the_centre_line_is_perpendicular_to_them(
    angle: float,
) -> None:
    """Any centre of the top: also beside the base, below it, and in the plane of either set."""
    start = PRISM.node_position
    for shift in ([0.0, 0.0, 0.0], [0.5, 0.0, -0.3], [0.5, 0.2, -0.31], [0.0, 0.0, -0.7]):
        place = tilted(angle, 0.0)
        place[TOP] += shift
        np.testing.assert_allclose(shapes.build_tilt(TOP, BASE, start)(place), [angle, 0.0], atol=1e-6)
        place[TOP] += start[TOP] - tilted(angle, 0.0)[TOP]
        assert shapes.build_twist(TOP, BASE, start)(place)[0] == pytest.approx(155.0)
        assert shapes.build_height(TOP, BASE, start)(place)[0] == pytest.approx(abs(0.3 + shift[2]))


def test_two_sets_in_one_plane_have_normals_on_the_same_side() -> None:
    start = PRISM.node_position.copy()
    start[TOP, 2] = start[BASE[0], 2]
    np.testing.assert_allclose(shapes.build_tilt(TOP, BASE, start)(start), 0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("angle", "reference", "near"),
    [
        ([-170.0], [175.0], [190.0]),
        ([10.0], [-5.0], [10.0]),
        ([0.0], [350.0], [360.0]),
        ([0.0], [0.0], [0.0]),
    ],
)
def test_an_angle_goes_on_past_half_a_turn(angle: list, reference: list, near: list) -> None:
    np.testing.assert_allclose(turn_near(np.array(angle), np.array(reference)), near)


def test_one_component_of_a_rotation_goes_on_past_half_a_turn() -> None:
    model = compile_plan(limit(actuate(PRISM)))
    targets = bind_targets(read_targets(['rotation("t*").x=100', "twist=170"]), model)
    start = PRISM.node_position
    for angle in range(0, 300, 20):
        turn = Rotation.from_rotvec(np.array([0.6, 0.8, 0.0]) * angle, degrees=True).as_matrix()
        targets = targets.follow(start @ turn.T)
        value, twist = (part.shape.evaluate(start @ turn.T, part.reference) for part in targets.parts)
        np.testing.assert_allclose(value, [0.6 * angle, 0.8 * angle, 0.0], atol=1e-6)
        assert twist[0] == pytest.approx(155.0)
    node_slope = np.cross([0.6, 0.8, 0.0], start @ turn.T)[:, :, None]  # of the same rotation, per radian
    slope = targets.slopes(start @ turn.T, node_slope, lambda *_: None, 1e-6)
    np.testing.assert_allclose(slope[:, 0], [0.6 * 180 / np.pi, 0.0], atol=1e-4)


@pytest.mark.parametrize(
    "vector",
    [[20.0, 0.0, 0.0], [0.0, 0.0, -170.0], [0.0, 179.9999999, 0.0], [3.0, -40.0, 90.0], [0.0, 0.0, 1e-9]],
)
def test_the_rotation_of_a_body_is_its_rotation_vector(vector: list[float]) -> None:
    start = PRISM.node_position
    matrix = Rotation.from_rotvec(vector, degrees=True).as_matrix()
    rotation = shapes.build_rotation(TOP, start)
    np.testing.assert_allclose(rotation(start @ matrix.T + 0.5), vector, rtol=1e-6, atol=1e-12)
    against = shapes.build_rotation(TOP, start, BASE)
    np.testing.assert_allclose(against(start @ matrix.T), 0.0, atol=1e-9)


def test_the_distance_past_an_edge_is_negative_at_the_start_and_horizontal() -> None:
    place = np.array([[0.0, 0, 0], [1.0, 0, 0], [0.5, 0.4, 2.0]])
    distance = shapes.build_edge_distance(np.array([0, 0, 1.0]), (0, 1), np.array([0, 0, 1.0]), place)
    assert distance(place)[0] == pytest.approx(-0.4)
    place[2] = [9.0, -0.01, 1.0]
    assert distance(place)[0] == pytest.approx(0.01)


def test_rings_of_prisms_and_towers() -> None:
    assert [part.tolist() for part in find_rings(["b1", "b2", "b3", "t1", "t2", "t3"]) or ()] == [
        [3, 4, 5],
        [0, 1, 2],
    ]
    tower = [f"{ring}{stage}_{i}" for stage in (1, 2) for ring in "bt" for i in (3, 2, 1)]
    assert [part.tolist() for part in find_rings(tower) or ()] == [[11, 10, 9], [2, 1, 0]]
    assert find_rings(["n1", "n2"]) is None


def test_patterns_of_nodes() -> None:
    names = ["t6_a", "t6_b", "t5_a"]
    assert find_nodes(["t6_*"], names, "").tolist() == [0, 1]
    with pytest.raises(UnknownNameError):
        find_nodes(["t7_*"], names, "")
    with pytest.raises(InvalidValueError, match="twice"):
        find_nodes(["t6_*", "t6_a"], names, "")


@pytest.mark.parametrize(
    ("text", "values", "unit"),
    [
        ("twist=165", (165.0,), ""),
        ("twist = 165 deg", (165.0,), "deg"),
        ("tilt=1e1, -2.5deg", (10.0, -2.5), "deg"),
        ('member_length["c1"] - 0.2=-3e-2', (-0.03,), ""),
        ("height=250mm", (250.0,), "mm"),
    ],
)
def test_texts_of_targets(text: str, values: tuple[float, ...], unit: str) -> None:
    (target,) = read_targets(text)
    assert (target.values, target.unit) == (values, unit)


@pytest.mark.parametrize(
    "text", ["", "=1", "twist", "twist=", "a>=1", "twist=1,", "twist=1 2", "twist=1deg2"]
)
def test_texts_without_a_value(text: str) -> None:
    with pytest.raises(InvalidValueError, match="not a target with a value"):
        read_targets([text])


def test_calls_of_shape_parameters() -> None:
    call = parse_shape('rotation("t*", [b1, b2, b3]).x')
    assert call is not None
    assert (call.name, call.arguments, call.component) == ("rotation", (("t*",), ("b1", "b2", "b3")), "x")
    assert parse_shape("member_length[0]") is None
    assert rewrite('rest_length("c1")') == 'member_length["c1"] - member_extension["c1"]'
    with pytest.raises(UnknownNameError):
        parse_shape("rotation(t1).w")
