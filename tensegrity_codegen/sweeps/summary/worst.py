"""The cases that deserve a look: failures and extreme results, with commands that run each alone."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.sweeps.statuses import GOOD
from tensegrity_codegen.sweeps.summary.chosen import ChosenResult
from tensegrity_codegen.sweeps.summary.results import NOT_RUN, SweepResults

__all__ = ["WorstCase", "build_commands", "find_worst_cases"]

MOST_OF_A_KIND = 3
# Options of an operation that its verb has too.
VERBS = {
    "simulate": ("t_end", "samples", "method", "step", "rtol", "atol", "max_steps", "control"),
    "equilibrium": ("tolerance", "method"),
    "linearize": ("settle",),
}
PROGRAM, INPUT = "tensegrity-codegen", "input."


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
    write = [PROGRAM, "sweep", "case", str(results.path), str(case), "--out", file]
    keys = {
        key: repr(value) for key, value in zip(results.keys, results.key_values[case].tolist(), strict=True)
    }
    inputs = {key: text for key, text in keys.items() if key.startswith(INPUT)}
    words = [PROGRAM, results.operation, file, *_list_options(results)]
    if results.operation in VERBS:
        for key, text in inputs.items():
            words += ["--input", f"{key.removeprefix(INPUT)}={text}"]
    else:  # no verb: a sweep of one case
        words = [PROGRAM, "sweep", file, "--do", results.operation]
        for key, text in (inputs or dict(list(keys.items())[:1])).items():
            words += ["--over", f"{key}={text}"]
        for text in results.keep:
            words += ["--keep", text]
        words += ["--out", f"case{case}.zarr"]
    return (shlex.join(write), shlex.join(words))


def _list_options(results: SweepResults) -> list[str]:
    """Return the options of the operation as words of its verb."""
    options = dict(results.options) | {"settle": results.options.get("about") == "equilibrium"}
    words = []
    for name in VERBS.get(results.operation, ()):
        value, option = options.get(name), "--" + name.replace("_", "-")
        if value is True:
            words.append(option)
        elif value not in (None, False, ""):
            words += [option, repr(value) if isinstance(value, float) else str(value)]
    return words
