"""Problems with load paths that are known in closed form."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Array = NDArray[np.float64]


@dataclass(frozen=True)
class VonMises:
    """Two springs from (-1, 0) and (1, 0) to an apex at (0, height), which is pressed down with force lambda.

    With l0 = |(1, height)|, l the length, y the height of the apex: lambda = 2 k (l0 - l) y / l.
    """

    height: float
    spring_constant: float = 100.0

    @property
    def rest_length(self) -> float:
        return float(np.hypot(1, self.height))

    @property
    def start(self) -> Array:
        return np.array([0.0, self.height])

    def load(self, length: float) -> float:
        height = np.sqrt(length**2 - 1)
        return float(2 * self.spring_constant * (self.rest_length - length) * height / length)

    def limit_load(self) -> float:
        """d lambda / d l = 0 where l^3 = l0."""
        return self.load(self.rest_length ** (1 / 3))

    def residual(self, q: Array, load_factor: float) -> Array:
        force = np.array([0.0, -load_factor])
        for side in (-1, 1):
            vector = q - np.array([side, 0.0])
            length = np.linalg.norm(vector)
            force -= self.spring_constant * (length - self.rest_length) * vector / length
        return force

    def stiffness(self, q: Array, load_factor: float) -> Array:
        total = np.zeros((2, 2))
        for side in (-1, 1):
            vector = q - np.array([side, 0.0])
            length = float(np.linalg.norm(vector))
            along = np.outer(vector, vector) / length**2
            density = self.spring_constant * (length - self.rest_length) / length
            total += self.spring_constant * along + density * (np.eye(2) - along)
        return total

    def load_vector(self, q: Array, load_factor: float) -> Array:
        return np.array([0.0, -1.0])


@dataclass(frozen=True)
class Column:
    """Two rigid links of length 1 with springs c at both joints, pressed along their line with force lambda.

    U = c a^2 / 2 + c (b - a)^2 / 2 + lambda (cos a + cos b), angles a, b; straight at a = b = 0.
    It buckles at lambda = c (3 -+ sqrt 5) / 2.
    """

    spring: float = 2.0

    def residual(self, q: Array, load_factor: float) -> Array:
        a, b = q
        bend = self.spring * np.array([2 * a - b, b - a])
        return -bend + load_factor * np.sin([a, b])

    def stiffness(self, q: Array, load_factor: float) -> Array:
        return self.spring * np.array([[2.0, -1.0], [-1.0, 1.0]]) - load_factor * np.diag(np.cos(q))

    def load_vector(self, q: Array, load_factor: float) -> Array:
        return np.asarray(np.sin(q))


@dataclass(frozen=True)
class Line:
    """q = lambda."""

    def residual(self, q: Array, load_factor: float) -> Array:
        return load_factor - q

    def stiffness(self, q: Array, load_factor: float) -> Array:
        return np.eye(1)

    def load_vector(self, q: Array, load_factor: float) -> Array:
        return np.ones(1)


@dataclass(frozen=True)
class Kinked:
    """A force that grows as q up to q = 1, and with slope `after` from there on."""

    after: float

    def residual(self, q: Array, load_factor: float) -> Array:
        return load_factor - np.where(q < 1, q, 1 + self.after * (q - 1))

    def stiffness(self, q: Array, load_factor: float) -> Array:
        return np.array([[1.0 if q[0] < 1 else self.after]])

    def load_vector(self, q: Array, load_factor: float) -> Array:
        return np.ones(1)


@dataclass(frozen=True)
class Chain:
    """Springs of constant 10 in series, the first one to the ground softer and softer: force q - q^3 / 3.

    It carries 2/3 at most, where the first point has moved by 1.
    """

    size: int

    def residual(self, q: Array, load_factor: float) -> Array:
        stretch = 10 * np.diff(q)
        force = np.append(stretch, load_factor)
        force[1:] -= stretch
        force[0] -= q[0] - q[0] ** 3 / 3
        return force

    def stiffness(self, q: Array, load_factor: float) -> Any:
        main = np.full(self.size, 20.0)
        main[-1], main[0] = 10.0, 10.0 + 1 - q[0] ** 2
        side = np.full(self.size - 1, -10.0)
        return sparse.csc_array(sparse.diags_array([main, side, side], offsets=[0, 1, -1]))

    def load_vector(self, q: Array, load_factor: float) -> Array:
        load = np.zeros(self.size)
        load[-1] = 1
        return load
