"""The elastic catenary: a uniform cable between two ends under its own weight, by two unknown forces.

With the pull (H, V) of the cable on its first end, towards the other end and downwards, the tension at the
unstrained arc length s is T(s) = sqrt(H^2 + (V - w s)^2), and with p = V / H, q = (V - w l0) / H:

    span  = H l0 / EA + (H / w) (asinh p - asinh q)
    -rise = (V - w l0 / 2) l0 / EA + (T(0) - T(l0)) / w

Both are the gradient of a convex function of (H, V), the complementary energy, so that Newton steps which
never pass far beyond the minimum along their line find the only solution (Irvine, Cable Structures, 1981).
"""

import math
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import is_number
from tensegrity_codegen.system.errors import ConvergenceError, InvalidValueError

TOLERANCE = 1e-10  # residual of a solution, as a part of the size
MAX_ITERATIONS = 200
MAX_OVERSHOOT = 0.9  # slope behind the minimum along a step, over the slope at its start
LARGEST = 1e100  # of lengths and forces, whose products must be numbers
VERTICAL = 1e-14  # span over length up to which a cable hangs along one line


@dataclass(frozen=True)
class Catenary:
    """A uniform elastic cable at rest between two ends; see `find_catenary`.

    Attributes
    ----------
    span, rise : float [m]
        Horizontal distance of the ends, and height of the second above the first.
    length : float [m]
        Unstrained length l0.
    weight : float [N/m]
        Weight w for each metre of unstrained length.
    axial_stiffness : float [N]
        EA; infinite of a cable that does not stretch.
    horizontal_force, vertical_force : float [N]
        H and V, with which the cable pulls its first end towards the second and downwards. It pulls the
        second end with H towards the first, and with w l0 - V downwards.
    """

    span: float
    rise: float
    length: float
    weight: float
    axial_stiffness: float
    horizontal_force: float
    vertical_force: float

    @property
    def _force(self) -> FloatArray:
        return np.array([self.horizontal_force, self.vertical_force])

    @property
    def end_tension(self) -> FloatArray:
        """(2,): tensions at the first and at the second end [N]."""
        return self.tension(np.array([0.0, self.length]))

    @property
    def sag(self) -> float:
        """Largest distance of the cable from the chord of its ends [m]; 0 of a vertical one."""
        chord = math.hypot(self.span, self.rise)
        if self.span <= VERTICAL * self.length:
            return 0.0
        # There the cable is parallel to the chord: (V - w s) / H = -rise / span.
        s = (self.vertical_force + self.horizontal_force * self.rise / self.span) / self.weight
        x, z = self.position(np.array([min(max(s, 0.0), self.length)]))[0]
        return float(abs(x * self.rise - z * self.span) / chord)

    @property
    def tangent(self) -> FloatArray:
        """(2, 2): derivative of the pull on the first end, (H, -V), to (span, rise) [N/m]."""
        flexibility = _flexibility(self, self._force)
        if not np.isfinite(flexibility[0, 0]):  # a loop that hangs straight down resists no sideways motion
            return np.diag([0.0, 1.0 / flexibility[1, 1]])
        turn = np.diag([1.0, -1.0])
        return np.asarray(turn @ np.linalg.inv(flexibility) @ turn)

    @property
    def tangent_stiffness(self) -> FloatArray:
        """(4, 4): tangent stiffness over (x, z) of the first and of the second end [N/m]."""
        return np.asarray(np.kron([[1.0, -1.0], [-1.0, 1.0]], self.tangent))

    def tension(self, s: FloatArray) -> FloatArray:
        """Return the tensions at unstrained arc lengths [m] from the first end [N]."""
        return np.asarray(np.hypot(self.horizontal_force, self.vertical_force - self.weight * s))

    def position(self, s: FloatArray) -> FloatArray:
        """Return the places (n, 2) of unstrained arc lengths (n,), (x, z) from the first end [m]."""
        ends = [_displace(self, self._force, float(arc)) for arc in np.asarray(s)]
        return np.array(ends).reshape(-1, 2) * [1.0, -1.0]

    def points(self, n: int) -> FloatArray:
        """Return n + 1 places (x, z) at equal unstrained distances, from end to end, (n + 1, 2) [m]."""
        return self.position(np.linspace(0.0, self.length, n + 1))


def find_catenary(
    span: float, rise: float, length: float, weight: float, axial_stiffness: float = math.inf
) -> Catenary:
    """Find the forces of a uniform cable that hangs between two ends.

    Parameters
    ----------
    span : float [m]
        Horizontal distance of the ends, 0 or more; 0 of a vertical cable, which has H = 0.
    rise : float [m]
        Height of the second end above the first.
    length : float [m]
        Unstrained length.
    weight : float [N/m]
        Weight for each metre of unstrained length, above 0.
    axial_stiffness : float [N]
        EA; infinite for a cable that does not stretch, which must be longer than the distance of its ends.

    Returns
    -------
    Catenary
        Forces, end tensions, sag, shape, tangent.

    Raises
    ------
    InvalidValueError
        A number out of range, or a cable that does not stretch and is too short.
    ConvergenceError
        Rounding prevents a solution, as where a cable that does not stretch is hardly longer than its chord.

    Notes
    -----
    Irvine, Cable Structures (1981): T(s)^2 = H^2 + (V - w s)^2.

    Examples
    --------
    >>> from tensegrity_codegen import find_catenary
    >>> found = find_catenary(10.0, 0.0, 10.5, 1.0)
    >>> round(found.horizontal_force, 10), round(found.sag, 11), round(float(found.end_tension[0]), 10)
    (9.1963963004, 1.39304206592, 10.5894383663)
    """
    values = (span, rise, length, weight, axial_stiffness)
    low = {"span": "0 or more [m]", "rise": "a number [m]"}
    for name, value in zip(("span", "rise", "length", "weight", "axial_stiffness"), values, strict=True):
        is_endless = name == "axial_stiffness" and isinstance(value, float) and value == math.inf
        is_sound = is_endless or (is_number(value) and abs(value) < LARGEST)
        if not is_sound or value < (-math.inf if name == "rise" else 0) or (name not in low and value == 0):
            allowed = low.get(name, "more than 0")
            raise InvalidValueError("not a cable", where=name, given=value, allowed=allowed)
    chord = math.hypot(span, rise)
    if not math.isfinite(axial_stiffness) and length <= chord:
        problem = "a cable that does not stretch is not longer than the distance of its ends"
        allowed = f"more than {chord:.6g} m, or an axial_stiffness"
        raise InvalidValueError(problem, where="length", given=length, allowed=allowed)
    start = Catenary(*values, 0.0, 0.0)
    return Catenary(*values, *((0.0, _hang(start)) if span <= VERTICAL * length else _iterate(start)))


def _hang(cable: Catenary) -> float:
    """Return V of a vertical cable: its height is a piecewise linear, increasing function of V."""
    down, total = -cable.rise, cable.weight * cable.length
    give = cable.length / cable.axial_stiffness
    loop = (down + give * total / 2 + cable.length) / (give + 2 / cable.weight)
    if 0 <= loop <= total:
        return loop
    beyond = -cable.length if loop > total else cable.length
    return total / 2 + (down + beyond) / give


def _iterate(cable: Catenary) -> tuple[float, float]:
    """Return H and V by Newton's method with steps that are shortened where they pass the minimum."""
    goal = np.array([cable.span, -cable.rise])
    stretch = cable.weight * cable.length / cable.axial_stiffness
    size = max(float(np.linalg.norm(goal)), cable.length * (1.0 + stretch))
    force, best, smallest = _guess(cable), np.zeros(2), math.inf
    for _ in range(MAX_ITERATIONS):
        residual = _displace(cable, force, cable.length) - goal
        error = float(np.abs(residual).max())
        if error < smallest:
            best, smallest = force, error
        elif smallest <= TOLERANCE * size:  # rounding alone is left
            break
        step = -np.linalg.solve(_flexibility(cable, force), residual)
        step_fraction = 1.0 if force[0] + step[0] >= 0.1 * force[0] else -0.9 * force[0] / step[0]
        slope = float(residual @ step)
        while step_fraction > 1e-12:
            ahead = _displace(cable, force + step_fraction * step, cable.length) - goal
            if float(ahead @ step) <= -MAX_OVERSHOOT * slope:
                break
            step_fraction /= 2
        force = force + step_fraction * step
    if smallest > TOLERANCE * size:
        raise ConvergenceError(
            "the forces of the cable were not found to the precision of numbers",
            where="length",
            hint="a larger axial_stiffness, or a length that differs clearly from the distance of the ends",
            evidence={"residual": smallest, "span": cable.span, "rise": cable.rise, "length": cable.length},
        )
    return float(best[0]), float(best[1])


def _guess(cable: Catenary) -> FloatArray:
    """Return H and V of a parabola of that length, or of a straight cable that is stretched more."""
    chord, length = math.hypot(cable.span, cable.rise), cable.length
    excess = (length**2 - cable.rise**2) / cable.span**2 - 1.0
    depth = min(math.sqrt(3.0 * excess), 50.0) if excess > 0.0 else 0.2
    stretched = 0.0
    if math.isfinite(cable.axial_stiffness):
        stretched = cable.axial_stiffness * max(chord / length - 1.0, 0.0) * cable.span / chord
    h = max(cable.weight * cable.span / (2.0 * depth), stretched)
    return np.array([h, cable.weight * length / 2.0 - h * cable.rise / cable.span * depth / math.tanh(depth)])


def _displace(cable: Catenary, force: FloatArray, s: float) -> FloatArray:
    """Return how far the arc length s is from the first end, horizontally and downwards, (2,) [m]."""
    h, v = force.tolist()
    w, below = cable.weight, v - cable.weight * s
    top_force, second = math.hypot(h, v), math.hypot(h, below)
    give, tensions = s / cable.axial_stiffness, top_force + second
    # Differences of nearly equal numbers as products: T(0)^2 - T(s)^2 = w s (2 V - w s).
    drop = s * (v + below) / tensions if tensions else 0.0
    return np.array([h * give + (h / w * _turn(h, v, w * s) if h else 0.0), (v - w * s / 2) * give + drop])


def _flexibility(cable: Catenary, force: FloatArray) -> FloatArray:
    """Return the derivative of both distances of the ends to (H, V), (2, 2) [m/N]."""
    h, v = force.tolist()
    w, below = cable.weight, v - cable.weight * cable.length
    top_force, second = math.hypot(h, v), math.hypot(h, below)
    give = cable.length / cable.axial_stiffness
    if h == 0.0:  # along one line: taut, or a loop
        taut = v * below > 0
        across = math.log(max(top_force, second) / min(top_force, second)) / w if taut else math.inf
        return np.diag([give + across, give + (0.0 if taut else 2.0 / w)])
    turn = _turn(h, v, w * cable.length)
    tilt = math.sinh(turn) * (h / top_force) * (h / second)  # V / T(0) - (V - w l0) / T(l0)
    mixed = -h * cable.length * (v + below) / ((top_force + second) * top_force * second)
    return np.array([[give + (turn - tilt) / w, mixed], [mixed, give + tilt / w]])


def _turn(h: float, v: float, weight: float) -> float:
    """Return asinh(V / H) - asinh((V - weight) / H), without cancellation where both are nearly equal."""
    p, q = v / h, (v - weight) / h
    if p * q <= 0:
        return math.asinh(p) - math.asinh(q)
    middle = 1.0 + p * q + math.hypot(1.0, p) * math.hypot(1.0, q)
    return 2.0 * math.asinh(weight / h / math.sqrt(2.0 * middle))
