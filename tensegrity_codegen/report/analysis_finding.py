"""What an analysis found, in one sentence of numbers: the headline of its page."""

import math

from tensegrity_codegen.report.number_text import format_short
from tensegrity_codegen.runtime.analysis.analysis import Analysis

NO_STIFFNESS = 1e-9  # of the largest force density: less is rounding


def describe_analysis_finding(found: Analysis) -> str:
    """Return whether the structure is stable and by what, mechanisms, lowest frequency, exceeded limits."""
    if found.status == "infeasible":
        return _describe_proof(found)
    if found.status == "undecided":
        return (
            "Undecided: within rounding neither a prestress with every cable in tension is found nor a proof "
            f"that there is none ({_count(found.n_selfstress, 'self-stress', 'es')}, rank "
            f"{found.rank.rank} of {found.rank.largest_rank})"
        )
    parts = [_describe_unstable(found) if found.status == "unstable" else _describe_stable(found)]
    parts += [describe_modes(found)] if found.modes is not None and len(found.modes.frequency) else []
    parts += found.members.describe()
    return "; ".join(parts)


def describe_modes(found: Analysis) -> str:
    """Return the lowest natural frequency, or the number of unstable modes with the fastest growth."""
    assert found.modes is not None
    growing = int((found.modes.growth_rate > 0.0).sum())
    if growing:
        rate = format_short(float(found.modes.growth_rate.max()))
        modes = _count(growing, "unstable mode", "s")
        return f"{modes} at the present tensions, the fastest grows by {rate} 1/s"
    frequency = found.modes.frequency[found.modes.frequency > 0.0]
    without = int((found.modes.frequency == 0.0).sum())
    more = f", {_count(without, 'mode', 's')} without stiffness" if without else ""
    if not len(frequency):
        return f"no natural frequency{more}"
    return f"lowest natural frequency {format_short(float(frequency.min()))} Hz{more}"


def _describe_stable(found: Analysis) -> str:
    """Return what keeps the shape: self-stress or loads, and mechanisms that they stiffen."""
    count = found.n_mechanisms
    stiffened = f"{_count(count, 'mechanism', 's')}, stiffened by tensions" if count else "no mechanism"
    own, loaded = found.prestress, found.load_prestress
    if not len(own.tension) or math.isinf(own.least_tension):
        return f"Stable without cables that need tension: {stiffened}"
    if own.is_found:
        kinds = _count(found.n_selfstress, "self-stress", "es")
        part = format_short(100 * own.least_tension / own.largest_force)
        return (
            f"Stable: {kinds}, every cable in tension (at least {part} % of the largest force); {stiffened}"
        )
    assert loaded is not None
    least = format_short(loaded.least_tension)
    return f"Stable under its loads: every cable in tension, at least {least} N; {stiffened}"


def _describe_unstable(found: Analysis) -> str:
    """Return which stiffness is missing: that of mechanisms, or that at the present tensions."""
    if not found.stability.is_stable:
        value = found.stability.smallest_eigenvalue
        size = f"a stiffness of {format_short(value)} of the largest force density"
        kind = "no stiffness" if abs(value) < NO_STIFFNESS else size
        return f"Unstable: the tensions found give {_of_mechanisms(found)} {kind}"
    return (
        "Unstable at the present tensions: the smallest eigenvalue of the stiffness is "
        f"{format_short(found.smallest_eigenvalue)} N/m"
    )


def _describe_proof(found: Analysis) -> str:
    assert found.certificate is not None
    count = len(found.certificate.shortening)
    return (
        f"No prestress exists: {_count(count, 'cable', 's')} can only be slack, for a motion shortens "
        f"{'them' if count != 1 else 'it'}, lengthens no cable and changes no bar"
    )


def _of_mechanisms(found: Analysis) -> str:
    count = found.n_mechanisms
    return "the only mechanism" if count == 1 else f"one of {count:,} mechanisms"


def _count(number: int, what: str, plural: str) -> str:
    return f"{number:,} {what}{plural if number != 1 else ''}"
