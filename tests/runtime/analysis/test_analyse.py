"""Analyses of whole structures: verdicts, stability, modes, and what must not matter."""

import copy
import pickle

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tensegrity_codegen.pipeline.analyses import find_needs
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.report.analysis_tables import describe_analysis
from tensegrity_codegen.runtime.analysis.analyse import analyse
from tensegrity_codegen.runtime.linear.linearize import linearize, linearize_quantities
from tensegrity_codegen.runtime.statics.equilibrium import equilibrium_quantities, find_equilibrium
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.ground_cases import make_ground, make_prism
from tests.models import EXAMPLES, simulator
from tests.reference import ReferenceModel
from tests.runtime.build import bar, cable, make_structure, prism, spring
from tests.runtime.rigid_reference import RigidReference

DOWN = (0.0, 0.0, -10.0)
HELD = dict.fromkeys(range(3), "xyz")


def of(structure, **options):
    return analyse(ReferenceModel(structure), **options)


def test_frequencies_that_are_no_numbers_are_one_error() -> None:
    with pytest.raises(NonFiniteError, match="natural frequencies cannot be computed"):
        of(prism().with_changes(node_mass=np.full(6, 1e-307)))


def test_a_slack_cable_without_length_counts_as_if_it_were_not_there() -> None:
    """Two weights at one place, each in a cross of taut cables to corners of its own."""
    corners = [(1, 1, 0), (-1, 1, 0), (-1, -1, 0), (1, -1, 0)]
    far = [(2, 1, 0), (-1, 2, 0), (-2, -1, 0), (1, -2, 0)]
    position = [(0, 0, 0), (0, 0, 0), *corners, *far]
    members = [cable(0, 2 + k, 1.2) for k in range(4)] + [cable(1, 6 + k, 2.0) for k in range(4)]
    held = dict.fromkeys(range(2, 10), "xyz") | dict.fromkeys((0, 1), "z")
    without = make_structure(position, members, anchored=held)
    beside = make_structure(position, [*members, cable(0, 1, 0.5)], anchored=held)
    request = ModelRequest(())
    one, other = (
        analyse(build_library(item, find_needs("analyse", item, request).alone(request)).load())
        for item in (without, beside)
    )
    assert one.modes is not None
    assert other.modes is not None
    assert (one.status, one.n_selfstress, one.n_mechanisms) == ("stable", 4, 0)
    assert (other.status, other.n_selfstress, other.n_mechanisms) == ("stable", 4, 0)
    np.testing.assert_allclose(other.prestress.tension, [*one.prestress.tension, 0.0], atol=1e-9)
    assert other.prestress.least_tension == pytest.approx(one.prestress.least_tension)
    assert other.smallest_eigenvalue == pytest.approx(one.smallest_eigenvalue)
    np.testing.assert_allclose(other.modes.frequency, one.modes.frequency)
    assert "slack, without length and left out of all tensions: e8" in other.warnings


# --- verdicts --------------------------------------------------------------------------------------


def test_a_prism_at_its_twist_is_stable() -> None:
    found = of(prism())
    assert found.status == "stable"
    assert found.is_good
    assert (found.rank.rank, found.rank.n_coordinates, found.rank.n_members) == (11, 18, 12)
    assert (found.n_selfstress, found.n_rigid_motions, found.n_mechanisms) == (1, 6, 1)
    assert found.rigid_motion.shape == (6, 3, 6)
    assert found.mechanism.shape == (6, 3, 1)
    assert found.stability.smallest_eigenvalue > 0.1
    assert found.certificate is None
    assert found.load_prestress is None
    assert found.members.worst is None


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda found: pickle.loads(pickle.dumps(found))])
def test_an_analysis_can_be_copied_and_pickled(duplicate) -> None:
    found = of(prism())
    again = duplicate(found)
    assert describe_analysis(again, "abcdefghijkl", "123456")["limits"] is not None
    np.testing.assert_array_equal(again.member_tension, found.member_tension)
    np.testing.assert_array_equal(again.members.use["buckling"], found.members.use["buckling"])


@pytest.mark.parametrize("anchored", [{}, dict.fromkeys(range(3), "z")])
def test_a_prism_at_another_twist_has_a_certificate_by_nodes(anchored) -> None:
    structure = prism(160.0, anchored=anchored)
    found = of(structure)
    assert found.status == "infeasible"
    assert not found.is_good
    proof = found.certificate
    assert proof is not None
    assert proof.error < 1e-9
    motion = found.certificate_displacement
    assert motion is not None
    vector = np.diff(structure.node_position[structure.connectivity], axis=1)[:, 0]
    change = np.diff(motion[structure.connectivity], axis=1)[:, 0]
    elongation = np.sum(vector * change, axis=1) / np.linalg.norm(vector, axis=1)
    assert np.abs(elongation[structure.is_bar]).max() < 1e-9
    shortening = -elongation[~structure.is_bar]
    assert shortening.min() > -1e-9
    if not anchored:
        np.testing.assert_allclose(shortening, 1.0, atol=1e-9)


def test_weight_keeps_a_pendulum_in_tension() -> None:
    """One cable, no self-stress; the mass hangs 0.1 m lower than the cable is long."""
    hanging = make_structure([[0, 0, 0], [0, 0, -1]], [cable(0, 1, 0.9)], anchored={0: "xyz"}, gravity=DOWN)
    found = of(hanging)
    assert found.status == "stable"
    assert "loads keep every cable in tension" in found.message
    assert found.is_balanced
    assert found.load_prestress is not None
    np.testing.assert_allclose(found.load_prestress.tension, [10.0])
    assert found.certificate is not None  # without loads the cable can only be slack
    assert (found.rigid_motion.shape[2], found.mechanism.shape[2]) == (2, 0)
    pendulum = np.sqrt(10.0 / 1.0) / (2 * np.pi)
    assert found.modes is not None
    np.testing.assert_allclose(found.modes.frequency, [pendulum, pendulum, 10 / (2 * np.pi)], rtol=1e-9)


def test_a_mass_above_its_support() -> None:
    """On a bar it is unstable; on a cable there are no tensions at all."""
    above = [[0, 0, 0], [0, 0, 1]]
    found = of(make_structure(above, [bar(0, 1, 1.0001)], anchored={0: "xyz"}, gravity=DOWN))
    assert found.status == "unstable"
    assert found.stability.smallest_eigenvalue == pytest.approx(-1.0)
    assert found.modes is not None
    assert found.modes.growth_rate[:2] == pytest.approx([np.sqrt(10.0)] * 2, rel=1e-3)
    found = of(make_structure(above, [cable(0, 1, 0.9)], anchored={0: "xyz"}, gravity=DOWN))
    assert found.status == "infeasible"
    assert found.load_certificate is not None
    assert found.load_certificate.load_work > 0


def test_a_compressed_chain_is_unstable_though_its_cable_is_tight() -> None:
    structure = make_structure(
        [[-1, 0, 0], [0, 0, 0], [1, 0, 0]], [bar(0, 1, 1.0), bar(1, 2, 1.0), cable(0, 2, 1.9)]
    )
    found = of(structure)
    assert found.prestress.is_found
    assert found.status == "unstable"
    assert found.stability.smallest_eigenvalue < -0.1


def test_the_sign_of_bars_is_chosen_for_stability() -> None:
    """A node in the middle of two bars between supports: stiff sideways in tension, not in compression."""
    ends = dict.fromkeys((0, 2), "xyz")
    line = [[-1, 0, 0], [0, 0, 0], [1, 0, 0]]
    found = of(make_structure(line, [bar(0, 1, 1.0), bar(1, 2, 1.0)], anchored=ends))
    assert found.status == "stable"
    np.testing.assert_allclose(found.prestress.tension, [1.0, 1.0])
    # Two such lines: one pair of signs out of four.
    both = [*line, *np.add(line, [0, 0, 5]).tolist()]
    members = [bar(i, j, 1.0) for i, j in ((0, 1), (1, 2), (3, 4), (4, 5))]
    found = of(make_structure(both, members, anchored=dict.fromkeys((0, 2, 3, 5), "xyz")))
    assert found.status == "stable"
    assert found.prestress.tension.min() > 0
    assert len(found.parts) == 1 or "unconnected pieces" in found.warnings[0]


@pytest.mark.parametrize(("rest", "status"), [(1.0, "stable"), (1.005, "stable"), (1.02, "unstable")])
def test_a_column_that_buckles_between_its_springs(rest, status) -> None:
    """Two bars in line, held sideways by 1,000 N/m, are stable up to a compression of 500 N."""
    points = [[-1, 0, 0], [0, 0, 0], [1, 0, 0], [0, 0, 1], [0, 0, -1]]
    members = [bar(0, 1, rest), bar(1, 2, rest), spring(1, 3, 1.0, 500.0), spring(1, 4, 1.0, 500.0)]
    anchored = dict.fromkeys((0, 2, 3, 4), "xz")
    found = of(make_structure(points, members, axes="xz", anchored=anchored))
    assert found.is_balanced
    assert found.status == status
    assert found.smallest_eigenvalue == pytest.approx(1000 - 2 * 1e5 * (rest - 1.0), rel=1e-6, abs=1e-6)
    assert ("unstable equilibrium" in found.message) is (status == "unstable")


def test_a_four_bar_linkage_is_not_held_by_anything() -> None:
    corners = [[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]]
    sides = [bar(k, (k + 1) % 4, 1.0) for k in range(4)]
    found = of(make_structure(corners, sides, axes="xz", anchored={0: "xz", 1: "xz"}))
    assert found.status == "unstable"
    assert found.mechanism.shape[2] == 1
    assert found.message.startswith("the tensions found give the only mechanism no stiffness")
    assert found.message.endswith("what moves most: n2, n3")


def test_a_triangle_of_bars_needs_no_prestress() -> None:
    corners = [[0, 0, 0], [1, 0, 0], [0, 0, 1]]
    members = [bar(0, 1, 1.0), bar(1, 2, 2**0.5), bar(2, 0, 1.0)]
    for structure in (make_structure(corners, members, axes="xz"), make_structure(corners, members)):
        found = of(structure)
        assert found.status == "stable"
        assert "no member needs to be in tension" in found.message


def test_loads_that_nothing_holds_are_left_out() -> None:
    found = of(prism(gravity=DOWN))
    assert found.status == "stable"
    assert "would move it as a whole" in found.load_note
    found = of(prism(gravity=DOWN, anchored=HELD))
    assert "push a mechanism" in found.load_note
    assert found.status == "stable"


def test_at_the_equilibrium_loads_are_balanced() -> None:
    model = ReferenceModel(prism(gravity=(0.0, 0.0, -1.0), anchored=HELD))
    settled = find_equilibrium(model, tolerance=1e-12)
    found = analyse(model, coordinate=settled.coordinate)
    assert found.is_balanced
    assert found.status == "stable"
    # Where the weight pushes the mechanism, the shape is not quite one with a self-stress.
    assert found.rank.rank == 9
    assert found.load_prestress is not None
    assert found.load_prestress.is_found


# --- odd structures --------------------------------------------------------------------------------


def test_members_between_supports_only() -> None:
    """They carry any tension without moving anything; the node between two others is held by both."""
    members = [cable(0, 1, 0.9), cable(1, 2, 0.9), cable(2, 3, 1.4), cable(0, 3, 1.4)]
    structure = make_structure([[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0, 1]], members, anchored=HELD)
    found = of(structure)
    assert (found.rank.rank, len(found.rank.selfstress)) == (2, 2)
    assert found.status == "infeasible"
    assert found.certificate.shortening == (2, 3)
    straight = structure.with_changes(
        connectivity=np.array([[0, 1], [1, 2], [0, 3], [3, 1]]),
        node_position=np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0.3, 0, 0]]),
    )
    found = of(straight)
    assert found.status == "stable"
    assert (found.rank.rank, len(found.rank.selfstress), found.mechanism.shape[2]) == (1, 3, 2)
    np.testing.assert_allclose(found.prestress.tension, 1.0)


def test_parts_are_named() -> None:
    structure = make_structure([[0, 0, 0], [1, 0, 0], [5, 0, 0], [6, 0, 0]], [bar(0, 1, 1.0), bar(2, 3, 1.0)])
    found = of(structure)
    assert found.parts == (("n0", "n1"), ("n2", "n3"))
    assert (found.rigid_motion.shape[2], found.mechanism.shape[2]) == (10, 0)
    assert any("2 unconnected pieces" in text for text in found.warnings)


def test_without_masses_there_are_no_modes() -> None:
    found = of(prism(mass=0.0))
    assert found.status == "stable"
    assert found.modes is None


def test_wrong_arguments_are_refused() -> None:
    structure = prism()
    model = ReferenceModel(structure)
    start = model.nominal("coordinate").ravel()
    with pytest.raises(InvalidValueError, match="coordinate"):
        analyse(model, coordinate=start[1:])
    with pytest.raises(NonFiniteError, match="coordinate"):
        analyse(model, coordinate=start * np.nan)
    same = start.reshape(-1, 3).copy()
    first, second = structure.connectivity[structure.is_bar][0]  # a slack cable may have no length
    same[second] = same[first]
    with pytest.raises(InvalidValueError, match=f"n{first} and n{second} at the same place"):
        analyse(model, coordinate=same.ravel())


# --- what must not matter --------------------------------------------------------------------------


@pytest.mark.parametrize("twist", [150.0, 160.0])
@pytest.mark.parametrize(("shift", "size"), [(1000.0, 1.0), *thorough((0.0, 1e-3), (0.0, 1e3))])
def test_place_and_size(twist, shift, size) -> None:
    plain = prism(twist)
    moved = plain.with_changes(
        node_position=plain.node_position * size + shift, rest_length=plain.rest_length * size
    )
    one, other = of(plain), of(moved)
    assert (one.status, one.rank.rank) == (other.status, other.rank.rank)
    np.testing.assert_allclose(other.prestress.tension, one.prestress.tension, atol=1e-9)
    assert (one.mechanism.shape, one.rigid_motion.shape) == (other.mechanism.shape, other.rigid_motion.shape)
    if one.certificate is not None:
        np.testing.assert_allclose(other.certificate.elongation, one.certificate.elongation, atol=1e-9)
    assert other.smallest_eigenvalue == pytest.approx(one.smallest_eigenvalue, rel=1e-5)
    np.testing.assert_allclose(other.modes.frequency, one.modes.frequency, rtol=1e-5)


def test_order_and_direction_of_members_and_a_turn() -> None:
    plain = prism(170.0, sides=4)
    order = np.random.default_rng(1).permutation(plain.n_members)
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    other = plain.with_changes(
        node_position=plain.node_position @ turn.T,
        connectivity=plain.connectivity[order][:, ::-1],
        **{
            name: getattr(plain, name)[order]
            for name in ("is_bar", "tension_only", "rest_length", "spring_constant", "axial_stiffness")
        },
        member_name=tuple(plain.member_name[e] for e in order),
    )
    one, two = of(plain), of(other)
    assert one.status == two.status == "infeasible"
    np.testing.assert_allclose(two.certificate.elongation, one.certificate.elongation[order], atol=1e-9)
    np.testing.assert_allclose(two.modes.frequency, one.modes.frequency, rtol=1e-6)


def test_rigid_bars_change_nothing_but_frequencies() -> None:
    springs = prism(bar_stiffness=1e7)
    stiff = np.where(springs.is_bar, 0.0, springs.spring_constant)
    models = [RigidReference(springs.with_changes(spring_constant=stiff)), ReferenceModel(springs)]
    rigid, found = (analyse(m, coordinate=find_equilibrium(m, tolerance=1e-12).coordinate) for m in models)
    assert rigid.status == found.status == "stable"
    assert rigid.rank.rank == found.rank.rank
    assert rigid.rank.rank == 11
    np.testing.assert_allclose(rigid.prestress.tension, found.prestress.tension, rtol=1e-5)
    np.testing.assert_allclose(rigid.member_tension, found.member_tension, rtol=1e-4)
    np.testing.assert_allclose(rigid.modes.frequency[:8], found.modes.frequency[:8], rtol=1e-3)
    assert rigid.modes.n_total == found.modes.n_total - 3


def test_a_stable_shape_is_not_called_so_without_its_flaws() -> None:
    """A slack prism has a prestress that would hold it, a thin bar buckles: both belong to the verdict."""
    structure = prism()
    slack = structure.with_changes(rest_length=structure.member_length())
    found = analyse(ReferenceModel(slack))
    assert found.status == "stable"
    assert "; but " in found.message
    assert "no stiffness at the present tensions, which are zero" in found.message
    length = structure.member_length()
    tense = structure.with_changes(
        rest_length=structure.find_rest_length(length, 5 * found.prestress.tension)
    )
    assert "but" not in analyse(ReferenceModel(tense)).message
    thin = tense.with_changes(radius=np.where(structure.is_bar, 1e-4, 0.0))
    assert "but e0 buckles" in analyse(ReferenceModel(thin)).message


WRONG = [None, "x", b"x", float("nan"), -1e300, 1 + 2j, [], {}, object(), np.zeros((2, 2)), np.array(["a"])]


@pytest.mark.parametrize(
    "value", [*WRONG, np.array([1j, 0]), [[1], [1, 2]], np.datetime64("2020"), range(3), "1"]
)
@pytest.mark.parametrize("name", ["rank_tolerance", "n_modes"])
def test_wrong_options_raise_named_errors(name: str, value: object) -> None:
    with pytest.raises(InvalidValueError, match=name):
        of(prism(), **{name: value})


# --- on the ground ---------------------------------------------------------------------------------


def _analyse_standing(structure, **options):
    """Return equilibrium, analysis and linear model of a structure of rigid bars on the ground."""
    names = (*linearize_quantities("rigid_bar", with_inputs=False), "equilibrium_matrix", "mass_matrix")
    names += equilibrium_quantities("rigid_bar")
    model = simulator(structure, formulation="rigid_bar", more=names)
    rest = find_equilibrium(model, tolerance=1e-13, **options)
    found = analyse(model, coordinate=rest.coordinate, arguments=rest.internal_argument, n_modes=99)
    return rest, found, linearize(model, rest)


def test_frequencies_on_the_ground_are_those_of_the_linear_model() -> None:
    """Feet are springs k and kt; almost without dampers lambda = i w to second order of their ratio."""
    standing = make_prism(stick_damping=1e-4, dissipation=0.0)
    rest, found, linear = _analyse_standing(standing.with_changes(damping=0 * standing.damping))
    assert rest.feet.state == ("stick",) * 3 + ("open",) * 3
    oscillating = linear.spectrum.eigenvalue.imag[linear.spectrum.eigenvalue.imag > 1e-3]
    assert found.modes.frequency == pytest.approx(np.sort(oscillating) / (2 * np.pi), rel=1e-8)
    assert (found.status, found.n_rigid_motions, found.n_mechanisms) == ("stable", 0, 0)
    assert found.rank.n_coordinates == 9  # of the upper nodes
    assert found.smallest_eigenvalue == pytest.approx(rest.smallest_eigenvalue, rel=1e-12)
    assert found.is_balanced


def test_a_structure_turned_on_the_ground_and_renumbered_is_analysed_alike() -> None:
    turn = Rotation.from_rotvec([0.0, 0.0, 0.7]).as_matrix()
    tilt = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix()
    order = np.array([3, 0, 5, 1, 2, 4])
    plain, copied = make_prism(), make_prism(turn, order)
    copied = copied.with_changes(
        node_position=copied.node_position @ tilt.T,
        gravity=tilt @ copied.gravity,
        ground=make_ground(
            6, normal=tilt[:, 2], stiffness=2e4, stick_stiffness=2e4, stick_damping=20.0, dissipation=0.3
        ),
    )
    (_, found, _), (_, other, _) = _analyse_standing(plain), _analyse_standing(copied)
    assert other.modes.frequency == pytest.approx(found.modes.frequency, rel=1e-10)
    assert other.smallest_eigenvalue == pytest.approx(found.smallest_eigenvalue, rel=1e-10)
    assert (other.status, other.n_selfstress, other.rank.rank) == (
        found.status,
        found.n_selfstress,
        found.rank.rank,
    )


@pytest.mark.parametrize(("friction", "rigid", "directions"), [(0.2, 0, 12), (0.0, 3, 15)])
def test_feet_that_slip_hold_less(friction: float, rigid: int, directions: int) -> None:
    """Across their slip, and along the normal; without friction along the normal alone."""
    rest, found, _ = _analyse_standing(make_prism(friction=friction))
    assert set(rest.feet.state[:3]) == {"slip" if friction else "slide"}
    assert (found.n_rigid_motions, found.rank.n_coordinates) == (rigid, directions)
    assert any("at the limit of friction" in text for text in found.warnings) == bool(friction)
    assert found.smallest_eigenvalue == pytest.approx(rest.smallest_eigenvalue, rel=1e-9)


def test_the_stability_of_a_start_out_of_balance_is_not_judged() -> None:
    """The example prism under its loads: every mode is stiff, and 3.57 N are not in balance."""
    found = analyse(compile_scene(EXAMPLES / "prism.toml", for_="analyse"))
    assert found.status == "stable"
    assert not found.is_balanced
    assert found.residual == pytest.approx(3.57, abs=0.01)
    assert found.smallest_eigenvalue == pytest.approx(69.1007, rel=1e-4)
    assert "no stiffness" not in found.message
    assert "not in balance, so that stability is not judged here" in found.message
