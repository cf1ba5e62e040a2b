"""LIN and SCS, checked from the definitions with NumPy alone: python docs/derivations/bodies.py

Every line states a claim of docs/errata.md and the number that decides it. Derivatives are complex steps,
exact to rounding; second derivatives are central differences of them.
"""

import numpy as np

RNG = np.random.default_rng(3)
L, B, J, M, D = 1.0, 2 / 3, 1.0, 1.0, -1.0  # SCS (43), with b as the tensions need it
JT = J + M * L**2 / 4
TURN = np.radians([0, 240, 120, 120, 0, 240])  # (16), bars 11 21 31 12 22 32
CORNER = B * np.array([[-0.5, -0.5 / 3**0.5, 0], [0, 1 / 3**0.5, 0], [0.5, -0.5 / 3**0.5, 0]])
# Tendons by (bar or top or base, end): 6 saddle, 6 vertical, 6 diagonal.
TENDONS = [
    "B11-A12",
    "B11-A32",
    "B21-A12",
    "B21-A22",
    "B31-A22",
    "B31-A32",
    "A11-B31",
    "A21-B11",
    "A31-B21",
    "A12-B22",
    "A22-B32",
    "A32-B12",
    "A11-A32",
    "A21-A12",
    "A31-A22",
    "B11-B12",
    "B21-B22",
    "B31-B32",
]


def gradient(function, x):
    """Return the derivatives of a function (n,) -> (...), the last axis over x."""
    columns = [function(x + 1e-30j * unit).imag / 1e-30 for unit in np.eye(len(x))]
    return np.moveaxis(np.array(columns), 0, -1)


# --- SCS: the tower in all 18 coordinates of (13) ----------------------------------------------------


def points(q):
    """Return positions of A_ij and B_ij by name, and the middles and directions of the six bars."""
    de, al, (psi, phi, theta) = q[0:12:2], q[1:12:2], q[12:15]
    c, s = np.cos, np.sin
    r3 = np.array([[c(psi), -s(psi), 0], [s(psi), c(psi), 0], [0, 0, 1]])
    r1 = np.array([[1, 0, 0], [0, c(phi), -s(phi)], [0, s(phi), c(phi)]])
    r2 = np.array([[c(theta), 0, s(theta)], [0, 1, 0], [-s(theta), 0, c(theta)]])
    top = q[15:18] + CORNER @ (r3 @ r1 @ r2).T
    u = np.stack([s(de) * c(al), s(de) * s(al), c(de)], axis=1)
    place = {}
    for i in range(3):
        place[f"A{i + 1}1"], place[f"B{i + 1}1"] = CORNER[i], CORNER[i] + L * u[i]
        place[f"A{i + 1}2"], place[f"B{i + 1}2"] = top[i] - L * u[3 + i], top[i]
    middles = np.vstack([CORNER + L / 2 * u[:3], top - L / 2 * u[3:]])
    return place, middles, u


def lengths(q):
    """Return the lengths of the 18 tendons."""
    place, _, _ = points(q)
    ends = [tendon.split("-") for tendon in TENDONS]
    return np.array([np.sqrt(np.sum((place[a] - place[b]) ** 2)) for a, b in ends])


def mass_matrix(q):
    """Return M(q): m of middles, J of directions, M_t = 1 kg of the top, without its inertia."""
    jacobian = gradient(lambda x: np.concatenate([*points(x)[1:], [x[15:18]]]).ravel(), q)
    weight = np.repeat([M] * 6 + [J] * 6 + [1.0], 3)
    return jacobian.T * weight @ jacobian


def left_side(q, v, a, tension):
    """Return M q'' + c + A T + C q' of (14), friction of the bars' own rows alone."""
    step = 1e-6
    slopes = [(mass_matrix(q + step * e) - mass_matrix(q - step * e)) / (2 * step) for e in np.eye(18)]
    slopes = np.moveaxis(np.array(slopes), 0, -1)
    coriolis = np.einsum("ijn,j,n->i", slopes, v, v) - np.einsum("jni,j,n->i", slopes, v, v) / 2
    friction = np.concatenate([-D * v[:12], np.zeros(6)])
    return mass_matrix(q) @ a + coriolis + gradient(lengths, q).T @ tension + friction


def symmetrical(al, de, z, turn=1.0):
    """Return (16): azimuths al + turn, all declinations de, psi = 300 deg, height z."""
    q = np.zeros(18)
    q[0:12:2], q[1:12:2] = de, al + turn * TURN
    q[12], q[17] = turn * np.radians(300), z
    return q


def printed_lengths(x, b=B):
    """Return S, V, D of (17) to (19) at x = (al, de, z)."""
    al, de, z = x
    s, c, third = np.sin(de), np.cos(de), np.radians(30)
    saddle = (
        z**2 + L**2 + 3 * L**2 * c**2 - 4 * L * z * c + b**2 / 3 - 2 / 3**0.5 * L * b * s * np.cos(al - third)
    )
    diagonal = L**2 + b**2 / 3 + z**2 - 2 * L * z * c - 2 / 3**0.5 * L * b * s * np.sin(al)
    return np.sqrt(np.array([saddle, L**2 + b**2 - 2 * L * b * s * np.sin(al + third), diagonal]))


def rows(x, b=B):
    """Return A_r: dl/dde, dl/dal, 6 dl/dz of (17) to (19)."""
    slope = gradient(lambda y: printed_lengths(y, b), np.asarray(x, dtype=float))
    return np.array([slope[:, 1], slope[:, 0], 6 * slope[:, 2]])


def check_tower():
    """Print what decides SCS 1 to 3."""
    al, de, z = np.radians(62.0), np.radians(33.0), 1.3
    dal, dde, ddal, ddde = 0.7, -0.4, 0.3, 0.9
    tension = np.array([3.0, 5.0, 7.0])
    q, v = symmetrical(al, de, z), symmetrical(dal, dde, 0.0, turn=0.0)
    a = symmetrical(ddal, ddde, 0.0, turn=0.0)
    left = left_side(q, v, a, np.repeat(tension, 6))
    a_r = rows((al, de, z)) @ tension
    say(
        "SCS (17)-(19): lengths of the full model less the printed ones",
        abs(lengths(q).reshape(3, 6).T - printed_lengths((al, de, z))).max(),
    )
    printed_23 = JT * ddde - D * dde + a_r[0]
    centrifugal = -JT * np.sin(de) * np.cos(de) * dal**2
    say("SCS 1: row of the declination less (23) as printed", left[0] - printed_23)
    say("SCS 1: the centrifugal term -Jt sin(de) cos(de) al'^2", centrifugal)
    say("SCS 1: row less (23) with that term", left[0] - printed_23 - centrifugal)
    s, c, third = np.sin(de), np.cos(de), np.radians(30)
    size = printed_lengths((al, de, z))
    second = (
        np.array(
            [L * B * np.sin(al - third) / 3**0.5, -L * B * np.cos(al + third), -L * B * np.cos(al) / 3**0.5]
        )
        / size
    )
    say(
        "SCS 2: dl/dal less (A.4)-(A.6) with cos(de), as printed",
        abs(rows((al, de, z))[1] - c * second).max(),
    )
    say("SCS 2: the same with sin(de)", abs(rows((al, de, z))[1] - s * second).max())
    printed_24 = JT * s**2 * ddal - D * dal + JT * np.sin(2 * de) * dal * dde + a_r[1]
    say("SCS (24): row of the azimuth less the printed one", left[1] - printed_24)
    printed_25 = 1.5 * M * L * (s * ddde + c * dde**2) + a_r[2]
    say("SCS (25): row of the height less the printed one", left[17] - printed_25)
    say("SCS (21): rows of phi, theta, X, Y", abs(left[13:17]).max())
    cases = [(55, 40, 1.11066, -50, (26.11, 1.85, 18.38)), (65, 35, 1.11066, -50, (46.97, 12.27, 43))]
    cases += [(70, 30, 1.60504, 50, (0.49, 8.91, 8.79)), (65, 22.036, 1.60504, 50, (3.58, 4.93, 11.29))]
    for azimuth, declination, height, force, printed in cases:
        at = np.radians(azimuth), np.radians(declination)
        ours = np.linalg.solve(rows((*at, height)), [0, 0, force])
        rounded = np.linalg.solve(rows((*at, round(height, 2)), 0.67), [0, 0, force])
        say(f"SCS 3: tensions at {azimuth}, {declination} deg less the printed ones [N]", ours - printed)
        say("SCS 3: with b = 0.67 m and the rounded height [N]", rounded - printed)


# --- LIN: generalised forces and Table 2 -------------------------------------------------------------


def check_prism():
    """Print what decides LIN 1 and 3."""
    size, side = 0.578, 0.41
    al, be, g = 0.4, 0.7, np.radians(210)

    def tip(x):
        azimuth = x[0] + g
        return size * np.array([np.cos(azimuth) * np.cos(x[1]), np.sin(azimuth) * np.cos(x[1]), np.sin(x[1])])

    force = np.array([1.0, 2.0, 3.0])
    found = gradient(tip, np.array([al, be])).T @ force
    printed = size * np.cos(be) * (-force[0] * np.sin(al) + force[1] * np.cos(al))
    right = size * np.cos(be) * (-force[0] * np.sin(al + g) + force[1] * np.cos(al + g))
    say("LIN 1: generalised force of the azimuth less (8)-(10) as printed", found[0] - printed)
    say("LIN 1: the same with al + g", found[0] - right)
    azimuth, elevation = np.meshgrid(
        np.radians(np.linspace(-180, 180, 2881)), np.radians(np.linspace(0, 90, 1441))
    )
    c = np.cos(elevation)
    sides = np.sqrt(size**2 + side**2 + 2 * size * side * c * np.cos(azimuth - np.pi / 6)) - 0.336
    square = 2 * size**2 + side**2 + 2 * size * side * c * 2 * np.cos(azimuth) * np.cos(np.pi / 6)
    tops = np.sqrt(square + size**2 * c**2 - 2 * size**2 * np.sin(elevation) ** 2) - 0.356
    distance = 1e3 * np.hypot(sides - 50.5914e-3, tops - 31.3209e-3)
    say("LIN 3: nearest symmetrical configuration to Table 2 at F = 0 [mm]", distance.min())


def say(claim, number):
    """Print a claim and its number."""
    print(f"{claim}: {np.array2string(np.asarray(number), precision=3)}")


if __name__ == "__main__":
    check_tower()
    check_prism()
