"""The cases that deserve a look: failures and extreme results, with commands that run each alone."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.sweep.statuses import GOOD
from tensegrity_codegen.sweep.summary.chosen import ChosenResult
from tensegrity_codegen.sweep.summary.results import NOT_RUN, SweepResults

__all__ = ["WorstCase", "build_commands", "find_worst_cases"]

MOST_OF_A_KIND = 3
VERBS = {"simulate": "simulate", "equilibrium": "equilibrium", "linearize": "linearize"}


@dataclass(frozen=True)
class WorstCase:
    """A case: number, why it is listed, status, message, values of the keys, commands that run it alone."""

    case: int
    reason: str
    status: str
    message: str
    keys: dict[str, float]
    commands: tuple[str, ...]


def find_worst_cases(
    results: SweepResults, chosen: Sequence[ChosenResult], most: int = MOST_OF_A_KIND
) -> tuple[WorstCase, ...]:
    """Return the first cases of each bad status, and those with the largest and least value of each result.

    A case is listed once, with all its reasons.
    """
    reasons: dict[int, list[str]] = {}
    for place, word in enumerate(results.words):
        if word in GOOD or word == NOT_RUN:
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
    return tuple(_describe(results, case, "; ".join(texts)) for case, texts in reasons.items())


def _describe(results: SweepResults, case: int, reason: str) -> WorstCase:
    return WorstCase(
        case,
        reason,
        results.words[int(results.status[case])],
        results.message(case),
        dict(zip(results.keys, results.key_values[case].tolist(), strict=True)),
        build_commands(results, case),
    )


def build_commands(results: SweepResults, case: int) -> tuple[str, ...]:
    """Return the commands that write the scene of a case and run it alone."""
    file = f"case{case}.toml"
    program = "tensegrity-codegen"
    write = shlex.join([program, "sweep", "case", str(results.path), str(case), "--out", file])
    verb = VERBS.get(results.operation)
    if verb is None:
        return (write,)
    words = [program, verb, file]
    for name, value in results.options.items():
        option = "--" + name.replace("_", "-")
        if value is True:
            words.append(option)
        elif value not in (None, False, "", (), []):
            words += [option, f"{value:.17g}" if isinstance(value, float) else str(value)]
    return (write, shlex.join(words))
