"""Radau IIA with the tensions of stiff members as unknowns; with contacts by the Jacobian of the state."""

from tensegrity_codegen.tables.integrators.integrator import Integrator

WITH_CONTACTS = Integrator(
    name="radau",
    kind="adaptive",
    title="Radau IIA with three stages and the Jacobian",
    order=5,
    quantities=("state_jacobian",),
    rates=4,
    noise_share=1.0,
    vibration_loss=(1.4e-4, 6),
    look=(1, "line", "^"),
    in_single=False,
    files=("radau_constants", "collocation"),
    iterates=True,
)
INTEGRATOR = Integrator(
    name="radau",
    kind="implicit",
    title="Radau IIA with three stages; tensions of bars are unknowns, so that steps do not depend on how "
    "stiff bars are",
    order=5,
    quantities=("cable_force", "member_law", "mass_matrix"),
    look=(1, "line", "^"),
    with_contacts=WITH_CONTACTS,
    counts=("accepted", "rejected", "newton_failures", "factorisations", "iterations", "evaluations"),
    in_single=False,
)
