"""Lines that the examples print: a quantity, the name of what it belongs to, a value and its unit."""

from dataclasses import dataclass
from typing import NamedTuple

# Allowed difference over the largest value of the same quantity. Equilibria end at forces of 1e-9 N; motions
# have error control in each program, whose steps need not be the same.
TOLERANCE = {"tension": 1e-8, "position": 1e-8, "energy": 1e-8, "tower": 1e-10}
TOLERANCE_OF_MOTION = 1e-7


class Row(NamedTuple):
    """One line."""

    quantity: str
    name: str
    value: float
    unit: str


@dataclass(frozen=True)
class Comparison:
    """What differs: `problems` is empty where the numbers are the same within the tolerances.

    largest: the largest difference of each quantity over the largest of its values.
    """

    problems: tuple[str, ...]
    largest: dict[str, float]


def parse_rows(text: str) -> tuple[Row, ...]:
    """Return the rows of an output; ValueError where a line is none."""
    rows = []
    for line in text.splitlines():
        words = line.split()
        if len(words) != 4:
            raise ValueError(f"not a quantity, a name, a value and a unit: {line!r}")
        rows.append(Row(words[0], words[1], float(words[2]), words[3]))
    return tuple(rows)


def find_tolerance(quantity: str) -> float:
    """Return the allowed difference of a quantity over the largest of its values."""
    return TOLERANCE.get(quantity.partition("_")[0], TOLERANCE_OF_MOTION)


def compare_rows(found: tuple[Row, ...], expected: tuple[Row, ...]) -> Comparison:
    """Compare what a program printed with the numbers of Python: same lines, same units, same values."""
    labels = [(row.quantity, row.name, row.unit) for row in found]
    wanted = [(row.quantity, row.name, row.unit) for row in expected]
    if labels != wanted:
        missing = sorted(set(wanted) - set(labels))
        more = sorted(set(labels) - set(wanted))
        return Comparison((f"other lines than Python: missing {missing}, additional {more}",), {})
    problems, largest = [], {}
    scale: dict[str, float] = {}
    for row in expected:
        scale[row.quantity] = max(scale.get(row.quantity, 0.0), abs(row.value))
    for row, reference in zip(found, expected, strict=True):
        difference = abs(row.value - reference.value) / (scale[row.quantity] or 1.0)
        largest[row.quantity] = max(largest.get(row.quantity, 0.0), difference)
        if not difference <= find_tolerance(row.quantity):  # also where it is not a number
            text = f"{row.quantity} {row.name}: {row.value:.12g} {row.unit}, Python {reference.value:.12g}"
            problems.append(f"{text}; relative difference {difference:.1e}")
    return Comparison(tuple(problems), largest)
