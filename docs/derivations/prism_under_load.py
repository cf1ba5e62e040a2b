"""The tables of LIN, checked with NumPy alone: python docs/derivations/prism_under_load.py

Every line states a claim of docs/errata.md and the numbers that decide it. Needs the tables of the paper,
tensegrity_codegen/studies/papers/data/lin_tables.csv.
"""

from itertools import permutations
from pathlib import Path

import numpy as np

TABLES = Path(__file__).resolve().parents[2] / "tensegrity_codegen/studies/papers/data/lin_tables.csv"
GAMMA = np.radians([90.0, 210.0, 330.0])
K, L01, L02, GRAVITY = 173.2, 0.336, 0.356, 9.81
ENDS = (("B1", "B2"), ("B3", "B1"), ("B2", "B3"), ("A1", "B2"), ("A3", "B1"), ("A2", "B3"))
REST = np.array([L02] * 3 + [L01] * 3)


class Prism:
    """The prism with side a and bars of length L [m]; q = (alpha_1..3, beta_1..3)."""

    def __init__(self, a: float = 0.41, length: float = 0.578) -> None:
        self.length = length
        self.mass = 1800.0 * np.pi * (0.004**2 - 0.003**2) * length
        radial = a / np.sqrt(3)
        self.a = np.stack([radial * np.cos(GAMMA), radial * np.sin(GAMMA), 0 * GAMMA], axis=1)

    def tops(self, q: np.ndarray) -> np.ndarray:
        """Return B_i, (3, 3)."""
        al, be = q[:3] + GAMMA, q[3:]
        u = np.stack([np.cos(al) * np.cos(be), np.sin(al) * np.cos(be), np.sin(be)], axis=1)
        return self.a + self.length * u

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Return dB_i / d(alpha_i, beta_i), (3, 3, 2)."""
        al, be = q[:3] + GAMMA, q[3:]
        by_al = np.stack([-np.sin(al) * np.cos(be), np.cos(al) * np.cos(be), 0 * al], axis=1)
        by_be = np.stack([-np.cos(al) * np.sin(be), -np.sin(al) * np.sin(be), np.cos(be)], axis=1)
        return self.length * np.stack([by_al, by_be], axis=2)

    def vectors(self, q: np.ndarray) -> np.ndarray:
        """Return the springs' vectors in the order of the tables, (6, 3)."""
        place = {f"A{k + 1}": self.a[k] for k in range(3)} | {
            f"B{k + 1}": b for k, b in enumerate(self.tops(q))
        }
        return np.array([place[i] - place[j] for i, j in ENDS])

    def extensions(self, q: np.ndarray) -> np.ndarray:
        """Return the extensions in the order of the tables, (6,) [m]."""
        return np.sqrt((self.vectors(q) ** 2).sum(axis=1)) - REST

    def residual(self, q: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Return dU/dq - J^T F, (6,); loads (3, 3) on the tops."""
        d = self.vectors(q)
        pull = (K * self.extensions(q) / np.sqrt((d**2).sum(axis=1)))[:, None] * d
        force = np.zeros((3, 3), dtype=pull.dtype)
        for t, (i, j) in zip(pull, ENDS, strict=True):
            for name, sign in ((i, 1.0), (j, -1.0)):
                if name[0] == "B":
                    force[int(name[1]) - 1] += sign * t
        force += np.array([0, 0, 0.5 * self.mass * GRAVITY]) - load
        return np.einsum("kx,kxc->ck", force, self.jacobian(q)).ravel()

    def hessian(self, q: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Return d2U/dq2, exact to rounding by complex steps."""
        steps = 1e-30j * np.eye(6)
        return np.array([self.residual(q + step, load).imag / 1e-30 for step in steps])

    def settle(self, q: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Return the equilibrium near q."""
        for _ in range(20):
            q = q - np.linalg.solve(self.hessian(q, load), self.residual(q, load))
        return q

    def table(self) -> np.ndarray:
        """Return the extensions for F_3z = 0, -1, ..., -10 N, (11, 6) [mm]."""
        q, rows = np.repeat(np.radians([-165.5, 39.6]), 3), []
        for newton in range(11):
            load = np.zeros((3, 3))
            load[2, 2] = -newton
            q = self.settle(q, load)
            rows.append(1e3 * self.extensions(q))
        return np.array(rows)


def read(number: int) -> np.ndarray:
    """Return a table of the paper, (11, 6)."""
    rows = [line.split(",") for line in TABLES.read_text(encoding="utf-8").splitlines()]
    return np.array([[float(x) for x in row[2:]] for row in rows if row[0] == str(number)])


def nearest_symmetrical(prism: Prism, wanted: np.ndarray) -> float:
    """Return how near any symmetrical configuration comes to extensions (top, side) [mm]."""

    def off(alpha: float, beta: float) -> float:
        q = np.repeat([alpha, beta], 3)
        return float(np.linalg.norm(1e3 * prism.extensions(q)[[0, 3]] - wanted))

    centre, reach = np.radians([-165.0, 40.0]), np.radians([30.0, 30.0])
    for _ in range(60):
        grid = np.linspace(-1, 1, 9)
        trials = [centre + reach * (x, y) for x in grid for y in grid]
        centre = min(trials, key=lambda trial: off(*trial))
        reach = 0.6 * reach
    return off(*centre)


def main() -> None:
    """Print the checks."""
    prism, measured, printed = Prism(), read(1), read(2)
    ours = prism.table()
    orders = np.array(list(permutations(range(6))))
    mean = np.array([np.abs(ours[:, order] - printed).mean() for order in orders])
    names = ["".join(ENDS[k]) for k in orders[mean.argmin()]]
    stated = np.abs(ours[:, [3, 5, 4, 0, 2, 1]] - printed)
    print(f"Order of the columns that fits best, mean {mean.min():.2f} mm: {', '.join(names)};")
    print(f"  the next one {np.sort(mean)[1]:.2f} mm; side springs first {stated.mean():.1f} mm")

    q = prism.settle(np.repeat(np.radians([-165.5, 39.6]), 3), np.diag([0, 0, -5.0]))
    for axis, word in enumerate("xyz"):
        right = prism.jacobian(q)[:, axis, :].T.ravel()
        for shift, how in ((0.0, "alpha"), (GAMMA, "alpha + gamma")):
            al, be, f = q[:3] + shift, q[3:], np.eye(3)[axis]
            alpha = prism.length * np.cos(be) * (f[1] * np.cos(al) - f[0] * np.sin(al))
            beta = prism.length * (f[2] * np.cos(be) - np.sin(be) * (f[0] * np.cos(al) + f[1] * np.sin(al)))
            off = np.abs(np.concatenate([alpha, beta]) - right).max()
            print(f"(8)-(13) with {how}, unit forces along {word}, against J^T F: {off:.1e} m")

    first = np.array([printed[0, :3].mean(), printed[0, 3:].mean()])
    for a, length in ((0.41, 0.578), (0.4129, 0.578), (0.41, 0.5768)):
        changed = Prism(a, length)
        off = nearest_symmetrical(changed, first)
        largest = np.abs(changed.table() - printed).max()
        print(f"First row, a = {a} m, L = {length} m: nearest {off:.2f} mm; all of Table 2 {largest:.2f} mm")

    for table, who in ((printed, "paper"), (ours, "ours")):
        print(f"Mean of |computed - measured| / computed, {who}:", end=" ")
        print(f"{100 * np.abs((table - measured) / table).mean():.2f} %")
    again = 100 * np.abs(printed - measured) / printed
    print(f"Table 3 against Tables 1 and 2: {np.abs(again - read(3)).max():.4f} %")


if __name__ == "__main__":
    main()
