"""Free rigid bodies among nodes and members: four point masses, the corners, joined by six rigid bars.

A body of mass m and second moments J = tr(I)/2 - I, with principal values J1 >= J2 >= J3, moves exactly as
four masses at the corners of a tetrahedron that keeps its edges: three of (m - m4)/3 on the ellipse with half
axes sqrt(2 J1/(m - m4)), sqrt(2 J2/(m - m4)), and one of m4 = J3/(h^2 + J3/m) at the height h = sqrt(3 J2/m)
above their plane. Equal J give a regular tetrahedron of equal masses; a flat body has a fourth mass of
FLATTEST J1/h^2. A point of the body is a constant combination of the corners, of weights that sum to 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations

import numpy as np

from tensegrity_codegen.structure.frozen import freeze_fields
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.body_places import BodyPlace

EDGE_CORNERS = tuple(combinations(range(4), 2))  # that the six rigid bars of a body join
FLATTEST = 1e-12  # of J1: least J3, so that the fourth corner of a flat body has a mass
THINNEST = 1e-9  # of J1: least J2; below, the body is a bar without a spin of its own


@dataclass(frozen=True)
class BodyPart:
    """A shape that belongs to a body, for its mass and for pictures, in the frame of the body.

    kind: "ball", "cylinder", "tube", "capsule" or "box"; size: radius, radius and length, outer and inner
    radius and length, or three sides [m]; position: of its middle [m]; axes: rotation matrix (3, 3), whose
    third column is the axis of a cylinder; mass [kg].
    """

    kind: str
    size: tuple[float, ...]
    position: FloatArray
    axes: FloatArray
    mass: float = 0.0

    def __post_init__(self) -> None:
        freeze_fields(self)


@dataclass(frozen=True)
class FreeBody:
    """A rigid body whose four corners and points are nodes of a structure; lengths in its own frame [m].

    name: as in the scene; mass [kg]; inertia: about the centre of mass, axes of the frame (3, 3) [kg m2];
    centre: of mass, in the frame (3,); corner: indices of the four nodes that carry it; point: indices of the
    nodes of its points; point_local: their places (n_points, 3); point_radius: of the ball about each that
    touches the ground, NaN if it does not touch; parts: shapes.
    """

    name: str
    mass: float
    inertia: FloatArray
    centre: FloatArray
    corner: tuple[int, ...]
    point: tuple[int, ...] = ()
    point_local: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    point_radius: FloatArray = field(default_factory=lambda: np.zeros(0))
    parts: tuple[BodyPart, ...] = ()

    def __post_init__(self) -> None:
        freeze_fields(self)

    @cached_property
    def tetrahedron(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Axes, corners, masses and moments of the body, see `place_corners`."""
        return place_corners(self.mass, self.inertia)

    @property
    def principal_inertia(self) -> FloatArray:
        """(3,): principal inertias about the centre of mass, ascending [kg m2]."""
        low, middle, high = self.tetrahedron[3]
        return np.array([low + middle, low + high, middle + high])

    @property
    def corner_local(self) -> FloatArray:
        """(4, 3): places of the corners in the frame [m]."""
        axes, corner, _, _ = self.tetrahedron
        return self.centre + corner @ axes.T

    @cached_property
    def _affine(self) -> FloatArray:
        """(4, 4): A with A (x, 1) = weights of the corners at the place x of the frame."""
        return np.linalg.inv(np.vstack([self.corner_local.T, np.ones(4)]))

    def weights(self, local: FloatArray) -> FloatArray:
        """Return the weights of the corners, (..., 4), at places in the frame (..., 3) [m]."""
        found: FloatArray = local @ self._affine[:, :3].T + self._affine[:, 3]
        size = np.abs(self.corner_local).max()
        noise = 1e-15 * (1.0 + np.abs(local).max(initial=0.0) / size)
        return np.asarray(np.where(np.abs(found) < noise, 0.0, found))

    @property
    def axis_weights(self) -> FloatArray:
        """(3, 4): axis i of the frame is the combination of corners with the weights of row i [1/m]."""
        return np.array(self._affine[:, :3].T)

    def place(self) -> BodyPlace:
        """Return what results need of the body."""
        rows = [
            tuple(map(tuple, table.tolist())) for table in (self.axis_weights, self.weights(self.point_local))
        ]
        return BodyPlace(
            self.name,
            tuple(self.corner),
            tuple(self.weights(self.centre).tolist()),
            rows[0],
            tuple(self.point),
            rows[1],
        )

    def mass_at(self, local: FloatArray) -> float:
        """Return the least effective mass of the body at a place of its frame, over all directions [kg]."""
        x, y, z = local - self.centre
        arm = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        by_turning = np.linalg.eigvalsh(arm @ np.linalg.solve(self.inertia, arm.T))[-1]
        return float(1.0 / (1.0 / self.mass + max(0.0, float(by_turning))))


def place_corners(mass: float, inertia: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the tetrahedron of a body.

    Axes (3, 3), whose columns belong to J3, J2, J1 and are right-handed; places of the corners about the
    centre of mass along these axes (4, 3) [m]; their masses (4,) [kg]; the moments J3, J2, J1 (3,) [kg m2].
    """
    moments, axes = np.linalg.eigh(np.trace(inertia) / 2.0 * np.eye(3) - inertia)
    low, middle, high = moments
    low = max(low, FLATTEST * high)
    height = np.sqrt(3.0 * middle / mass)
    top = low / (height**2 + low / mass)
    base = mass - top
    angle = np.pi / 2.0 + 2.0 * np.pi / 3.0 * np.arange(3)
    corner = np.zeros((4, 3))
    corner[:3, 2] = np.sqrt(2.0 * high / base) * np.sin(angle)
    corner[:3, 1] = np.sqrt(2.0 * middle / base) * np.cos(angle)
    corner[0, 1] = 0.0
    corner[:3, 0], corner[3, 0] = -top * height / base, height
    axes *= np.linalg.det(axes)  # 1 or -1
    return axes, corner, np.array([base / 3.0] * 3 + [top]), np.array([low, middle, high])


def find_attached(n_nodes: int, bodies: Sequence[FreeBody]) -> dict[int, tuple[tuple[int, float], ...]]:
    """Return node -> corners with their weights, of the nodes that are points of bodies."""
    return {
        node: tuple((k, float(w)) for k, w in zip(body.corner, weights, strict=True) if w)
        for body in bodies
        for node, weights in zip(body.point, body.weights(body.point_local), strict=True)
    }
