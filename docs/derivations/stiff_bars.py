"""Stiff bars in the mixed form, by Radau IIA-5, with NumPy alone: python docs/derivations/stiff_bars.py

A double pendulum of two bars in a plane, with a soft spring: M q'' = f(q) - G^T t, g(q) = t / mu, where g is
the extension of the bars. Each step solves for the increments Z and tensions of three stages,

    M (D^2 Z / h^2 - D 1 v / h) = f(q + Z) - G^T t,   g(q + Z) = t / mu,   D = A^-1,

by Newton's method with the matrices [s^2 M, G^T; G, -1/mu], s an eigenvalue of D over h: nothing in them
grows with mu, and 1/mu = 0 is a matrix as good as any. The force f needs no derivative: it is soft.

Positions have order 5. Velocities along bars have order 3 and tensions order 2 only (index 3: Hairer and
Wanner 1996, VII.4); the derivatives of the bars' equation, l' = t'/mu and l'' = t''/mu, bring both to the
order of the positions, in one linear solve after the step that does not enter the next one.
"""

import numpy as np

MASS = np.diag([1.0, 1.0, 0.7, 0.7])
WEIGHT = np.array([0.0, -9.81, 0.0, -9.81 * 0.7])
START = np.array([0.6, -0.8, 1.6, -0.8])
LENGTH = np.array([1.0, 1.0])
SPAN = 0.4

ROOT = np.sqrt(6.0)
NODE = np.array([(4 - ROOT) / 10, (4 + ROOT) / 10, 1.0])
POWERS = np.arange(1, 4)
D = (POWERS * NODE[:, None] ** (POWERS - 1)) @ np.linalg.inv(NODE[:, None] ** POWERS)
EIGENVALUE, VECTOR = np.linalg.eig(D)


def soft_force(q: np.ndarray) -> np.ndarray:
    """Return weights and the pull of a spring of 30 N/m from the second mass to (2, 0)."""
    return WEIGHT + 30.0 * np.concatenate([[0.0, 0.0], np.array([2.0, 0.0]) - q[2:]])


def bars(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return extensions (2,) and directions G (2, 4) of the bars."""
    first, second = q[:2], q[2:] - q[:2]
    l1, l2 = np.linalg.norm(first), np.linalg.norm(second)
    g = np.zeros((2, 4))
    g[0, :2], g[1, :2], g[1, 2:] = first / l1, -second / l2, second / l2
    return np.array([l1, l2]) - LENGTH, g


def turning(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return G' v, the centripetal part of l''."""
    result = []
    for d, w in ((q[:2], v[:2]), (q[2:] - q[:2], v[2:] - v[:2])):
        length = np.linalg.norm(d)
        result.append((w @ w - (d @ w / length) ** 2) / length)
    return np.array(result)


def saddle(top: np.ndarray, g: np.ndarray, compliance: float) -> np.ndarray:
    """Return [top, G^T; G, -compliance]."""
    return np.block([[top, g.T], [g, -compliance * np.eye(2)]])


def step(q: np.ndarray, v: np.ndarray, z: np.ndarray, t: np.ndarray, h: float, compliance: float) -> int:
    """Fill increments z (3, 4) and tensions t (3, 2) of the stages; return the number of iterations."""
    inverse = [np.linalg.inv(saddle((s / h) ** 2 * MASS, bars(q)[1], compliance)) for s in EIGENVALUE]
    back = np.linalg.inv(VECTOR)
    count, size = 0, np.inf
    while size > 1e-14 and count < 60:
        left = (D @ D @ z / h**2 - np.outer(D.sum(axis=1), v) / h) @ MASS
        gap = -compliance * t
        for i in range(3):
            extension, g = bars(q + z[i])
            left[i] += g.T @ t[i] - soft_force(q + z[i])
            gap[i] += extension
        side = back @ np.hstack([left, gap])
        change = (VECTOR @ np.array([m @ row for m, row in zip(inverse, side, strict=True)])).real
        z -= change[:, :4]
        t -= change[:, 4:]
        count, size = count + 1, np.abs(change[:, :4]).max()
    return count


def smooth(
    q: np.ndarray, v: np.ndarray, t: np.ndarray, h: float, compliance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return velocity and tension at the end of a step, from l' = t'/mu and l'' = t''/mu."""
    _, g = bars(q)
    parabola = np.linalg.inv(NODE[:, None] ** np.arange(3)) @ t
    slope, bend = (parabola[1] + 2 * parabola[2]) / h, 2 * parabola[2] / h**2
    matrix = saddle(MASS, g, 0.0)
    v = v + np.linalg.solve(matrix, np.concatenate([np.zeros(4), compliance * slope - g @ v]))[:4]
    side = np.concatenate([soft_force(q), compliance * bend - turning(q, v)])
    return v, np.linalg.solve(matrix, side)[4:]


def run(count: int, compliance: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
    """Return position, raw and smooth velocity, smooth tension at SPAN, and iterations a step."""
    q, v, h, total = START.copy(), np.zeros(4), SPAN / count, 0
    z, t = np.zeros((3, 4)), np.zeros((3, 2))
    for _ in range(count):
        z[:] = h * NODE[:, None] * v
        total += step(q, v, z, t, h, compliance)
        q, v = q + z[2], D[2] @ z / h
    better, tension = smooth(q, v, t, h, compliance)
    return q, v, better, tension, total / count


def main() -> None:
    """Print the observed orders and the work over stiffness."""
    for compliance in (1e-9, 1e-12, 0.0):
        exact = run(320, compliance)
        runs = [run(count, compliance) for count in (10, 20, 40)]
        orders = []
        for part in (0, 1, 2, 3):
            errors = [np.abs(found[part] - exact[part]).max() for found in runs]
            orders.append(np.log2(errors[0] / errors[1]))
        named = zip(("position", "velocity", "smooth velocity", "smooth tension"), orders, strict=True)
        told = ", ".join(f"{name} {order:.1f}" for name, order in named)
        print(f"1/mu = {compliance:g} m/N: orders {told}; {runs[1][4]:.1f} iterations a step")


if __name__ == "__main__":
    main()
