"""The two-stage SVD tower (Sultan, Corless, Skelton 2002): the general bodies against the printed equations.

Equation numbers are the paper's. The tower is a scene; nothing of it is written by hand in the package.
"""

import numpy as np
import pytest

from tensegrity_codegen.structure.bodies import BodySystem
from tests.body_scenes import BodyEvaluator, example

TOWER = example("svd_tower")
EVALUATE = BodyEvaluator(TOWER)

# Data of (43), with b as the tensions need it.
L, B, J, M, MT, D = 1.0, 2 / 3, 1.0, 1.0, 1.0, -1.0
JT, MTILDE, MBIG = J + M * L**2 / 4, 3 * M * L / 2, MT + 3 * M  # (26)
AZIMUTH = {"bar11": 0, "bar21": 240, "bar31": 120, "bar12": 120, "bar22": 0, "bar32": 240}  # (16)
KINDS = ("saddle", "vertical", "diagonal")


def place(system: BodySystem, al: float, de: float, z: float) -> np.ndarray:
    """Return the coordinates (16) of a symmetrical configuration; angles in rad."""
    q = np.zeros(system.n_coordinates)
    for bar, turn in AZIMUTH.items():
        q[system.coordinate_name.index(f"{bar}_azimuth")] = al + np.radians(turn)
        q[system.coordinate_name.index(f"{bar}_declination")] = de
    q[system.coordinate_name.index("top_psi")] = np.radians(300)
    q[system.coordinate_name.index("top_z")] = z
    return q


def rates(system: BodySystem, al: float, de: float, z: float) -> np.ndarray:
    """Return rates or accelerations of a symmetrical motion."""
    v = place(system, al, de, z)
    for bar, turn in AZIMUTH.items():
        v[system.coordinate_name.index(f"{bar}_azimuth")] -= np.radians(turn)
    v[system.coordinate_name.index("top_psi")] = 0.0
    return v


def printed_lengths(al: float, de: float, z: float) -> np.ndarray:
    """Return S, V, D of (17) to (19)."""
    s, c, third = np.sin(de), np.cos(de), np.radians(30)
    saddle = z**2 + L**2 + 3 * L**2 * c**2 - 4 * L * z * c + B**2 / 3
    saddle -= 2 / np.sqrt(3) * L * B * s * np.cos(al - third)
    vertical = L**2 + B**2 - 2 * L * B * s * np.sin(al + third)
    diagonal = L**2 + B**2 / 3 + z**2 - 2 * L * z * c - 2 / np.sqrt(3) * L * B * s * np.sin(al)
    return np.sqrt([saddle, vertical, diagonal])


def printed_matrix(al: float, de: float, z: float, *, as_printed: bool = False) -> np.ndarray:
    """Return A_r of (A.1) to (A.9); the second row with sin(de) unless as_printed (erratum 2)."""
    s, c, third, root = np.sin(de), np.cos(de), np.radians(30), np.sqrt(3)
    lengths = printed_lengths(al, de, z)
    row = c if as_printed else s
    matrix = [
        [
            (root * (2 * z - 3 * L * c) * L * s - L * B * c * np.cos(al - third)) / root,
            -L * B * c * np.sin(al + third),
            (root * L * z * s - L * B * c * np.sin(al)) / root,
        ],
        [
            L * B * row * np.sin(al - third) / root,
            -L * B * row * np.cos(al + third),
            -L * B * row * np.cos(al) / root,
        ],
        [6 * z - 12 * L * c, 0.0, 6 * z - 6 * L * c],
    ]
    return np.array(matrix) / lengths


CONFIGURATIONS = [(55, 40, 1.11066), (65, 35, 1.11066), (70, 30, 1.60504), (65, 22.036, 1.60504)]
motions = pytest.mark.parametrize("seed", range(4))


def draw(seed: int) -> dict[str, tuple[float, float, float]]:
    """Return a symmetrical configuration with rates and accelerations of (al, de, z)."""
    rng = np.random.default_rng(seed)
    al, de, z = np.radians(rng.uniform(40, 80)), np.radians(rng.uniform(20, 50)), rng.uniform(1.0, 1.7)
    return {
        "position": (al, de, z),
        "rate": (*rng.uniform(-1, 1, 2), 0.0),  # (21): the height of a symmetrical motion is constant
        "acceleration": (*rng.uniform(-1, 1, 2), 0.0),
    }


def residual(drawn: dict[str, tuple[float, float, float]]) -> tuple[dict[str, float], np.ndarray]:
    """Return the left side of (14) without loads, by coordinate name, and the tensions (T_S, T_V, T_D)."""
    q, v = place(TOWER, *drawn["position"]), rates(TOWER, *drawn["rate"])
    a = rates(TOWER, *drawn["acceleration"])
    state = {"coordinate": q, "velocity": v}
    tension = EVALUATE("member_tension", **state)
    left = EVALUATE("mass_matrix", **state) @ a + EVALUATE("coriolis_force", **state)
    left += EVALUATE("equilibrium_matrix", **state) @ tension + EVALUATE("damping_matrix", **state) @ v
    return dict(zip(TOWER.coordinate_name, left, strict=True)), tension[[0, 6, 12]]


# --- geometry and statics --------------------------------------------------------------------------


def test_coordinates_are_those_of_equation_13_in_its_order() -> None:
    bars = [f"bar{i}{j}_{angle}" for j in (1, 2) for i in (1, 2, 3) for angle in ("declination", "azimuth")]
    assert TOWER.coordinate_name == (*bars, *(f"top_{c}" for c in ("psi", "phi", "theta", "x", "y", "z")))


@pytest.mark.parametrize("configuration", CONFIGURATIONS)
def test_lengths_are_those_of_equations_17_to_19(configuration: tuple[float, float, float]) -> None:
    al, de, z = np.radians(configuration[0]), np.radians(configuration[1]), configuration[2]
    lengths = EVALUATE("member_length", coordinate=place(TOWER, al, de, z)).reshape(3, 6)
    np.testing.assert_allclose(lengths, np.repeat(printed_lengths(al, de, z)[:, None], 6, axis=1), rtol=1e-14)


@pytest.mark.parametrize(
    ("configuration", "force", "printed"),
    [
        (CONFIGURATIONS[0], -50.0, (26.11, 1.85, 18.38)),  # (44)
        (CONFIGURATIONS[1], -50.0, (46.97, 12.27, 43.0)),  # (45); 43 is printed without decimals
        (CONFIGURATIONS[2], 50.0, (0.49, 8.91, 8.79)),  # (52)
        (CONFIGURATIONS[3], 50.0, (3.58, 4.93, 11.29)),  # (53)
    ],
)
def test_tensions_are_the_printed_ones(
    configuration: tuple[float, float, float], force: float, printed: tuple[float, ...]
) -> None:
    """Equation (30), from the full tendon matrix: A T + H F = 0 in all 18 rows, met by three tensions."""
    al, de, z = np.radians(configuration[0]), np.radians(configuration[1]), configuration[2]
    q = place(TOWER, al, de, z)
    kinds = np.repeat(np.eye(3), 6, axis=0)
    matrix = EVALUATE("equilibrium_matrix", coordinate=q) @ kinds
    load = EVALUATE("load_matrix", coordinate=q)[:, TOWER.inputs.index(TOWER.inputs[-1])]
    assert TOWER.inputs[-1].name == "F3"
    tension, *_ = np.linalg.lstsq(matrix, -load * force, rcond=None)
    assert np.abs(matrix @ tension + load * force).max() < 1e-12
    within = [0.02 if value == 43.0 else 0.006 for value in printed]
    assert np.all(np.abs(tension - printed) < within)
    # (31), with A_r as printed: the second row's wrong factor does not matter at rest.
    by_paper = np.linalg.solve(printed_matrix(al, de, z, as_printed=True), [0, 0, force])
    np.testing.assert_allclose(tension, by_paper, rtol=1e-10)


def test_rounded_data_miss_the_printed_tensions() -> None:
    """Erratum 3: with b = 0.67 m and Z = 1.11 m as printed, tensions are off by several per cent."""
    al, de = np.radians(55), np.radians(40)

    def tension(b: float, z: float) -> np.ndarray:
        def lengths(x: np.ndarray) -> np.ndarray:
            return printed_lengths(*x) if b == B else _lengths_with(b, *x)

        x, h = np.array([al, de, z]), 1e-6
        slopes = np.array([(lengths(x + h * e) - lengths(x - h * e)) / (2 * h) for e in np.eye(3)])
        return np.linalg.solve(slopes * np.array([[1.0], [1.0], [6.0]]), [0, 0, -50.0])

    printed = np.array([26.11, 1.85, 18.38])
    assert np.abs(tension(B, 1.11066) / printed - 1).max() < 0.003
    assert np.abs(tension(0.67, 1.11) / printed - 1).max() > 0.03


def _lengths_with(b: float, al: float, de: float, z: float) -> np.ndarray:
    s, c, third = np.sin(de), np.cos(de), np.radians(30)
    saddle = z**2 + L**2 + 3 * L**2 * c**2 - 4 * L * z * c + b**2 / 3
    saddle -= 2 / np.sqrt(3) * L * b * s * np.cos(al - third)
    diagonal = L**2 + b**2 / 3 + z**2 - 2 * L * z * c - 2 / np.sqrt(3) * L * b * s * np.sin(al)
    return np.sqrt([saddle, L**2 + b**2 - 2 * L * b * s * np.sin(al + third), diagonal])


def test_the_shipped_scene_rests_under_its_load() -> None:
    assert np.abs(EVALUATE("coordinate_force")).max() < 1e-11


# --- symmetrical motions ---------------------------------------------------------------------------


@motions
def test_rows_of_all_bars_are_equal_and_all_others_vanish(seed: int) -> None:
    """Symmetrical motions are invariant: five equations (21) to (25) are left of eighteen."""
    left, _ = residual(draw(seed))
    for angle in ("declination", "azimuth"):
        rows = [left[f"{bar}_{angle}"] for bar in AZIMUTH]
        np.testing.assert_allclose(rows, rows[0], atol=1e-11)
    for name in ("top_phi", "top_theta", "top_x", "top_y"):
        assert abs(left[name]) < 1e-11


@motions
def test_equations_22_24_and_25_are_right_as_printed(seed: int) -> None:
    drawn = draw(seed)
    (al, de, z), (dal, dde, _), (ddal, ddde, _) = drawn.values()
    left, tension = residual(drawn)
    rows = printed_matrix(al, de, z) @ tension
    s, c = np.sin(de), np.cos(de)
    equation_24 = JT * s**2 * ddal - D * dal + JT * np.sin(2 * de) * dal * dde + rows[1]
    assert left["bar11_azimuth"] == pytest.approx(equation_24, abs=1e-11)
    equation_25 = MTILDE * s * ddde + MTILDE * c * dde**2 + rows[2]
    assert left["top_z"] == pytest.approx(equation_25, abs=1e-11)
    # (22), with the second derivative of w = sin(de) cos(al + 60) written out.
    p = al + np.radians(60)
    w = c * np.cos(p) * ddde - s * np.sin(p) * ddal
    w -= s * np.cos(p) * (dde**2 + dal**2) + 2 * c * np.sin(p) * dde * dal
    spin = 3 * JT * (s**2 * ddal + np.sin(2 * de) * dde * dal)
    equation_22 = spin + np.sqrt(3) / 2 * M * L * B * w
    # The torque of the tendons and joints on the top is that of three bars, and (24) says what that is.
    assert left["top_psi"] + 3 * left["bar11_azimuth"] == pytest.approx(equation_22, abs=1e-11)


@motions
def test_erratum_1_equation_23_lacks_the_centrifugal_term(seed: int) -> None:
    drawn = draw(seed)
    (al, de, z), (dal, dde, _), (_, ddde, _) = drawn.values()
    left, tension = residual(drawn)
    printed = JT * ddde - D * dde + printed_matrix(al, de, z)[0] @ tension
    missing = -JT * np.sin(de) * np.cos(de) * dal**2
    assert left["bar11_declination"] == pytest.approx(printed + missing, abs=1e-11)
    assert abs(missing) > 1e-4
    assert left["bar11_declination"] != pytest.approx(printed, abs=1e-5)


@motions
def test_erratum_2_the_second_row_of_the_appendix_has_the_sine_of_the_declination(seed: int) -> None:
    position = draw(seed)["position"]
    al, de, z = position
    step = 1e-6
    slope = (printed_lengths(al + step, de, z) - printed_lengths(al - step, de, z)) / (2 * step)
    np.testing.assert_allclose(printed_matrix(*position)[1], slope, atol=1e-9)
    # The same rows from the full tendon matrix: one bar's row summed over the six tendons of a kind.
    full = EVALUATE("equilibrium_matrix", coordinate=place(TOWER, *position))
    kinds = np.repeat(np.eye(3), 6, axis=0)
    rows = full @ kinds
    wanted = np.array([rows[TOWER.coordinate_name.index(f"bar11_{a}")] for a in ("declination", "azimuth")])
    wanted = np.vstack([wanted, rows[TOWER.coordinate_name.index("top_z")]])
    np.testing.assert_allclose(printed_matrix(*position), wanted, atol=1e-13)
    assert np.abs(printed_matrix(*position, as_printed=True)[1] - slope).max() > 1e-2


@motions
def test_joint_friction_is_exactly_d_times_the_rates(seed: int) -> None:
    """(12) in (23) and (24): -d de', -d al' on every bar, although the top and the base differ."""
    drawn = draw(seed)
    v = rates(TOWER, *drawn["rate"])
    force = EVALUATE("damping_matrix", coordinate=place(TOWER, *drawn["position"])) @ v
    by_name = dict(zip(TOWER.coordinate_name, force, strict=True))
    for bar in AZIMUTH:
        assert by_name[f"{bar}_azimuth"] == pytest.approx(-D * drawn["rate"][0], abs=1e-14)
        assert by_name[f"{bar}_declination"] == pytest.approx(-D * drawn["rate"][1], abs=1e-14)


# --- all 18 coordinates ----------------------------------------------------------------------------


def reference_positions(q: np.ndarray) -> np.ndarray:
    """Return middles and directions of the six bars and the centre of the top, stacked, (13, 3).

    Written from the paper's section 3, without the package.
    """
    corner = B * np.array([[-0.5, -0.5 / np.sqrt(3), 0], [0, 1 / np.sqrt(3), 0], [0.5, -0.5 / np.sqrt(3), 0]])
    psi, phi, theta = q[12:15]
    c, s = np.cos, np.sin
    r3 = np.array([[c(psi), -s(psi), 0 * psi], [s(psi), c(psi), 0 * psi], [0, 0, 1]])
    r1 = np.array([[1, 0, 0], [0, c(phi), -s(phi)], [0, s(phi), c(phi)]])
    r2 = np.array([[c(theta), 0, s(theta)], [0, 1, 0], [-s(theta), 0, c(theta)]])
    top = q[15:18] + corner @ (r3 @ r1 @ r2).T
    de, al = q[0:12:2], q[1:12:2]
    u = np.stack([s(de) * c(al), s(de) * s(al), c(de)], axis=1)
    middles = np.vstack([corner + L / 2 * u[:3], top - L / 2 * u[3:]])
    return np.vstack([middles, u, q[15:18]])


def reference_mass(q: np.ndarray) -> np.ndarray:
    """Return M(q): m of the middles, J of the directions, M_t and the inertia of the top."""
    step = 1e-30
    jacobian = np.array(
        [reference_positions(q + 1j * step * e).imag.ravel() / step for e in np.eye(18)]
    ).T  # (39, 18), by complex steps: exact
    weight = np.repeat([M] * 6 + [J] * 6 + [MT], 3)
    matrix = jacobian.T * weight @ jacobian
    phi, theta = q[13:15].real
    c, s = np.cos, np.sin
    turning = np.array(
        [[-c(phi) * s(theta), c(theta), 0], [s(phi), 0, 1], [c(phi) * c(theta), s(theta), 0]]
    )  # angular velocity of the top in its own frame, by rates of psi, phi, theta
    inertia = np.array(next(body for body in TOWER.bodies if body.name == "top").inertia)
    matrix[12:15, 12:15] += turning.T @ inertia @ turning
    return matrix


@pytest.mark.parametrize("seed", range(3))
def test_mass_matrix_and_coriolis_terms_in_all_18_coordinates(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = TOWER.coordinate + rng.uniform(-0.3, 0.3, 18)
    v = rng.uniform(-1, 1, 18)
    np.testing.assert_allclose(EVALUATE("mass_matrix", coordinate=q), reference_mass(q), atol=1e-13)
    step = 1e-5
    slopes = np.stack(
        [(reference_mass(q + step * e) - reference_mass(q - step * e)) / (2 * step) for e in np.eye(18)],
        axis=2,
    )
    wanted = np.einsum("ijn,j,n->i", slopes, v, v) - np.einsum("jni,j,n->i", slopes, v, v) / 2  # (9)
    found = EVALUATE("coriolis_force", coordinate=q, velocity=v)
    np.testing.assert_allclose(found, wanted, atol=1e-9)


def test_torques_and_forces_act_along_the_axes_of_the_top() -> None:
    """(15): F = (M_1, M_2, M_3, F_1, F_2, F_3) along t_1, t_2, t_3; virtual work by differences."""
    rng = np.random.default_rng(8)
    q = TOWER.coordinate + rng.uniform(-0.3, 0.3, 18)
    matrix = -EVALUATE("load_matrix", coordinate=q)
    node = {name: k for k, name in enumerate(TOWER.node_name)}

    def axes(x: np.ndarray) -> np.ndarray:
        p = EVALUATE("node_position", coordinate=x)
        t1 = (p[node["top_B32"]] - p[node["top_B12"]]) / B
        up = p[node["top_B22"]] - (p[node["top_B12"]] + p[node["top_B32"]]) / 2
        t2 = up / np.linalg.norm(up)
        return np.array([t1, t2, np.cross(t1, t2)])

    here, step = axes(q), 1e-6
    for k, unit in enumerate(np.eye(18)):
        turned = (axes(q + step * unit) - axes(q - step * unit)) / (2 * step)
        moved = (q[15:18] + step * unit[15:18] - q[15:18]) / step
        # w . t_1 = t_2' . t_3, and so on in turn.
        work = [turned[1] @ here[2], turned[2] @ here[0], turned[0] @ here[1], *(here @ moved)]
        np.testing.assert_allclose(matrix[k], work, atol=1e-8)
