"""Azimuth and declination over time between two symmetrical configurations (SCS 36 to 41, 46 to 51)."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tensegrity_codegen.studies.papers.scs.symmetry import SymmetricPose, SymmetricTower
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InfeasibleError

SIXTY = math.radians(60.0)


@dataclass(frozen=True)
class Motion:
    """s = (alpha, delta, Z) and its first two derivatives at one time, each (3,)."""

    s: FloatArray
    rate: FloatArray
    change: FloatArray


class MotionPath(Protocol):
    """A motion for all times: at rest before 0 and after the duration."""

    def at(self, time: float) -> Motion:
        """Return the motion at a time [s]."""
        ...


def blend(time: float, duration: float) -> tuple[float, float, float]:
    """Return p, p', p'' of the quintic from 0 to 1 that starts and ends at rest (SCS 39).

    p = 10 x^3 - 15 x^4 + 6 x^5 with x = t / tau, which is the bracket of (39) times 30 / tau^5.
    """
    x = min(max(time / duration, 0.0), 1.0)
    value = x**3 * (10.0 + x * (6.0 * x - 15.0))
    rate = 30.0 * x**2 * (x - 1.0) ** 2 / duration
    change = 60.0 * x * (x - 1.0) * (2.0 * x - 1.0) / duration**2
    return value, rate, change


@dataclass(frozen=True)
class QuinticPath:
    """Both angles by the quintic (38) to (41), at constant height; duration [s]."""

    start: SymmetricPose
    end: SymmetricPose
    duration: float

    def at(self, time: float) -> Motion:
        """Return the motion at a time [s]."""
        first = self.start.parameter
        way = self.end.parameter - first
        value, rate, change = blend(time, self.duration)
        return Motion(first + value * way, rate * way, change * way)


@dataclass(frozen=True)
class TorqueFreePath:
    """alpha by the quintic, delta so that no torque is needed (48), at constant height.

    (48) is linear in sin(delta): sin(delta) = N / D(alpha), N = k sin(delta_i) cos(alpha_i + 60 deg) and
    D = 3 J~ sin(delta_i) sin(alpha - alpha_i) + k cos(alpha + 60 deg), k = m~ b / sqrt(3). Its derivatives
    are those of implicit differentiation (50), (51).
    """

    start: SymmetricPose
    alpha_end: float
    duration: float
    spin: float  # 3 J~ sin(delta_i) [kg m2]
    coupling: float  # k [kg m2]

    @classmethod
    def of(
        cls, tower: SymmetricTower, start: SymmetricPose, alpha_end: float, duration: float
    ) -> "TorqueFreePath":
        """Return the path of a tower from `start` to an azimuth [rad] in `duration` [s].

        Raises InfeasibleError if (48) has no solution somewhere on the way.
        """
        spin = 3.0 * tower.bar_inertia * math.sin(start.delta)
        path = cls(start, alpha_end, duration, spin, tower.bar_moment * tower.side / math.sqrt(3.0))
        path._check()
        return path

    @property
    def end(self) -> SymmetricPose:
        """The configuration reached."""
        return SymmetricPose(self.alpha_end, self.declination(self.alpha_end)[0], self.start.height)

    def declination(self, alpha: float) -> tuple[float, float, float]:
        """Return delta and its first two derivatives to alpha; NaN where (48) has no solution."""
        offset = alpha - self.start.alpha
        across, along = math.cos(alpha + SIXTY), math.sin(alpha + SIXTY)
        top = self.coupling * math.sin(self.start.delta) * math.cos(self.start.alpha + SIXTY)
        bottom = self.spin * math.sin(offset) + self.coupling * across
        slope = self.spin * math.cos(offset) - self.coupling * along
        # The second derivative of the bottom is minus the bottom.
        if bottom == 0.0 or not 0.0 < top / bottom < 1.0:
            return math.nan, math.nan, math.nan
        sine = top / bottom
        first = -sine * slope / bottom
        second = sine * (2.0 * (slope / bottom) ** 2 + 1.0)
        cosine = math.sqrt(1.0 - sine * sine)
        tilt = first / cosine
        return math.asin(sine), tilt, (second + sine * tilt * tilt) / cosine

    def at(self, time: float) -> Motion:
        """Return the motion at a time [s]."""
        value, rate, change = blend(time, self.duration)
        way = self.alpha_end - self.start.alpha
        alpha, turn, turn2 = self.start.alpha + value * way, rate * way, change * way
        delta, by_alpha, by_alpha2 = self.declination(alpha)
        return Motion(
            np.array([alpha, delta, self.start.height]),
            np.array([turn, by_alpha * turn, 0.0]),
            np.array([turn2, by_alpha * turn2 + by_alpha2 * turn * turn, 0.0]),
        )

    def _check(self) -> None:
        """Raise InfeasibleError where sin(delta) would leave (0, 1) between the two azimuths."""
        azimuths = np.linspace(self.start.alpha, self.alpha_end, 1001)
        missing = [alpha for alpha in azimuths if math.isnan(self.declination(float(alpha))[0])]
        if missing:
            raise InfeasibleError(
                "no motion without torque goes there: SCS (48) has no declination in 0 to 90 deg",
                evidence={
                    "alpha_deg": math.degrees(missing[0]),
                    "alpha_end_deg": math.degrees(self.alpha_end),
                },
                where="reconfiguration",
                hint="allow a torque, or choose a nearer azimuth",
            )
