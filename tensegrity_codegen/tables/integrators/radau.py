"""Radau IIA with the tensions of stiff members as unknowns."""

from tensegrity_codegen.tables.integrators.integrator import Integrator

INTEGRATOR = Integrator(
    name="radau",
    kind="implicit",
    title="Radau IIA with three stages; tensions of bars are unknowns, so that steps do not depend on how "
    "stiff bars are",
    order=5,
    quantities=("cable_force", "member_law", "mass_matrix"),
    look=(1, "line", "^"),
    counts=("accepted", "rejected", "newton_failures", "factorisations", "iterations", "evaluations"),
    in_single=False,
)
