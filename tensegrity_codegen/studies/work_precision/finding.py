"""The finding of a report: the ratio of times to other programs, computed from its rows."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from tensegrity_codegen.studies.work_precision.measure import EQUATIONS, Row, find_fastest
from tensegrity_codegen.studies.work_precision.scene_report import SceneReport
from tensegrity_codegen.system.summaries import describe_count

WANTED = 1e-6  # the error of the headline [m], where methods reach it
MOST_SCENES = 2  # that a headline names one by one


@dataclass(frozen=True)
class Comparison:
    """The fastest of our rows and of the peers' with an error of at most `wanted` [m], None without one.

    alike: the fastest of ours with the equations of the peer.
    """

    scene: str
    wanted: float
    own: Row | None
    peer: Row | None
    t_end: float
    has_peers: bool
    alike: Row | None

    @property
    def ratio(self) -> float | None:
        """Time of the peer over ours, at equal equations where there is such a row; None without rows."""
        return self._ratio(self.alike or self.own)

    @property
    def other_ratio(self) -> float | None:
        """Time of the peer over that of the fastest of ours, None where its equations are the same."""
        return None if self.own is self.alike else self._ratio(self.own)

    def _ratio(self, own: Row | None) -> float | None:
        return None if own is None or self.peer is None else self.peer.seconds / own.seconds


def compare_scene(report: SceneReport, wanted: float = WANTED) -> Comparison:
    """Return the comparison at the error next to `wanted` [m] that both reach, or else our methods alone."""
    found = report.recommendations
    near = sorted(found, key=lambda error: abs(math.log(error / wanted)))
    reached = [error for error in near if found[error] is not None]
    shared = [error for error in reached if find_fastest(report.rows, error, "peer") is not None]
    error = next(iter((*shared, *reached)), max(found))
    peer = find_fastest(report.rows, error, "peer")
    return Comparison(
        report.problem.structure.name,
        error,
        found[error],
        peer,
        report.problem.t_end,
        any(row.group == "peer" for row in report.rows),
        peer and find_fastest(report.rows, error, "own", peer.replaces_bars),
    )


def describe_finding(comparisons: Sequence[Comparison]) -> str:
    """Return how much faster or slower than the fastest other program, scene by scene or as a range."""
    if len(comparisons) == 1:
        return _describe(comparisons[0])
    ratios = [item.ratio for item in comparisons if item.ratio is not None]
    if len(ratios) < len(comparisons) or (len(ratios) <= MOST_SCENES and not _is_alike(comparisons)):
        shown = [f"{item.scene}: {_describe(item)}" for item in comparisons[:MOST_SCENES]]
        left = len(comparisons) - len(shown)
        return "; ".join([*shown, *([f"and {left} more scenes"] if left > 0 else [])])
    if len(ratios) <= MOST_SCENES:
        word = "faster" if ratios[0] >= 1.0 else "slower"
        factors = [
            f"{_factor(max(r, 1.0 / r))} ({item.scene})" for r, item in zip(ratios, comparisons, strict=True)
        ]
        at = _error(comparisons[0].wanted)
        peers = dict.fromkeys(item.peer.contender for item in comparisons if item.peer is not None)
        text = f"{' and '.join(factors)} times {word} than the fastest other program"
        return f"{text}, {' and '.join(peers)}, at an error of {at}{_at_equal(comparisons)}"
    faster = [ratio for ratio in ratios if ratio >= 1.0]
    slower = [1.0 / ratio for ratio in ratios if ratio < 1.0]
    errors = sorted({item.wanted for item in comparisons})
    text = "; ".join(
        f"{_range(values)} times {word} in {len(values)} of {len(ratios)} scenes"
        for word, values in (("faster", faster), ("slower", slower))
        if values
    )
    at = _error(errors[0]) if len(errors) == 1 else f"{_error(errors[0])} to {_error(errors[-1])}"
    programs = sorted({item.peer.program for item in comparisons if item.peer is not None})
    return (
        f"{text}: the fastest of our methods against the fastest other program ({', '.join(programs)}) at an "
        f"error of {at}{_at_equal(comparisons)}"
    )


def describe_rows(reports: Sequence[SceneReport]) -> str:
    """Return how much was measured, as a sentence."""
    rows = [row for report in reports for row in report.rows]
    own = {row.contender for row in rows if row.group == "own"}
    peers = {row.program for row in rows if row.group == "peer"}
    failed = sum(not row.is_good for row in rows)
    others = f" and {describe_count(len(peers), 'other program')}" if peers else ", and no other program"
    return (
        f"{describe_count(len(rows), 'run')} of {describe_count(len(own), 'method')} of ours{others}, on "
        f"{describe_count(len(reports), 'scene')}; {failed:,} did not reach the end."
    )


def _describe(item: Comparison) -> str:
    error = _error(item.wanted)
    if item.own is None:
        return f"no method reaches an error of {error}"
    ratio = item.ratio
    if ratio is None:
        own = f"{item.own.method} ({item.own.formulation}) reaches an error of {error} in "
        own += f"{1e3 * item.own.seconds / item.t_end:.2g} ms a simulated second"
        return f"{own}, no other program reaches it" if item.has_peers else own
    peer = item.peer.contender if item.peer is not None else ""
    text = f"{_times(ratio)} than the fastest other program, {peer}, at an error of {error}"
    if item.other_ratio is None:
        return text
    own = f"with {EQUATIONS[item.own.replaces_bars]} ({item.own.formulation})"
    if item.alike is None:
        return f"{text}, ours {own}"
    return f"{text}{_at_equal([item])}; {_times(item.other_ratio)} {own}"


def _times(ratio: float) -> str:
    return f"{_factor(max(ratio, 1.0 / ratio))} times {'faster' if ratio >= 1.0 else 'slower'}"


def _at_equal(comparisons: Sequence[Comparison]) -> str:
    """Return that equations are equal, where ours would be faster by others."""
    return " and equal equations" if any(item.other_ratio and item.alike for item in comparisons) else ""


def _is_alike(comparisons: Sequence[Comparison]) -> bool:
    """Return whether all are at the same error, and all faster or all slower."""
    sides = {(item.wanted, item.ratio is not None and item.ratio >= 1.0) for item in comparisons}
    return len(sides) == 1


def _error(value: float) -> str:
    """Return an error [m] in short: 1e-6 m."""
    mantissa, _, exponent = f"{value:.0e}".partition("e")
    return f"{mantissa}e{int(exponent)} m"


def _range(values: Sequence[float]) -> str:
    low, high = _factor(min(values)), _factor(max(values))
    return low if low == high else f"{low} to {high}"


def _factor(value: float) -> str:
    """Return a factor in two digits, whole from 10 on."""
    return f"{value:.1f}" if value < 9.95 else f"{value:,.0f}"
