"""Analysis of a configuration: rank, self-stress, mechanisms, prestress, stability, modes."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.analysis.analysis import Analysis
from tensegrity_codegen.runtime.analysis.certificate import Certificate, check_balanced, find_certificate
from tensegrity_codegen.runtime.analysis.configuration import Configuration, read_configuration
from tensegrity_codegen.runtime.analysis.judge import judge
from tensegrity_codegen.runtime.analysis.mechanisms import FreeMotions, find_free_motions
from tensegrity_codegen.runtime.analysis.modes import find_modes
from tensegrity_codegen.runtime.analysis.prestress import Prestress, find_prestress
from tensegrity_codegen.runtime.analysis.prestress_stability import (
    PrestressStability,
    find_prestress_stability,
    find_stabilising_prestress,
)
from tensegrity_codegen.runtime.analysis.rank import RANK_TOLERANCE, Rank, find_rank
from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.runtime.model.require import require_model
from tensegrity_codegen.runtime.statics.newton import find_stability
from tensegrity_codegen.structure.member_limits import check_members
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_whole, is_number
from tensegrity_codegen.system.errors import InvalidValueError

MODES = 10
# Residual, over the largest member force, up to which the present forces are in balance.
BALANCE_TOLERANCE = 1e-6
UNHELD_LOAD_TOLERANCE = 1e-9  # part of the loads on rigid motions that nothing holds


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
        Singular values of the equilibrium matrix above this part of the largest one never count as zero.
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
    _check_options(rank_tolerance, n_modes)
    at = read_configuration(model, coordinate, arguments)
    rank = find_rank(
        at.equilibrium_matrix, tolerance=rank_tolerance, rounding=at.rounding, absent=at.is_absent
    )
    motions = find_free_motions(rank, at.rigid_motions)
    tensions = _find_tensions(at, rank, motions)
    stiffness = find_stability(at.problem, at.point)
    modes = find_modes(at, stiffness.neutral, n_modes) if model.has("mass_matrix") else None
    names = at.manifest.node_name
    found = Analysis(
        status="",
        message="",
        node_position=at.position,
        member_length=at.length,
        member_tension=at.tension,
        residual=at.point.node_force,
        largest_force=at.point.largest_force,
        is_balanced=_check_forces(at),
        rank=rank,
        parts=tuple(tuple(names[node] for node in part) for part in at.separate_parts),
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
        bar_distance=_find_bar_distance(at),
        warnings=(),
    )
    return judge(found, at)


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
            least = float(better[only].min(initial=np.inf))
            prestress = Prestress(True, better, least, float(np.abs(better).max()))
            best = _find_stability(at, motions, prestress, loaded)
    return _Tensions(prestress, loaded, note, certificate, load_certificate, best)


def _find_stability(
    at: Configuration, motions: FreeMotions, prestress: Prestress, loaded: Prestress | None
) -> PrestressStability:
    """Return the stability of the self-stress, which may be as large as wanted, else of the loaded state.

    Self-stress does not hold rigid motions that the supports allow; there the loads decide.
    """
    none = np.zeros((len(at.load), 0))
    if loaded is not None and not (prestress.is_found and prestress.tension.any()):
        return find_prestress_stability(at, motions, loaded.tension, loaded=True)
    own = FreeMotions(none, motions.mechanism)
    stability = find_prestress_stability(at, own, prestress.tension, loaded=False)
    if loaded is None or not stability.is_stable:
        return stability
    whole = find_prestress_stability(at, FreeMotions(motions.rigid, none), loaded.tension, loaded=True)
    return stability if whole.is_stable else whole


def _describe_load(at: Configuration, rank: Rank, motions: FreeMotions) -> str:
    """Return why no tensions balance the loads in this configuration, an empty text where some may do."""
    if check_balanced(rank, at.load):
        return ""
    size = float(np.linalg.norm(at.load))
    if np.linalg.norm(motions.rigid.T @ at.load) > UNHELD_LOAD_TOLERANCE * size:
        return "nothing holds the structure against its loads, which would move it as a whole"
    return "the loads push a mechanism, so that no tensions balance them in exactly this configuration"


def _move_nodes(at: Configuration, proof: Certificate | None) -> FloatArray | None:
    """Return the displacements of the nodes in a certificate, (n_nodes, 3)."""
    return None if proof is None else at.node_velocities(proof.displacement[:, None])[:, :, 0]


def _find_bar_distance(at: Configuration) -> FloatArray | None:
    """Return the distances between bars, None where no limit asks for them."""
    if not math.isfinite(at.structure.limits.clearance) or not at.problem.model.has("bar_distance"):
        return None
    return np.asarray(at.problem.compute("bar_distance", at.coordinate), dtype=float)


def _check_forces(at: Configuration) -> bool:
    """Return whether the present forces are in balance."""
    return at.point.is_balanced(BALANCE_TOLERANCE, at.force_floor)


def _check_options(rank_tolerance: float, n_modes: int) -> None:
    if not (is_number(rank_tolerance) and 0 < rank_tolerance < 1):
        raise InvalidValueError(
            "the tolerance is out of range",
            where="rank_tolerance",
            given=rank_tolerance,
            allowed="above 0, below 1",
            hint=f"{RANK_TOLERANCE:g} is the default",
        )
    check_whole(n_modes, "n_modes", 0, problem="not a number of modes", hint=f"{MODES} is the default")
