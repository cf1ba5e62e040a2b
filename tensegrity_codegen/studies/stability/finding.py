"""What a run of all cases found, in one line and one paragraph of numbers."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from tensegrity_codegen.studies.stability.outcome import NOT_RUN, Outcome

Outcomes = Mapping[str, Sequence[Outcome]]

# Verdict -> how a page writes it.
WORDS = {
    "survived": "right",
    "stopped": "stopped",
    "over time": "over the time limit",
    "unchecked": "no reference",
    "wrong": "wrong",
    "not able": "not possible",
    "not run": "not run",
}
CHECKED = ("survived", "wrong")


def describe_finding(outcomes: Outcomes) -> str:
    """Return how many checked results of our methods are wrong, of which methods, and what was not run."""
    own = [row for rows in outcomes.values() for row in rows if row.is_own]
    checked = sum(row.verdict in CHECKED for row in own)
    wrong = Counter(row.contender for row in own if row.verdict == "wrong")
    if not checked:
        return f"0 results of {count_cases(outcomes):,} cases could be checked"
    text = f"{wrong.total():,} of {checked:,} checked results wrong"
    if wrong:
        text += ": " + ", ".join(f"{name} {count:,}" for name, count in wrong.most_common())
    missing = sum(row.verdict == NOT_RUN for row in own)
    return f"{text}; {missing:,} of {len(own):,} runs not made" if missing else text


def describe_counts(outcomes: Outcomes) -> str:
    """Return cases, methods, and every other verdict on our methods, as sentences."""
    own = [row for rows in outcomes.values() for row in rows if row.is_own]
    counts = Counter(row.verdict for row in own)
    methods = len({row.contender for row in own})
    cases = count_cases(outcomes)
    plural = "" if cases == 1 else "s"
    first = f"{cases:,} case{plural} of {', '.join(outcomes)}, run with {methods} methods: {len(own):,} runs."
    parts = [f"{counts['survived']:,} results are right"]
    texts = {
        "wrong": "{} wrong",
        "stopped": "{} runs stopped with a status",
        "over time": "{} took longer than the time limit",
        "unchecked": "{} have no certified reference",
        NOT_RUN: "{} were not run",
    }
    parts += [text.format(f"{counts[key]:,}") for key, text in texts.items() if counts[key]]
    return f"{first} {', '.join(parts)}."


def count_cases(outcomes: Outcomes) -> int:
    """Return the number of cases of all scenes."""
    return len({(scene, row.group, row.case) for scene, rows in outcomes.items() for row in rows})


def sort_worst(rows: Iterable[Outcome]) -> list[Outcome]:
    """Return checked outcomes, wrong ones first, then by error, the largest first."""
    checked = [row for row in rows if row.error is not None or row.verdict == "wrong"]
    return sorted(checked, key=lambda row: (row.verdict != "wrong", -(row.error or 0.0)))
