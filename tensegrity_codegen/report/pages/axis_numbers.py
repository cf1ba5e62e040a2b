"""Numbers along the axes of diagrams: few, in short, powers of ten with raised exponents."""

import math
import re
from typing import TYPE_CHECKING

from tensegrity_codegen.report.number_text import format_number, raise_digits
from tensegrity_codegen.report.pictures.palette import MUTED

if TYPE_CHECKING:
    from matplotlib.axis import Axis
    from matplotlib.ticker import Formatter


MOST_LINEAR = 0.9  # decades of a logarithmic axis up to which equal steps are numbered
MOST_PARTS = 2.5  # decades up to which 2 and 5 are numbered too
POWER = re.compile(r"e([+-]?\d+)")  # of ten, in the text of matplotlib


def number_axis(axis: "Axis", limits: tuple[float, float], is_log: bool) -> None:
    """Choose ticks and their texts for an axis whose values lie within limits."""
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

    steps = MaxNLocator(nbins=7, steps=[1, 2, 2.5, 5, 10], min_n_ticks=3)
    if not is_log:
        axis.set_major_locator(steps)
        axis.set_major_formatter(_build_formatter())
        axis.get_offset_text().set(fontsize=8.5, color=MUTED)
        return
    low, high = sorted(limits)
    decades = math.log10(high / low) if low > 0.0 else math.inf
    if decades <= MOST_LINEAR:
        axis.set_major_locator(steps)
    elif decades <= MOST_PARTS:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(format_tick))
    axis.set_minor_formatter(NullFormatter())


def format_tick(value: float, _: object = None) -> str:
    """Return a power of ten as 10⁻³, any other tick of a logarithmic axis in short."""
    exponent = round(math.log10(value)) if value > 0 else 0
    if value > 0 and math.isclose(value, 10.0**exponent, rel_tol=1e-9):
        return f"10{raise_digits(exponent)}"
    return format_number(value, "g")


def _build_formatter() -> "Formatter":
    """Return the texts of equal steps: a common power of ten stands at the end of the axis as × 10⁻⁶."""
    from matplotlib.ticker import ScalarFormatter

    class RaisedPower(ScalarFormatter):
        def get_offset(self) -> str:
            text = str(super().get_offset())
            found = POWER.search(text.replace("\N{MINUS SIGN}", "-"))
            return f"× 10{raise_digits(int(found[1]))}" if found else text

    formatter = RaisedPower(useOffset=False)
    formatter.set_powerlimits((-4, 5))
    return formatter
