"""The fastest of our functions against the fastest other way, at each structure and quantity."""

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from harness.ensemble import MANY
from harness.session import Row
from harness.tables import number


@dataclass(frozen=True)
class Comparison:
    """The fastest of ours and the fastest of the others."""

    own: Row
    peer: Row

    @property
    def ratio(self) -> float:
        """Time of the other way over ours."""
        return (self.peer.ns or 0.0) / (self.own.ns or 1.0)


def compare_rows(rows: Sequence[Row]) -> list[Comparison]:
    """Return a comparison for each structure and quantity that both sides were timed at.

    One state a call is compared with one state a call: batches count for many states alone. Our expression
    compiled by CasADi is no other way.
    """
    found = []
    timed = [row for row in rows if row.ns and "our expression" not in row.name]
    for structure, quantity in dict.fromkeys((row.structure, row.quantity) for row in timed):
        chosen = [row for row in timed if (row.structure, row.quantity) == (structure, quantity)]
        own = [row for row in chosen if row.side == "ours" and (MANY in structure or "batch" not in row.name)]
        peers = [row for row in chosen if row.side != "ours"]
        if own and peers:
            found.append(Comparison(min(own, key=_time), min(peers, key=_time)))
    return found


def describe_finding(rows: Sequence[Row]) -> str:
    """Return in how many comparisons ours is the fastest, and how many times at the median."""
    ratios = [item.ratio for item in compare_rows(rows)]
    if not ratios:
        timed = sum(row.ns is not None for row in rows)
        return f"{timed:,} functions timed, 0 comparisons with other ways"
    wins = sum(ratio > 1.0 for ratio in ratios)
    middle = f"{_factor(statistics.median(ratios))} times as fast at the median"
    return (
        f"Fastest of all ways in {wins} of {len(ratios)} comparisons: {middle} "
        f"({_factor(min(ratios))} to {_factor(max(ratios))} times)"
    )


def describe_rows(rows: Sequence[Row]) -> str:
    """Return how much was measured, as sentences."""
    structures = {row.structure for row in rows}
    quantities = {row.quantity for row in rows}
    timed = [row for row in rows if row.ns is not None]
    own = sum(row.side == "ours" for row in timed)
    return (
        f"{len(timed):,} timings, {own:,} of generated functions and {len(timed) - own:,} of other ways: "
        f"{len(quantities)} quantities, {len(structures)} structures. Every result is compared with ours "
        "before it is timed; times are medians of processor time on one core."
    )


def comparison_cells(rows: Sequence[Row]) -> list[list[str]]:
    """Return heading and rows: the fastest of both sides, and their ratio."""
    heading = ["structure", "members", "quantity", "fastest of ours", "ours [ns a member]"]
    heading += ["fastest other way", "its time [ns a member]", "its time over ours"]
    return [
        heading,
        *(
            [
                item.own.structure,
                f"{item.own.members:,}",
                item.own.quantity,
                item.own.name,
                number(item.own.ns_member),
                item.peer.name,
                number(item.peer.ns_member),
                _factor(item.ratio),
            ]
            for item in compare_rows(rows)
        ),
    ]


def _time(row: Row) -> float:
    return row.ns or 0.0


def _factor(value: float) -> str:
    if value < 0.95:
        return f"{value:.2g}"
    return f"{value:.1f}" if value < 9.95 else f"{value:,.0f}"
