"""The record of an analysis: what tensions a structure can have in a configuration, and how it moves."""

from dataclasses import dataclass

from tensegrity_codegen.runtime.analysis.certificate import Certificate
from tensegrity_codegen.runtime.analysis.configuration import Modes
from tensegrity_codegen.runtime.analysis.prestress import Prestress, PrestressStability
from tensegrity_codegen.runtime.analysis.rank import Rank
from tensegrity_codegen.runtime.statics.newton import Stability
from tensegrity_codegen.structure.member_limits import MemberChecks
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.summaries import Summarised


@dataclass(frozen=True, repr=False)
class Analysis(Summarised):
    """What tensions a structure can have in a configuration, and how it moves there.

    Attributes
    ----------
    status : str
        ``"stable"``: tensions with every cable in tension exist, and they stiffen all mechanisms.
        ``"infeasible"``: there are no such tensions, see `certificate`. ``"undecided"``: there are none
        within rounding, and no proof either. ``"unstable"``: such tensions exist, but a motion is not stiff.
    message : str
        A sentence.
    node_position : ndarray, shape (n_nodes, 3) [m]
        The configuration.
    member_length, member_tension : ndarray, shape (n_members,) [m, N]
        Lengths, and the present tensions.
    residual, largest_force : float
        Largest residual of a node and largest member force at present [N].
    is_balanced : bool
        Whether the present forces are in balance: the residual is at most 1e-6 of the largest member force.
    rank : Rank
        Rank of the equilibrium matrix, its gap, self-stresses.
    parts : tuple of tuple of str
        Names of the nodes of each part that no members join to the others.
    rigid_motion, mechanism : ndarray, shape (n_nodes, 3, k)
        Motions of the nodes, orthonormal in the coordinates: rigid ones, and those that change the shape.
    prestress : Prestress
        Tensions without loads.
    load_prestress : Prestress or None
        Tensions [N] that balance the loads; None without loads, or where none balance them here.
    load : ndarray, shape (n_directions,) [N]
        Weight and loads.
    load_note : str
        Why the loads were left out, or an empty text.
    certificate, load_certificate : Certificate or None
        Displacements which prove that there are no tensions without, and with loads.
    certificate_displacement, load_certificate_displacement : ndarray, shape (n_nodes, 3), or None
        Displacements of the nodes in them.
    stability : PrestressStability
        Stiffness that the tensions found give to the mechanisms.
    smallest_eigenvalue : float
        Smallest eigenvalue of the present tangent stiffness without neutral rigid motions [N/m].
    stiffness : Stability
        The same with its vector and rounding.
    modes : Modes or None
        Natural frequencies; None where the model has no masses.
    members : MemberChecks
        Members at the present tensions against the limits of the scene.
    bar_distance : ndarray, shape (n_bar_pairs,) [m], or None
        Distances between bars, where the scene has a limit of them.
    warnings : tuple of str
        Sentences.
    """

    status: str
    message: str
    node_position: FloatArray
    member_length: FloatArray
    member_tension: FloatArray
    residual: float
    largest_force: float
    is_balanced: bool
    rank: Rank
    parts: tuple[tuple[str, ...], ...]
    rigid_motion: FloatArray
    mechanism: FloatArray
    prestress: Prestress
    load_prestress: Prestress | None
    load: FloatArray
    load_note: str
    certificate: Certificate | None
    load_certificate: Certificate | None
    certificate_displacement: FloatArray | None
    load_certificate_displacement: FloatArray | None
    stability: PrestressStability
    smallest_eigenvalue: float
    stiffness: Stability
    modes: Modes | None
    members: MemberChecks
    bar_distance: FloatArray | None
    warnings: tuple[str, ...]

    @property
    def n_selfstress(self) -> int:
        """Number of independent self-stresses."""
        return len(self.rank.selfstress)

    @property
    def n_rigid_motions(self) -> int:
        """Number of independent rigid motions."""
        return int(self.rigid_motion.shape[2])

    @property
    def n_mechanisms(self) -> int:
        """Number of independent mechanisms: motions that change the shape and, to first order, no length."""
        return int(self.mechanism.shape[2])

    @property
    def is_good(self) -> bool:
        """Whether tensions exist with every cable in tension, and the structure is stable with them."""
        return self.status == "stable"

    @property
    def is_loaded(self) -> bool:
        """Whether loads act."""
        return bool(self.load.any())
