"""Monitored functions of load paths: slack, switches, yield, contact, and limits of members."""

from collections.abc import Sequence

import numpy as np

from tensegrity_codegen.runtime.model.interface import require_quantities
from tensegrity_codegen.runtime.paths.load_path import Watch
from tensegrity_codegen.runtime.paths.model_path import PURPOSE, ModelPath
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance, check_switch
from tensegrity_codegen.system.errors import check_choice

MEMBER_WATCH_QUANTITIES = ("member_tension", "member_length")


def watch_slack(path: ModelPath, members: Sequence[str]) -> Watch:
    """Return the monitored function l - rho - q of cables; at zero a cable goes slack or taut."""
    check_instance(path, ModelPath, "path", "what build_path(...) returns")
    rows = _find_rows(members, path.model.manifest.member_name, "members")
    require_quantities(path.model, ("member_extension",), PURPOSE)

    def extension(coordinate: FloatArray, load_factor: float) -> FloatArray:
        extensions = np.asarray(path.compute("member_extension", coordinate, load_factor))
        if path.model.has("plastic_elongation"):  # rest lengths that have grown
            extensions = extensions - path.compute("plastic_elongation", coordinate, load_factor)
        return extensions[rows]

    return Watch("slack", tuple(members), extension, rising="taut", is_kink=True)


def watch_switch(path: ModelPath, members: Sequence[str] = ()) -> list[Watch]:
    """Return the monitored switches of member laws, none without any; events where members are named."""
    check_instance(path, ModelPath, "path", "what build_path(...) returns")
    if not path.model.has("switch_margin"):
        return []
    count = len(np.asarray(path.model.compute("switch_margin")))
    names, kind = (tuple(members), "switch") if members else (("",) * count, "")

    def margin(coordinate: FloatArray, load_factor: float) -> FloatArray:
        return np.asarray(path.compute("switch_margin", coordinate, load_factor))

    return [Watch(kind, names, margin, rising=kind, is_kink=True)]


def watch_yield(path: ModelPath) -> list[Watch]:
    """Return the monitored margins of plastic members, where flow begins; none without plastic members."""
    check_instance(path, ModelPath, "path", "what build_path(...) returns")
    if not path.model.manifest.subjects_of("yield"):
        return []
    names = tuple(name.rsplit("_", 1)[0] for name in path.model.manifest.subjects_of("yield"))

    def margin(coordinate: FloatArray, load_factor: float) -> FloatArray:
        return np.asarray(path.compute("yield_margin", coordinate, load_factor))

    return [Watch("yield", names, margin, is_kink=True)]


def watch_contact(path: ModelPath, pairs: Sequence[str] | None = None, *, stops: bool = True) -> Watch:
    """Return the monitored distances between bars, by default all; `stops`: contact ends the path."""
    check_instance(path, ModelPath, "path", "what build_path(...) returns")
    require_quantities(path.model, ("bar_distance",), PURPOSE)
    valid_names = path.model.manifest.bar_pair_name
    rows = _find_rows(valid_names if pairs is None else pairs, valid_names, "pairs of bars")
    names = tuple(valid_names[row] for row in rows)
    check_switch(stops, "stops")

    def distance(coordinate: FloatArray, load_factor: float) -> FloatArray:
        return np.asarray(path.compute("bar_distance", coordinate, load_factor))[rows]

    return Watch("contact", names, distance, rising="separation", stops=stops)


def _find_rows(names: Sequence[str], valid_names: Sequence[str], noun: str) -> list[int]:
    check_instance(names, (tuple, list), "watch", f"a list of names of {noun}")
    for name in names:
        check_choice(name, valid_names, f"name among {noun}", "watch")
    return [valid_names.index(name) for name in names]


def watch_members(path: ModelPath, structure: Structure | BodySystem) -> list[Watch]:
    """Return the monitored limits of members, at zero exceeded or met; without [buckling], Euler's load."""
    check_instance(path, ModelPath, "path", "what build_path(...) returns")
    check_instance(structure, (Structure, BodySystem), "structure", "a Structure or BodySystem")
    # Limits that each member has.
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
            margin = {
                "buckling": 1 + factor * tension * length**2 / euler,
                "yield_stress": 1 - np.abs(tension) / (area * limits.yield_stress),
                "least_tension": tension - limits.least_tension,
                "most_tension": limits.most_tension - tension,
            }
        return np.concatenate([margin[limit][rows] for limit, rows in masks.items()])

    return [Watch("exceeded", tuple(names), margins, rising="met")]
