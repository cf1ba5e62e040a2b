"""Pairs of bars that a scene watches for contact."""

from collections.abc import Collection, Mapping

from tensegrity_codegen.scene.names import check_known, key_path
from tensegrity_codegen.scene.schema.part_schema import Interference
from tensegrity_codegen.structure.collision import EXPONENTS, Collision
from tensegrity_codegen.structure.contact_estimates import find_dissipation
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError


def find_bar_pairs(
    wanted: Interference,
    bars: Mapping[str, int],
    radius: Mapping[str, float],
    joints: Mapping[str, Collection[int]],
    where: str,
) -> tuple[tuple[int, int], ...] | None:
    """Return the chosen pairs as indices of bars, None for all of them.

    bars: index of every bar by name; radius: of every bar [m]; joints: the nodes that each bar ends at.
    Raises UnknownNameError, DuplicateNameError (a pair twice), or InvalidValueError for a bar without radius,
    with itself, or with one that it shares a node with.
    """
    if wanted.pairs == "all":
        return None
    found: dict[frozenset[int], tuple[int, int]] = {}
    for number, names in enumerate(wanted.pairs):
        place = key_path(where, "interference", "pairs", number)
        for name in names:
            _check_bar(name, bars, radius, place)
        first, second = names
        if set(joints[first]) & set(joints[second]):
            problem = "these bars share a node, so that they always touch"
            allowed, hint = "two bars that share no node", "take the pair out of the list"
            raise InvalidValueError(problem, where=place, given=list(names), allowed=allowed, hint=hint)
        pair = bars[first], bars[second]
        if frozenset(pair) in found:
            raise DuplicateNameError(
                "the pair of bars is listed twice", where=place, given=list(names), allowed="each pair once"
            )
        found[frozenset(pair)] = pair
    return tuple(found.values())


def build_collision(stated: Interference, where: str) -> Collision | None:
    """Return the force between bars that touch, None where the scene states no stiffness.

    Raises InvalidValueError for damping that is given twice, an unknown exponent, and keys without stiffness.
    """
    impact = stated.restitution
    given = {key: getattr(stated, key) for key in ("restitution", "dissipation")}
    idle = [key for key, value in given.items() if value is not None]
    rules = (
        (stated.exponent in EXPONENTS, "not an exponent of the contact force", "exponent", "1 or 1.5"),
        (
            len(idle) < 2,
            "the damping of impacts is given twice",
            "dissipation",
            "one of restitution and dissipation",
        ),
        (
            stated.stiffness is not None or not (idle or stated.exponent != 1.0),
            "bars without a stiffness have no force that this could change",
            idle[0] if idle else "exponent",
            "with stiffness [N/m]",
        ),
    )
    for is_met, problem, key, allowed in rules:
        if not is_met:
            value = getattr(stated, key)
            shown = value.model_dump() if key == "restitution" else value
            raise InvalidValueError(
                problem, where=key_path(where, "interference", key), given=shown, allowed=allowed
            )
    if stated.stiffness is None:
        return None
    dissipation = find_dissipation(impact.value, impact.speed) if impact else stated.dissipation or 0.0
    return Collision(stated.stiffness, stated.exponent, dissipation)


def _check_bar(name: str, bars: Mapping[str, int], radius: Mapping[str, float], place: str) -> None:
    check_known(name, bars, "the name is no bar", "names of bars", place)
    if not radius[name] > 0:
        problem = "the bar has no radius, so that its distance to others is not known"
        hint = "give it a radius [m]"
        raise InvalidValueError(problem, where=place, given=name, allowed="bars with a radius", hint=hint)
