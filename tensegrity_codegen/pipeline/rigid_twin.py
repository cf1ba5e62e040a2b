"""The second model of a structure with stiff bars: rigid ones, whose lengths follow their tensions.

It has the coordinates, run-time arguments and events of the elastic model, which moves alike, but vibrates.
"""

from dataclasses import replace

import numpy as np

from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.formulations import choose_formulation
from tensegrity_codegen.tables.integrators import STIFF_INTEGRATOR
from tensegrity_codegen.tables.request import ModelRequest

CORRECTED = {"bars": "all", "correction": "first_order"}
# What motions by it need; tensions and energies are those of the elastic model at its states.
INTEGRATORS = ("rk853",)
QUANTITIES = ("acceleration", "rigidity_error", "consistent_coordinate", "consistent_velocity")
FIXED = ("spring_constant", "axial_stiffness", "damping", "rest_length")  # of rigid bars
MOVING = ("rest_length", "temperature")  # inputs that change rest lengths
# Up to which its code, in straight lines, is fast and compiles within seconds.
MOST_MEMBERS, MOST_BARS = 100, 24
DEPENDENT = 1e-8  # part of a bar's direction that others leave free


def request_rigid_twin(structure: Subject, request: ModelRequest) -> ModelRequest | None:
    """Return the request of the model with corrected rigid bars, None where it cannot be chosen.

    Parameters
    ----------
    structure : Structure or BodySystem
        The structure.
    request : ModelRequest
        Of the model with elastic bars: for motions by `auto`.

    Returns
    -------
    ModelRequest or None
        The same arguments and events, with what motions need of quantities, and one integrator.
    """
    if not isinstance(structure, Structure) or not _serves_motions(request):
        return None
    if not _has_stiff_bars_alone(structure) or not _keeps_bars(structure, request):
        return None
    if not _is_independent(structure):
        return None
    return replace(
        request,
        formulation=choose_formulation(rigid_bars=True).name,
        options=CORRECTED,
        emitter="unrolled",
        quantities=QUANTITIES,
        integrators=INTEGRATORS,
        solvers=(),
        interfaces=(),
    )


def _serves_motions(request: ModelRequest) -> bool:
    """Return whether the library is of motions in node positions of which nothing else is asked."""
    is_elastic = request.formulation == choose_formulation(rigid_bars=False).name
    is_plain = not (request.keep or request.driven or request.differentiates_motions)
    asked = set(request.integrators)
    is_chosen = {*INTEGRATORS, STIFF_INTEGRATOR} <= asked
    return is_elastic and is_plain and is_chosen and request.precision == "double"


def _has_stiff_bars_alone(structure: Structure) -> bool:
    """Return whether `auto` counts the bars as stiff, every one, and nothing remembers or touches."""
    from tensegrity_codegen.runtime.accuracy.choice import MIN_STIFF_RATIO, integrators_for

    bars, mu = structure.is_bar, structure.mu
    if structure.n_members > MOST_MEMBERS or bars.sum() > MOST_BARS or structure.ring_nodes:
        return False
    if STIFF_INTEGRATOR not in integrators_for("auto", structure):
        return False
    stiff = structure.is_mixed & (mu >= MIN_STIFF_RATIO * mu[~bars].max(initial=0.0))
    return bool(stiff[bars].all() and bars.any())


def _keeps_bars(structure: Structure, request: ModelRequest) -> bool:
    """Return whether no parameter and no input changes the stiffness or the rest length of a bar."""
    changed = [row for name in FIXED for row in request.parameters.get(name, ())]
    changed += [row for source in structure.inputs if source.kind in MOVING for row in source.targets]
    return not structure.is_bar[changed].any()


def _is_independent(structure: Structure) -> bool:
    """Return whether no bar follows from others and the anchors, found without SciPy's factorisations."""
    i, j = structure.connectivity[structure.is_bar].T
    vector = structure.node_position[i] - structure.node_position[j]
    direction = vector / np.linalg.norm(vector, axis=1)[:, None]
    rows = np.zeros((len(i), structure.n_nodes, 3))
    rows[np.arange(len(i)), i], rows[np.arange(len(i)), j] = direction, -direction
    place = structure.coordinate_node_axis
    free = rows[:, place[:, 0], place[:, 1]]
    return len(i) <= len(place) and bool(np.linalg.svd(free, compute_uv=False).min() > DEPENDENT)
