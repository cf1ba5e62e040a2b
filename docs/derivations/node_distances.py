"""S&K, checked from the definitions with NumPy alone: python docs/derivations/node_distances.py

Every line states a claim of docs/errata.md and the number that decides it.
"""

import numpy as np

N = 6
RNG = np.random.default_rng(1)


def difference_matrix(n: int) -> np.ndarray:
    """Return D (3k, 3n) of all pairs, uvec321 (S&K 3.3)."""
    rows = [(i, j) for i in range(n) for j in range(i + 1, n)]
    incidence = np.zeros((len(rows), n))
    for row, (i, j) in enumerate(rows):
        incidence[row, i], incidence[row, j] = 1.0, -1.0
    return np.kron(incidence, np.eye(3))


def null_space(matrix: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis of the null space."""
    _, size, right = np.linalg.svd(matrix)
    return right[np.sum(size > 1e-12 * size[0]) :].T


def star_cycles(n: int) -> np.ndarray:
    """Return the cycles 0 - i - j - 0 of all pairs (i, j) without node 0: d_ij + d_0i - d_0j = 0."""
    rows = {pair: k for k, pair in enumerate((i, j) for i in range(n) for j in range(i + 1, n))}
    closing = [(i, j) for i in range(1, n) for j in range(i + 1, n)]
    basis = np.zeros((len(rows), len(closing)))
    for column, (i, j) in enumerate(closing):
        basis[rows[i, j], column] = basis[rows[0, i], column] = 1.0
        basis[rows[0, j], column] = -1.0
    return np.kron(basis, np.eye(3))


def relative(found: np.ndarray, expected: np.ndarray) -> float:
    """Return the largest difference over the largest expected value."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def main() -> None:
    """Print the checks."""
    mass = RNG.uniform(0.2, 2.0, N)
    total = mass.sum()
    d, h = difference_matrix(N), np.diag(np.repeat(mass, 3))
    centre = np.kron(mass / total, np.eye(3))
    first, second = np.triu_indices(N, 1)
    share = np.diag(np.repeat(mass[first] * mass[second] / total, 3))

    print("S&K 6  H = D^T H_delta D + J_c^T M J_c, H_delta = diag(m_i m_j / sum m):", end=" ")
    print(f"{relative(d.T @ share @ d + total * centre.T @ centre, h):.1e}")

    applied = d @ np.linalg.inv(h) @ d.T
    print("S&K 1  pinv(H_delta) against D H^-1 D^T:", end=" ")
    print(f"{relative(np.linalg.pinv(share), applied):.1e}")
    orthonormal, cycles = null_space(d.T), star_cycles(N)
    force = RNG.normal(size=len(d))
    for name, basis in (("orthonormal", orthonormal), ("cycles", cycles)):
        zero = np.zeros((basis.shape[1], basis.shape[1]))
        saddle = np.block([[share, basis], [basis.T, zero]])
        block = np.linalg.inv(saddle)[: len(d), : len(d)]
        print(f"       upper left block of the inverse of the saddle matrix, {name}:", end=" ")
        print(f"{relative(block, applied):.1e}")

    print("S&K 7  numbers other than zero in L:", end=" ")
    print(f"orthonormal {np.sum(np.abs(orthonormal) > 1e-12)}, cycles {np.count_nonzero(cycles)}")
    product = [
        share @ applied @ force + basis @ solve(share, basis, force) for basis in (orthonormal, cycles)
    ]
    print(f"       H_delta delta'' + L lambda = f: {relative(product[0], force):.1e}", end=" ")
    print(f"and {relative(product[1], force):.1e}")

    print("S&K 4  Lemma 1, J_c D^T = 0, with unequal masses:", end=" ")
    print(f"{np.abs(centre @ d.T).max():.2f}; J_c H^-1 D^T:", end=" ")
    print(f"{np.abs(centre @ np.linalg.inv(h) @ d.T).max():.1e}")

    vector, mu, rho = np.array([0.3, -0.4, 1.2]), 200.0, 1.1
    length = np.linalg.norm(vector)
    block = -mu * ((1 - rho / length) * np.eye(3) + rho / length**3 * np.outer(vector, vector))
    print("S&K 5  largest off-diagonal entry of a block of the force Jacobian [N/m]:", end=" ")
    print(f"{np.abs(block - np.diag(np.diag(block))).max():.1f}")


def solve(inertia: np.ndarray, basis: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Return the multipliers of the saddle system."""
    count = basis.shape[1]
    saddle = np.block([[inertia, basis], [basis.T, np.zeros((count, count))]])
    return np.linalg.solve(saddle, np.concatenate([force, np.zeros(count)]))[len(force) :]


if __name__ == "__main__":
    main()
