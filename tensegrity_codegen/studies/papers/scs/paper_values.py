"""What SCS prints of its examples, and the data with which it comes out."""

from dataclasses import dataclass

from tensegrity_codegen.studies.papers.scs.symmetry import SymmetricPose

PAPER_DURATION = 5.0  # [s], tau
PRINTED_SIDE = 0.67  # [m], b of (43); 2/3 m gives the printed tensions


@dataclass(frozen=True)
class PaperPose:
    """A printed equilibrium: equation, angles [deg], Z as printed and as it must have been [m], F_3, T_r [N].

    height: with b = 2/3 m, the Z at which the largest error of the tensions is smallest. The
    declination of (53) was printed as 22.03 deg; it is computed from (48).
    """

    equation: str
    alpha_deg: float
    delta_deg: float
    printed_height: float
    height: float
    force: float
    tension: tuple[float, float, float]

    @property
    def pose(self) -> SymmetricPose:
        """The configuration at the height that gives the printed tensions."""
        return SymmetricPose.from_degrees(self.alpha_deg, self.delta_deg, self.height)

    @property
    def printed_pose(self) -> SymmetricPose:
        """The configuration as printed."""
        return SymmetricPose.from_degrees(self.alpha_deg, self.delta_deg, self.printed_height)


PAPER_POSES = {
    "44": PaperPose("(44)", 55.0, 40.0, 1.11, 1.1106553, -50.0, (26.11, 1.85, 18.38)),
    "45": PaperPose("(45)", 65.0, 35.0, 1.11, 1.1106553, -50.0, (46.97, 12.27, 43.0)),
    "52": PaperPose("(52)", 70.0, 30.0, 1.6, 1.60504, 50.0, (0.49, 8.91, 8.79)),
    "53": PaperPose("(53)", 65.0, 22.03, 1.6, 1.60504, 50.0, (3.58, 4.93, 11.29)),
}
