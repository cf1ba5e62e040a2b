"""Pairs of bars that a scene watches for contact."""

from collections.abc import Collection, Mapping

from tensegrity_codegen.scene.names import check_known, key_path
from tensegrity_codegen.scene.schema.part_schema import Interference
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
            raise InvalidValueError(
                "these bars share a node, so that they always touch",
                where=place,
                given=list(names),
                allowed="two bars that share no node",
                hint="take the pair out of the list",
            )
        pair = bars[first], bars[second]
        if frozenset(pair) in found:
            raise DuplicateNameError(
                "the pair of bars is listed twice", where=place, given=list(names), allowed="each pair once"
            )
        found[frozenset(pair)] = pair
    return tuple(found.values())


def _check_bar(name: str, bars: Mapping[str, int], radius: Mapping[str, float], place: str) -> None:
    check_known(name, bars, "the name is no bar", "names of bars", place)
    if not radius[name] > 0:
        raise InvalidValueError(
            "the bar has no radius, so that its distance to others is not known",
            where=place,
            given=name,
            allowed="bars with a radius",
            hint="give it a radius [m]",
        )
