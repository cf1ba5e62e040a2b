"""Structures as plain arrays, for the analysis of tensions."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Plain:
    """A free structure: equilibrium matrix (3 n_nodes, n_members), and which members are cables."""

    position: FloatArray
    pairs: NDArray[np.int64]
    is_cable: NDArray[np.bool_]

    @property
    def matrix(self) -> FloatArray:
        vector = self.position[self.pairs[:, 0]] - self.position[self.pairs[:, 1]]
        unit = vector / np.linalg.norm(vector, axis=1)[:, None]
        result = np.zeros((len(self.position), 3, len(self.pairs)))
        for e, (i, j) in enumerate(self.pairs):
            result[i, :, e] += unit[e]
            result[j, :, e] -= unit[e]
        return result.reshape(-1, len(self.pairs))


def make_plain(position: Any, bars: list[tuple[int, int]], cables: list[tuple[int, int]]) -> Plain:
    """Return a structure of bars, then cables."""
    pairs = np.array([*bars, *cables], dtype=np.int64).reshape(-1, 2)
    return Plain(np.array(position, dtype=float), pairs, np.arange(len(pairs)) >= len(bars))


def prism(
    p: int, twist: float, *, mirrored: bool = False, radius: float = 0.15, height: float = 0.3
) -> Plain:
    """Return a prism of p bars; twist in radians. mirrored: with p more cables, b_i to t_(i+1)."""
    angle = 2 * np.pi * np.arange(p) / p
    ring = [radius * np.stack([np.cos(a), np.sin(a), 0 * a], axis=1) for a in (angle, angle + twist)]
    position = np.vstack([ring[0], ring[1] + [0.0, 0.0, height]])
    bars = [(i, p + i) for i in range(p)]
    cables = [(start + i, start + (i + 1) % p) for start in (0, p) for i in range(p)]
    cables += [(i, p + (i - 1) % p) for i in range(p)]
    cables += [(i, p + (i + 1) % p) for i in range(p)] if mirrored else []
    return make_plain(position, bars, cables)


def icosahedron() -> Plain:
    """Return the icosahedron of unit bars: three pairs, 24 cables of length sqrt(3/8)."""
    points = []
    for shift in range(3):
        for side in (-1, 1):
            for end in (-1, 1):
                points.append(np.roll([side / 4, 0.0, end / 2], shift))
    place = np.array(points)
    bars = [(2 * k, 2 * k + 1) for k in range(6)]
    gap = np.linalg.norm(place[:, None] - place[None], axis=2)
    cables = [(i, j) for i in range(12) for j in range(i + 1, 12) if abs(gap[i, j] - np.sqrt(3 / 8)) < 1e-9]
    return make_plain(place, bars, cables)
