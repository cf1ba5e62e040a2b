"""Analysis of a configuration: rank, self-stress, mechanisms, prestress, stability, modes."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.analysis.certificate import Certificate, check_balanced, find_certificate
from tensegrity_codegen.runtime.analysis.configuration import (
    Configuration,
    Modes,
    find_modes,
    read_configuration,
)
from tensegrity_codegen.runtime.analysis.prestress import (
    MIN_STIFFNESS_RATIO,
    Prestress,
    PrestressStability,
    find_prestress,
    find_prestress_stability,
    find_stabilising_prestress,
    name_moving,
)
from tensegrity_codegen.runtime.analysis.rank import (
    RANK_TOLERANCE,
    FreeMotions,
    Rank,
    find_free_motions,
    find_rank,
)
from tensegrity_codegen.runtime.model.arrays import check_tolerance
from tensegrity_codegen.runtime.model.interface import Model, require_model
from tensegrity_codegen.runtime.statics.newton import Stability, find_stability
from tensegrity_codegen.scene.names import describe_pieces
from tensegrity_codegen.structure.member_limits import MemberChecks, check_members
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_whole
from tensegrity_codegen.system.errors import name_list
from tensegrity_codegen.system.summaries import Summarised
from tensegrity_codegen.tables.body_places import label_nodes

UNDECIDED = (
    "no tensions with every cable in tension exist beyond rounding, but the proof fails by rounding too: the "
    "configuration is next to one where they exist"
)
UNJUDGED = "the present forces are not in balance, so that stability is not judged here: settle it first"
MODES = 10
# Residual, over the largest member force, up to which the present forces are in balance.
BALANCE_TOLERANCE = 1e-6
UNHELD_LOAD_TOLERANCE = 1e-9  # part of the loads on rigid motions that nothing holds


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
        Natural frequencies; None if the model has no masses.
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
    def loose_mechanisms(self) -> str:
        """Which mechanisms the tensions found do not stiffen: "2 of 3 mechanisms"."""
        total, value = self.n_mechanisms, self.stability.eigenvalue
        if total == 1:
            return "the only mechanism"
        count = int((np.abs(value) < MIN_STIFFNESS_RATIO).sum())
        if self.stability.smallest_eigenvalue <= -MIN_STIFFNESS_RATIO or count < 2:
            return f"one of {total:,} mechanisms"
        return f"all {total:,} mechanisms" if count == total else f"{count:,} of {total:,} mechanisms"

    @property
    def least_stiffness(self) -> str:
        """Least stiffness that the tensions give to a mechanism: "0.12 of the largest force density"."""
        return f"{self.stability.smallest_eigenvalue:.3g} of the largest force density"

    def describe_loose(self) -> str:
        """Return which mechanisms the tensions found do not stiffen, and the stiffness that they give."""
        is_zero = abs(self.stability.smallest_eigenvalue) < MIN_STIFFNESS_RATIO
        kind = "no stiffness" if is_zero else f"a stiffness of {self.least_stiffness}"
        return f"the tensions found give {self.loose_mechanisms} {kind}"

    @property
    def is_good(self) -> bool:
        """Whether tensions exist with every cable in tension, and the structure is stable with them."""
        return self.status == "stable"

    @property
    def is_loaded(self) -> bool:
        """Whether loads act."""
        return bool(self.load.any())


def judge(analysis: Analysis, at: Configuration) -> Analysis:
    """Return the analysis with its status, message and warnings."""
    loaded = analysis.load_prestress
    exists = analysis.prestress.is_found or (loaded is not None and loaded.is_found)
    if not exists:
        proof = analysis.certificate
        status = "infeasible" if proof is not None and proof.is_verified else "undecided"
        message = _describe_proof(analysis, at) if status == "infeasible" else UNDECIDED
    elif not analysis.stability.is_stable:
        value = analysis.stability.smallest_eigenvalue
        loose = analysis.stability.eigenvalue <= (
            value if value < -MIN_STIFFNESS_RATIO else MIN_STIFFNESS_RATIO
        )
        names = label_nodes(at.manifest.node_name, at.manifest.body_places)
        moved = at.node_velocities(analysis.stability.direction[:, loose])
        status = "unstable"
        message = (
            f"{analysis.describe_loose()}: they do not hold the shape; "
            f"what moves most: {name_moving(names, moved)}"
        )
    elif analysis.is_balanced and analysis.stiffness.is_unstable:
        status = "unstable"
        message = (
            "at the present tensions the structure is in an unstable equilibrium: the smallest eigenvalue of "
            f"its stiffness is {analysis.smallest_eigenvalue:.6g}"
        )
    else:
        status = "stable"
        message = "; but ".join([_describe_tensions(analysis, at), *_find_flaws(analysis, at)])
    return replace(analysis, status=status, message=message, warnings=_find_warnings(analysis, at))


def _describe_proof(analysis: Analysis, at: Configuration) -> str:
    """Return which cables can only be slack."""
    assert analysis.certificate is not None
    names = [at.manifest.member_name[e] for e in analysis.certificate.shortening]
    shown = name_list(names, 6)
    return (
        f"no self-stress has every cable in tension: without loads {shown} can only be slack, since a motion "
        f"shortens {'them' if len(names) > 1 else 'it'}, lengthens no cable and keeps the length of every bar"
    )


def _describe_tensions(analysis: Analysis, at: Configuration) -> str:
    """Return the tensions that hold the structure."""
    mechanisms = analysis.n_mechanisms
    held = (
        f"; they stiffen {f'all {mechanisms} mechanisms' if mechanisms > 1 else 'the only mechanism'}"
        if mechanisms
        else "; there is no mechanism"
    )
    if not at.tension_only.any():
        return f"no member needs to be in tension{held.replace('they stiffen', 'self-stresses stiffen')}"
    if not analysis.prestress.is_found:
        return f"the loads keep every cable in tension{held}"
    return f"self-stresses exist with every cable in tension{held}"


def _find_flaws(analysis: Analysis, at: Configuration) -> list[str]:
    """Return the flaws of the present tensions of a structure that some prestress holds."""
    flaws = analysis.members.describe()
    if not analysis.is_balanced:
        return [*flaws, UNJUDGED]
    if analysis.stiffness.is_neutral or analysis.stiffness.is_unstable:
        modes = analysis.modes
        loose = 0 if modes is None else int((modes.frequency == 0.0).sum())
        motions = (
            "a motion has" if modes is None or not loose else f"{loose} of {len(modes.frequency)} modes have"
        )
        none = ", which are zero" if analysis.largest_force <= at.force_floor else ""
        flaws.append(f"{motions} no stiffness at the present tensions{none}")
    return flaws


def _find_warnings(analysis: Analysis, at: Configuration) -> tuple[str, ...]:
    """Return sentences about all that needs a second look."""
    sentences = [analysis.rank.warning] if analysis.rank.warning else []
    contacts = at.problem.contacts
    if contacts is not None and (slips := contacts.bristles(at.position)[1]).any():
        feet = ", ".join(
            name for name, slip in zip(contacts.structure.contact_name, slips, strict=True) if slip
        )
        sentences.append(
            f"the feet {feet} are at the limit of friction, which holds them only across their slip"
        )
    if (absent := at.is_absent & ~at.is_edge).any():
        names = name_list(at.manifest.member_name[e] for e in absent.nonzero()[0])
        sentences.append(f"slack, without length and left out of all tensions: {names}")
    if len(analysis.parts) > 1:
        sentences.append(describe_pieces([piece[0] for piece in analysis.parts]))
    if analysis.load_note:
        sentences.append(f"{analysis.load_note}; the prestress is that without loads")
    sentences += [*analysis.members.describe(), *_describe_limits(analysis, at)]
    if not analysis.is_balanced:
        sentences.append(
            f"the present forces are not in balance: the largest residual is {analysis.residual:.3g} N, the "
            f"largest member force {analysis.largest_force:.3g} N"
        )
    return tuple(sentences)


def _describe_limits(analysis: Analysis, at: Configuration) -> Iterator[str]:
    """Clearance between bars, and the least stiffness."""
    limits, distance = at.structure.limits, analysis.bar_distance
    if distance is not None and distance.min(initial=math.inf) < limits.clearance:
        pair = int(distance.argmin())
        bar_1, bar_2 = at.manifest.bar_pair[pair]
        yield (
            f"the bars {bar_1} and {bar_2} are {distance[pair]:.6g} m apart, allowed is at least "
            f"{limits.clearance:.6g} m"
        )
    if analysis.smallest_eigenvalue < limits.least_stiffness:
        yield (
            f"the smallest eigenvalue of the stiffness is {analysis.smallest_eigenvalue:.6g} N/m, allowed is "
            f"at least {limits.least_stiffness:.6g} N/m"
        )


def analyse(
    model: Model,
    *,
    coordinate: ArrayLike | None = None,
    arguments: Mapping[str, Any] | None = None,
    rank_tolerance: float = RANK_TOLERANCE,
    n_modes: int = MODES,
) -> Analysis:
    """Analyse which tensions a structure can have in a configuration, and how it moves there.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"analyse"``, see compile_scene.
    coordinate : array_like, shape (n_coordinates,), optional
        The configuration [m]; by default that of the scene.
    arguments : mapping, optional
        Inputs and parameters by name, where they differ from the scene; of feet on the ground also
        ``internal``, shape (n_internal,) [m], by default zero.
    rank_tolerance : float
        Singular values of the equilibrium matrix up to this part of the largest one count as zero.
    n_modes : int
        Number of natural frequencies and modes.

    Returns
    -------
    Analysis
        Rank, self-stresses, mechanisms, prestress or a proof that there is none, stability, modes.

    Raises
    ------
    InvalidValueError, NonFiniteError
        A wrong argument, or a member without length.
    FormulationError
        The model lacks a quantity, or the structure has more than 3,000 coordinates or members.
    ConvergenceError
        A linear program was not solved.

    Notes
    -----
    Equations and signs are in docs/analyse.md.

    Examples
    --------
    >>> from tensegrity_codegen import analyse, compile_scene
    >>> found = analyse(compile_scene("prism.toml", for_="analyse"))
    >>> found.status, found.rank.rank, found.n_selfstress, found.n_mechanisms
    ('stable', 11, 1, 1)
    """
    require_model(model)
    check_tolerance(rank_tolerance, "rank_tolerance", f"{RANK_TOLERANCE:g} is the default")
    check_whole(n_modes, "n_modes", 0, problem="not a number of modes", hint=f"{MODES} is the default")
    # The equilibrium matrix A: its rank, self-stresses A t = 0 and free motions A^T d = 0.
    at = read_configuration(model, coordinate, arguments)
    rank = find_rank(
        at.equilibrium_matrix, tolerance=rank_tolerance, rounding=at.rounding, absent=at.is_absent
    )
    motions = find_free_motions(rank, at.rigid_motions)
    tensions = _find_tensions(at, rank, motions)
    # The present state: stiffness, modes and distances of bars.
    stiffness = find_stability(at.problem, at.point)
    modes = find_modes(at, stiffness.neutral, n_modes) if model.has("mass_matrix") else None
    bar_distance = None
    if math.isfinite(at.structure.limits.clearance) and model.has("bar_distance"):
        bar_distance = np.asarray(at.problem.compute("bar_distance", at.coordinate), dtype=float)
    names = at.manifest.node_name
    analysis = Analysis(
        status="",
        message="",
        node_position=at.position,
        member_length=at.length,
        member_tension=at.tension,
        residual=at.point.node_force,
        largest_force=float(np.abs(at.tension[~at.is_edge]).max(initial=0.0)),
        is_balanced=at.point.is_balanced(BALANCE_TOLERANCE, at.force_floor),
        rank=rank,
        parts=tuple(tuple(names[node] for node in piece) for piece in at.separate_parts),
        rigid_motion=at.node_velocities(motions.rigid),
        mechanism=at.node_velocities(motions.mechanism),
        prestress=tensions.prestress,
        load_prestress=tensions.load_prestress,
        load=at.load,
        load_note=tensions.load_note,
        certificate=tensions.certificate,
        load_certificate=tensions.load_certificate,
        certificate_displacement=_move_nodes(at, tensions.certificate),
        load_certificate_displacement=_move_nodes(at, tensions.load_certificate),
        stability=tensions.stability,
        smallest_eigenvalue=stiffness.model_eigenvalue,
        stiffness=stiffness,
        modes=modes,
        members=check_members(at.structure, at.tension, at.length),
        bar_distance=bar_distance,
        warnings=(),
    )
    return judge(analysis, at)


@dataclass(frozen=True)
class _Tensions:
    prestress: Prestress
    load_prestress: Prestress | None
    load_note: str
    certificate: Certificate | None
    load_certificate: Certificate | None
    stability: PrestressStability


def _find_tensions(at: Configuration, rank: Rank, motions: FreeMotions) -> _Tensions:
    """Return tensions without and with loads, or proofs that there are none, and their stability."""
    only, matrix = at.tension_only, at.equilibrium_matrix
    prestress = find_prestress(rank.selfstress, only)
    certificate = None if prestress.is_found else find_certificate(matrix, only, rank=rank)
    note, loaded, load_certificate = _describe_load(at, rank, motions), None, None
    if at.load.any() and not note:
        loaded = find_prestress(rank.selfstress, only, load_tension=rank.find_tension(at.load)[0])
        if not loaded.is_found:
            load_certificate = find_certificate(matrix, only, load=at.load, rank=rank)
    best = _find_stability(at, motions, prestress, loaded)
    if prestress.is_found and not best.is_stable and len(rank.selfstress):
        better = find_stabilising_prestress(at, motions, rank.selfstress, prestress)
        if better is not None:
            smallest = float(better[only].min(initial=np.inf))
            prestress = Prestress(True, better, smallest, float(np.abs(better).max()))
            best = _find_stability(at, motions, prestress, loaded)
    return _Tensions(prestress, loaded, note, certificate, load_certificate, best)


def _find_stability(
    at: Configuration, motions: FreeMotions, prestress: Prestress, loaded: Prestress | None
) -> PrestressStability:
    """Return the stability of the self-stress; loads decide on rigid motions that it does not hold."""
    none = np.zeros((len(at.load), 0))
    if loaded is not None and not (prestress.is_found and prestress.tension.any()):
        return find_prestress_stability(at, motions, loaded.tension, loaded=True)
    mechanisms = FreeMotions(none, motions.mechanism)
    stability = find_prestress_stability(at, mechanisms, prestress.tension, loaded=False)
    if loaded is None or not stability.is_stable:
        return stability
    rigid = find_prestress_stability(at, FreeMotions(motions.rigid, none), loaded.tension, loaded=True)
    return stability if rigid.is_stable else rigid


def _describe_load(at: Configuration, rank: Rank, motions: FreeMotions) -> str:
    """Return why no tensions balance the loads in this configuration, an empty text if some may do."""
    if check_balanced(rank, at.load):
        return ""
    size = float(np.linalg.norm(at.load))
    if np.linalg.norm(motions.rigid.T @ at.load) > UNHELD_LOAD_TOLERANCE * size:
        return "nothing holds the structure against its loads, which would move it as a whole"
    return "the loads push a mechanism, so that no tensions balance them in exactly this configuration"


def _move_nodes(at: Configuration, proof: Certificate | None) -> FloatArray | None:
    """Return the displacements of the nodes in a certificate, (n_nodes, 3)."""
    return None if proof is None else at.node_velocities(proof.displacement[:, None])[:, :, 0]
