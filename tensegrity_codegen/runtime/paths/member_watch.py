"""Limits of members as monitored functions of a load path: buckling, yield, least and largest tension."""

import numpy as np

from tensegrity_codegen.runtime.paths.model_path import ModelPath
from tensegrity_codegen.runtime.paths.path_problem import Watch
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance

MEMBER_WATCH_QUANTITIES = ("member_tension", "member_length")


def watch_members(path: ModelPath, structure: Structure | BodySystem) -> list[Watch]:
    """Return the monitored limits of members; at zero one is exceeded, or no longer.

    path: the load path; its model needs ``MEMBER_WATCH_QUANTITIES``; structure: with the limits. Members with
    no statement of buckling are watched for Euler's load.
    Raises FormulationError: the model lacks a quantity.
    """
    check_instance(path, ModelPath, "path", "what build_path(...) returns")
    check_instance(structure, (Structure, BodySystem), "structure", "a Structure or BodySystem")
    limits = structure.limits.for_members(structure.n_members)
    euler, area = np.pi**2 * structure.flexural_rigidity, structure.section_area
    factor = np.where(limits.buckling > 0, limits.buckling, 1.0)
    masks = {
        "buckling": ~structure.tension_only & (euler > 0) & (limits.buckling >= 0),
        "yield_stress": np.isfinite(limits.yield_stress) & (area > 0),
        "least_tension": np.isfinite(limits.least_tension),
        "most_tension": np.isfinite(limits.most_tension),
    }
    names = [
        f"{structure.member_name[e]} ({limit})" for limit, rows in masks.items() for e in np.flatnonzero(rows)
    ]
    if not names:
        return []

    def margins(coordinate: FloatArray, load_factor: float) -> FloatArray:
        tension, length = (
            np.asarray(path.compute(name, coordinate, load_factor)) for name in MEMBER_WATCH_QUANTITIES
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            left = {
                "buckling": 1 + factor * tension * length**2 / euler,
                "yield_stress": 1 - np.abs(tension) / (area * limits.yield_stress),
                "least_tension": tension - limits.least_tension,
                "most_tension": limits.most_tension - tension,
            }
        return np.concatenate([left[limit][rows] for limit, rows in masks.items()])

    return [Watch("exceeded", tuple(names), margins, rising="met")]
