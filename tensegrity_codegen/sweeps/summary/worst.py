"""The cases that deserve a look: failures and extreme results, with commands that run each alone."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.sweeps.statuses import GOOD, NOT_COMPUTED
from tensegrity_codegen.sweeps.summary.chosen import ChosenResult
from tensegrity_codegen.sweeps.summary.results import SweepResults

MOST_OF_A_KIND = 3


@dataclass(frozen=True)
class WorstCase:
    """A case: number, why it is listed, status, message, values of the keys, commands that run it alone."""

    case: int
    reason: str
    status: str
    message: str
    keys: dict[str, float]
    commands: tuple[str, ...]


BuildCommands = Callable[[SweepResults, int], tuple[str, ...]]


def find_worst_cases(
    results: SweepResults,
    chosen: Sequence[ChosenResult],
    build_commands: BuildCommands,
    most: int = MOST_OF_A_KIND,
) -> tuple[WorstCase, ...]:
    """Return the first cases of each bad status, and those with the largest and least value of each result.

    A case is listed once, with all its reasons; build_commands returns what runs it alone.
    """
    reasons: dict[int, list[str]] = {}
    for place, word in enumerate(results.words):
        if word in GOOD or word == NOT_COMPUTED:
            continue
        for case in np.flatnonzero(results.status == place)[:most].tolist():
            reasons.setdefault(case, []).append(word.replace("_", " "))
    for result in chosen:
        values = result.values
        if not np.isfinite(values).any() or np.nanmax(values) == np.nanmin(values):
            continue
        unit = "" if result.unit in ("", "1") else f" {result.unit}"
        for word, case in (("largest", np.nanargmax(values)), ("least", np.nanargmin(values))):
            reasons.setdefault(int(case), []).append(f"{word} {result.name}: {values[case]:.6g}{unit}")
    return tuple(
        _describe(results, case, "; ".join(texts), build_commands(results, case))
        for case, texts in reasons.items()
    )


def _describe(results: SweepResults, case: int, reason: str, commands: tuple[str, ...]) -> WorstCase:
    return WorstCase(
        case,
        reason,
        results.words[int(results.status[case])],
        results.message(case),
        dict(zip(results.keys, results.key_values[case].tolist(), strict=True)),
        commands,
    )
