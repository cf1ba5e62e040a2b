"""Masses of members that carry their forces: yield of cables and bars, buckling of bars.

A member of length l and force f needs the section f / yield_stress. A bar with pinned ends under the
compression p buckles at pi^2 E I / l^2 (Euler), so that a round bar needs the section
2 l sqrt(k p / (pi E)), k = (1 - h^2) / (1 + h^2) with the ratio h of its radii, 1 for a solid bar. Above half
of the yield stress Johnson's parabola takes over: p / yield_stress + k yield_stress l^2 / (pi E).
"""

from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.system.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class Material:
    """The materials of members, (n_members,) each.

    youngs_modulus [Pa] (nan: not known, of cables), density [kg/m3], yield_stress [Pa], safety_factor against
    buckling, radius_ratio inner over outer radius; buckles: bars of which buckling counts; johnson:
    whether stocky bars buckle by Johnson.
    """

    youngs_modulus: FloatArray
    density: FloatArray
    yield_stress: FloatArray
    safety_factor: FloatArray
    radius_ratio: FloatArray
    buckles: BoolArray
    johnson: bool


@dataclass(frozen=True)
class MassLaw:
    """Least mass of each member over its force, (n_members,) each.

    direct |f| where it yields; under a compression p not less than `find_buckling_mass`: root sqrt(p) up to
    `switch`, above it straight p + offset. Both are one concave function. kink: the compression above which
    yield decides; infinite where it never does.
    """

    length: FloatArray
    direct: FloatArray
    root: FloatArray
    switch: FloatArray
    straight: FloatArray
    offset: FloatArray
    kink: FloatArray

    def scale(self, force: float, mass: float) -> "MassLaw":
        """Return the same law in multiples of a force and of a mass."""
        return MassLaw(
            length=self.length,
            direct=self.direct * force / mass,
            root=self.root * np.sqrt(force) / mass,
            switch=self.switch / force,
            straight=self.straight * force / mass,
            offset=self.offset / mass,
            kink=self.kink / force,
        )

    def find_buckling_mass(self, compression: FloatArray) -> FloatArray:
        """Return the mass that does not buckle, (..., n_members)."""
        p = np.maximum(compression, 0.0)
        stocky = self.straight * np.minimum(p, 1e300) + self.offset
        return np.where(p <= self.switch, self.root * np.sqrt(p), stocky)

    def find_mass(self, tension: FloatArray) -> FloatArray:
        """Return the mass that neither yields nor buckles, (..., n_members)."""
        return np.maximum(self.direct * np.abs(tension), self.find_buckling_mass(-tension))

    def find_compression(self, mass: FloatArray) -> FloatArray:
        """Return the compression at which members of a mass buckle; infinite where they do not."""
        with np.errstate(divide="ignore", invalid="ignore"):
            at_switch = self.root * np.sqrt(self.switch)
            slender = (mass / self.root) ** 2
            stocky = (mass - self.offset) / self.straight
        return np.where(self.root > 0, np.where(mass <= at_switch, slender, stocky), np.inf)

    def find_chord(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return slope and intercept of a line below the mass, a chord from `low` to `high` or the kink."""
        top = np.minimum(high, self.kink)
        mass_low, mass_top = self.find_buckling_mass(low), self.find_buckling_mass(top)
        width = top - low
        slope = np.where(width > 0, (mass_top - mass_low) / np.where(width > 0, width, 1.0), 0.0)
        below_kink = low < self.kink
        return np.where(below_kink, slope, 0.0), np.where(below_kink, mass_low - slope * low, 0.0)

    def find_tangent(self, compression: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return slope and intercept of the tangent, which is above the mass that does not buckle."""
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = np.where(compression <= self.switch, self.root / np.sqrt(compression) / 2, self.straight)
            intercept = self.find_buckling_mass(compression) - slope * compression
        is_finite = np.isfinite(slope) & np.isfinite(intercept)
        return np.where(is_finite, slope, 0.0), np.where(is_finite, intercept, 0.0)

    def find_slopes(self, tension: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of the mass by tension [kg/N] and by length [kg/m], (..., n_members)."""
        p, mass = np.maximum(-tension, 0.0), self.find_mass(tension)
        with np.errstate(divide="ignore", invalid="ignore"):
            slender = self.root / np.sqrt(p) / 2
        is_direct = self.direct * np.abs(tension) >= self.find_buckling_mass(p)
        is_slender = p <= self.switch
        by_compression = np.where(is_slender, slender, self.straight)
        buckles = np.where(is_slender, 2 * mass, mass + 2 * self.offset)
        by_tension = np.where(is_direct, self.direct * np.sign(tension), -by_compression)
        return by_tension, np.where(is_direct, mass, buckles) / self.length


def find_mass_law(material: Material, length: FloatArray) -> MassLaw:
    """Return the masses over the forces of members of these lengths (n_members,) [m]."""
    bars = material.buckles
    modulus = np.where(bars, material.youngs_modulus, 1.0)
    shape = (1 - material.radius_ratio**2) / (1 + material.radius_ratio**2)
    direct = material.density * length / material.yield_stress
    root = 2 * material.density * length**2 * np.sqrt(shape * material.safety_factor / (np.pi * modulus))
    root = np.where(bars, root, 0.0)
    if not material.johnson:
        kink = (root / direct) ** 2
        return MassLaw(length, direct, root, np.full_like(length, np.inf), direct, 0 * length, kink)
    stocky = shape * material.yield_stress * length**2 / (np.pi * modulus)  # section of p = 0
    switch = material.yield_stress * stocky / material.safety_factor
    return MassLaw(
        length=length,
        direct=direct,
        root=root,
        switch=np.where(bars, switch, np.inf),
        straight=direct * material.safety_factor,
        offset=np.where(bars, material.density * length * stocky, 0.0),
        kink=np.where(bars, np.inf, 0.0),
    )
