"""Interference of bars: the distance of two bars, its points, and the case of the geometry.

Bar 1 runs from a to b, bar 2 from c to d; with u = b - a, v = d - c, w = c - a their axes are
P(s) = a + s u and Q(t) = c + t v, 0 <= s, t <= 1, and

    distance = min |Q(t) - P(s)| - R1 - R2

Ends are spherical: a bar is its axis thickened by its radius (a capsule), which is also how the paper counts:
D_i of LIN 3.2 is the distance between the axes, and bars interfere if it is less than their diameter. A
cylinder with flat ends lies within the capsule, so flat-ended bars are never closer than this; where the
nearest points are inner points of both axes (LIN's case 1) the two distances are equal.

The distance is exact to rounding in all positions: bars that cross, that are parallel (to 1e-14 rad; the
points are then put into the middle of the stretch where the bars face each other), on one line, overlapping,
or without any length. Clamping one parameter, projecting, clamping the other finds the minimum of the convex
distance over the square (Lumelsky 1985; Ericson, Real-Time Collision Detection, 2005, 5.1.9); s comes from
the triple product (w x v) . n / n^2, n = u x v, which keeps its digits where the axes are nearly parallel.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import casadi as ca

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.geometry import Scalar, Vector, cross, dot
from tensegrity_codegen.system.errors import FormulationError

# Value of bar_distance_case -> name. C_i is the foot of the axes' common normal on the line of bar i;
# "outside" means beyond an end of the bar; "end" and "inner" are where the nearest points lie.
# In brackets: LIN 3.2.
BAR_DISTANCE_CASE = {
    1: "both_inside",  # C_1, C_2 on the bars: inner to inner (case 1, Fig. 2a, eq. 23)
    2: "first_outside_end_to_inner",  # C_1 outside: end of 1 to inner point of 2 (case 2, Fig. 2b, eq. 26)
    3: "first_outside_end_to_end",  # C_1 outside: end of 1 to end of 2 (case 2, Fig. 2c, eq. 27)
    4: "second_outside_inner_to_end",  # C_2 outside: inner point of 1 to end of 2 (case 2, Fig. 2d, eq. 28)
    5: "second_outside_end_to_end",  # C_2 outside: end of 1 to end of 2 (case 2, Fig. 2e, eq. 29)
    6: "both_outside_end_to_inner",  # both outside: end of 1 to inner point of 2 (case 3.1, Fig. 2f)
    7: "both_outside_inner_to_end",  # both outside: inner point of 1 to end of 2 (case 3.2, Fig. 2g)
    8: "both_outside_end_to_end",  # both outside: end of 1 to end of 2 (case 3.3, Fig. 2h)
    9: "parallel_side_by_side",  # no single common normal, the bars face each other (not in the paper)
    10: "parallel_apart",  # no single common normal, nearest points are ends (not in the paper)
    11: "no_length",  # one of the bars is a point (not in the paper)
}

# Pairs of bars that can be had in one library; the number of all pairs grows as the square of the bars'.
MAX_PAIRS = 500

PARALLEL = 1e-14  # largest sine of the angle between axes that count as parallel


@dataclass(frozen=True)
class BarContact:
    """Two bars: surface distance [m], case, parameters and nearest points of the axes, derivatives.

    normal: unit vector from the first nearest point to the second. gradient: of the distance to a, b, c, d,
    four vectors -(1-s) n, -s n, (1-t) n, t n. If the axes meet the distance has no gradient; the normal
    is then the common normal u x v / |u x v| (one of its two one-sided limits), and zero if the axes also
    are parallel: always finite.
    """

    distance: Scalar
    case: Scalar
    parameters: tuple[Scalar, Scalar]
    points: tuple[Vector, Vector]
    normal: Vector

    @property
    def gradient(self) -> tuple[Vector, Vector, Vector, Vector]:
        """Return d distance / d (a, b, c, d), four vectors."""
        s, t = self.parameters
        weights = (-(1 - s), -s, 1 - t, t)
        return tuple([weight * n for n in self.normal] for weight in weights)  # type: ignore[return-value]


def build_bar_contact(a: Vector, b: Vector, c: Vector, d: Vector, radii: Scalar = 0.0) -> BarContact:
    """Return the contact of the bars a-b and c-d, points of 1 to 3 components [m]; radii: R1 + R2 [m]."""
    count = len(a)
    a, b, c, d = ([*point, *[ca.SX(0.0)] * (3 - len(point))] for point in (a, b, c, d))
    u, v, w = _minus(b, a), _minus(d, c), _minus(c, a)
    uu, vv = dot(u, u), dot(v, v)
    n = cross(u, v)
    nn = dot(n, n)
    parallel = ca.logic_not(nn > PARALLEL * PARALLEL * uu * vv)
    offset = _over(dot(cross(w, v), n), nn)
    second = _over(dot(cross(w, u), n), nn)
    start, end = _over(dot(w, u), uu), _over(dot(w, u) + dot(v, u), uu)
    middle = (ca.fmax(0, ca.fmin(start, end)) + ca.fmin(1, ca.fmax(start, end))) / 2
    s = _clamp(ca.if_else(parallel, middle, offset))
    t = _clamp(_over(s * dot(u, v) - dot(w, v), vv))
    s = _clamp(_over(t * dot(u, v) + dot(w, u), uu))
    p = [x + s * y for x, y in zip(a, u, strict=True)]
    q = [x + t * y for x, y in zip(c, v, strict=True)]
    gap = _minus(q, p)
    axes = ca.sqrt(dot(gap, gap))
    feet = (_is_within(offset), _is_within(second))
    no_length = ca.logic_or(ca.logic_not(uu > 0), ca.logic_not(vv > 0))
    case = ca.if_else(no_length, 11, ca.if_else(parallel, _parallel_case(s, t), _case(feet, s, t)))
    aside = [_over(x, ca.sqrt(nn)) for x in n]
    aside = [ca.if_else(parallel, 0, x) for x in aside]
    normal = [ca.if_else(axes > 0, _over(x, axes), y) for x, y in zip(gap, aside, strict=True)]
    return BarContact(axes - radii, case, (s, t), (p[:count], q[:count]), normal[:count])


class BarPairs:
    """All chosen pairs of bars of one model, quantity by quantity.

    ends: the two end points of every bar, each a list of n_axes expressions [m]; radius: of every bar [m];
    pairs: indices of bars. Any formulation can make one: the points are expressions of whatever coordinates
    it has, counted from `origin` (n_axes, zero if not given). Raises FormulationError for more than
    MAX_PAIRS pairs, or none.
    """

    def __init__(
        self,
        ends: Sequence[Sequence[Vector]],
        radius: Sequence[float],
        pairs: Sequence[tuple[int, int]],
        where: str = "",
        origin: Vector | None = None,
    ) -> None:
        check_bar_pairs(len(pairs), where)
        self.origin = origin
        self.ends, self.radius, self.pairs = list(ends), list(radius), list(pairs)
        self.n_axes = len(self.ends[0][0])

    def distance(self) -> ca.SX:
        """Return the surface distances [m], (n_bar_pairs, 1)."""
        return self._results[0].T

    def case(self) -> ca.SX:
        """Return the numbers of the cases, (n_bar_pairs, 1)."""
        return self._results[1].T

    def parameters(self) -> ca.SX:
        """Return s and t of the nearest points, (2, n_bar_pairs)."""
        return self._results[2]

    def nearest_point(self) -> ca.SX:
        """Return the nearest points of both axes, pair by pair, (n_axes, 2 n_bar_pairs) [m]."""
        points = ca.reshape(self._results[3], self.n_axes, 2 * len(self.pairs))
        return (
            points
            if self.origin is None
            else points + ca.repmat(ca.vertcat(*self.origin), 1, points.shape[1])
        )

    def gradient(self) -> ca.SX:
        """Return d distance / d (a, b, c, d), the ends of both bars, (4 n_axes, n_bar_pairs)."""
        return self._results[4]

    def jacobian(self, coordinate: ca.SX) -> ca.SX:
        """Return d distance / d coordinate by n . dP, sparse (n_bar_pairs, n_coordinates)."""
        gradient = self.gradient()
        size, width = self.n_axes, 2 * self.n_axes
        rows: list[int] = []
        columns: list[int] = []
        values: list[ca.SX] = []
        for row, pair in enumerate(self.pairs):
            for end, bar in enumerate(pair):
                rows += [row] * width
                columns += range(bar * width, (bar + 1) * width)
                values.append(gradient[end * width : (end + 1) * width, row])
        points = ca.vertcat(*[ca.vertcat(*point) for two in self.ends for point in two])
        stacked = ca.SX.triplet(
            rows, columns, ca.vertcat(*values), len(self.pairs), 2 * size * len(self.ends)
        )
        return ca.sparsify(ca.mtimes(stacked, ca.jacobian(points, coordinate)))

    @cached_property
    def _results(self) -> list[ca.SX]:
        """Distance, case, parameters, points and gradient, one column a pair each."""
        columns = []
        for first, second in self.pairs:
            four = [ca.vertcat(*point) for bar in (first, second) for point in self.ends[bar]]
            columns.append(self._kernel.call([*four, ca.SX(self.radius[first] + self.radius[second])]))
        return [ca.horzcat(*entries) for entries in zip(*columns, strict=True)]

    @cached_property
    def _kernel(self) -> ca.Function:
        """One pair as a function of a, b, c, d and R1 + R2."""
        points = [ca.SX.sym(name, self.n_axes) for name in "abcd"]
        radii = ca.SX.sym("radii")
        a, b, c, d = ([p[k] for k in range(self.n_axes)] for p in points)
        contact = build_bar_contact(a, b, c, d, radii)
        outputs = [
            contact.distance,
            contact.case,
            ca.vertcat(*contact.parameters),
            ca.vertcat(*contact.points[0], *contact.points[1]),
            ca.vertcat(*[component for vector in contact.gradient for component in vector]),
        ]
        return ca.Function("bar_contact", [*points, radii], [ca.SX(output) for output in outputs])


def build_bar_quantities(
    make_pairs: Callable[[], BarPairs], coordinate: ca.SX
) -> dict[str, Callable[[], ca.SX]]:
    """Return quantity name -> builder; nothing is built, and no error raised, before one is called.

    make_pairs: returns the pairs; coordinate: the symbols that the Jacobian is taken to.
    """
    pairs = cache(make_pairs)
    return {
        "bar_distance": lambda: pairs().distance(),
        "bar_distance_case": lambda: pairs().case(),
        "bar_distance_parameters": lambda: pairs().parameters(),
        "bar_nearest_point": lambda: pairs().nearest_point(),
        "bar_distance_jacobian": lambda: pairs().jacobian(coordinate),
    }


def pair_members(structure: Structure, position: Sequence[Vector], origin: Vector | None = None) -> BarPairs:
    """Return the pairs of a structure whose nodes are at `position`, n_nodes vectors [m] from `origin`."""
    check_bar_pairs(structure.n_bar_pairs, structure.name)
    chosen = [(int(i), int(j)) for i, j in structure.bar_pairs]
    bars = sorted({bar for pair in chosen for bar in pair})
    row = {bar: k for k, bar in enumerate(bars)}
    ends = [tuple(position[node] for node in structure.connectivity[bar]) for bar in bars]
    radius = [float(structure.radius[bar]) for bar in bars]
    return BarPairs(ends, radius, [(row[i], row[j]) for i, j in chosen], structure.name, origin)


def check_bar_pairs(count: int, where: str = "") -> None:
    """Raise FormulationError if there are no pairs of bars, or more than one library can take."""
    if count == 0:
        raise FormulationError(
            "there are no two bars that could touch",
            where=where,
            allowed="two bars or more with a radius, which share no node",
            hint="give the bars a radius [m]; contacts are of bars, not of rigid bodies",
        )
    if count > MAX_PAIRS:
        raise FormulationError(
            "there are too many pairs of bars",
            where=where,
            given=f"{count} pairs",
            allowed=f"at most {MAX_PAIRS} pairs",
            hint='name the pairs that matter: [interference] pairs = [["bar1", "bar2"], ...]',
        )


def _case(feet: tuple[Scalar, Scalar], s: Scalar, t: Scalar) -> Scalar:
    """Return the case of axes that are not parallel; feet: whether C_1, C_2 are on the bars."""
    on_first, on_second = feet
    second_inner, first_inner = _is_inner(t), _is_inner(s)
    first_outside = ca.if_else(second_inner, 2, 3)
    second_outside = ca.if_else(first_inner, 4, 5)
    both_outside = ca.if_else(second_inner, 6, ca.if_else(first_inner, 7, 8))
    return ca.if_else(
        on_first, ca.if_else(on_second, 1, second_outside), ca.if_else(on_second, first_outside, both_outside)
    )


def _parallel_case(s: Scalar, t: Scalar) -> Scalar:
    """Side by side: the midpoint of the facing stretch is inside of one of the bars at least."""
    return ca.if_else(ca.logic_or(_is_inner(s), _is_inner(t)), 9, 10)


def _is_within(x: Scalar) -> Scalar:
    return ca.logic_and(x >= 0, x <= 1)


def _is_inner(x: Scalar) -> Scalar:
    return ca.logic_and(x > 0, x < 1)


def _clamp(x: Scalar) -> Scalar:
    return ca.fmax(0, ca.fmin(1, x))


def _over(x: Scalar, y: Scalar) -> Scalar:
    """Return x / y, and zero if y is zero or not a number."""
    usable = y > 0
    return ca.if_else(usable, x / ca.if_else(usable, y, 1), 0)


def _minus(x: Vector, y: Vector) -> Vector:
    return [p - q for p, q in zip(x, y, strict=True)]
