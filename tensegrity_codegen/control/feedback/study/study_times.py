"""Times of a study: sample, motion, simulated time, gusts; checked before work begins."""

from collections.abc import Sequence

from tensegrity_codegen.control.feedback.loop.disturbances import Gust
from tensegrity_codegen.control.feedback.study.stated_errors import RandomGust
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.system.checks import check_positive
from tensegrity_codegen.system.errors import InvalidValueError

HELD = 2.0  # [s], of an equilibrium
LONGER = 3.0  # simulated time over that of the motion
CONSTANTS = 3.0  # time constants of the slowest error, from the end of the motion until errors are compared
MOST_LONGER = 10.0  # times the usual simulated time, for slow errors
WINDOW = 6.0  # simulated time over that at whose end errors are compared
ROUNDING = 1e-9  # of a sample


def check_times(
    sample: float | None = None,
    *,
    duration: float | None = None,
    t_end: float | None = None,
    last: float | None = None,
) -> None:
    """Raise InvalidValueError for a time that is no finite number > 0, or for times that do not fit.

    duration: of the motion. None: not known yet, or chosen by default.
    """
    for name, value in (("sample", sample), ("duration", duration), ("t_end", t_end), ("last", last)):
        if value is not None:
            check_positive(value, name, "[s]")
    if sample is None:
        return
    if duration is not None and not _is_least(duration, sample):
        raise InvalidValueError(
            "the sample time does not fit the motion",
            where="sample",
            given=f"{sample:g} s, motion of {duration:g} s",
            allowed=f"at most {duration:g} s",
        )
    if t_end is not None:
        read_times(sample, t_end, t_end, last)


def find_default_times(motion: Motion, *time_constants: float) -> tuple[float, float]:
    """Return the simulated time by default, and that from which errors are compared [s].

    Three times the motion, or once where it is at rest; up to ten times that where errors with these time
    constants [s], in which they fall to 1/e, would else be compared before they have fallen to 5 %.
    """
    usual = (LONGER if motion.velocity.any() else 1.0) * motion.duration
    needed = [find_needed_time(motion, constant) for constant in time_constants]
    end = max([usual, *(time for time in needed if time <= MOST_LONGER * usual)])
    return end, end * (1.0 - 1.0 / WINDOW)


def find_needed_time(motion: Motion, time_constant: float) -> float:
    """Return the simulated time in which an error has fallen to 5 % when errors are compared [s]."""
    moving = motion.duration if motion.velocity.any() else 0.0
    return (moving + CONSTANTS * time_constant) / (1.0 - 1.0 / WINDOW)


def read_times(sample: float, default: float, t_end: float | None, last: float | None) -> tuple[float, float]:
    """Return the simulated time, and that before its end in which errors are compared [s].

    default: simulated time where none is given. Raises InvalidValueError as check_times.
    """
    check_times(t_end=t_end, last=last)
    end = default if t_end is None else t_end
    if not _is_least(end, sample):
        raise InvalidValueError(
            "the simulated time is shorter than a sample",
            where="sample" if t_end is None else "t_end",
            given=f"{end:g} s",
            allowed=f"at least one `sample` ({sample:g} s)",
        )
    if last is None:
        _check_window(sample, end, t_end)
        return float(end), float(end / WINDOW)
    if last > end or not _is_least(last, sample):
        allowed = f"from a sample of {sample:g} s to the simulated time of {end:g} s"
        raise InvalidValueError("out of range", where="last", given=last, allowed=allowed)
    return float(end), float(last)


def _check_window(sample: float, end: float, t_end: float | None) -> None:
    """Raise InvalidValueError where the part at whose end errors are compared is shorter than a sample."""
    if _is_least(end / WINDOW, sample):
        return
    raise InvalidValueError(
        "errors are compared in the last sixth of the simulated time, which is shorter than a sample",
        where="sample" if t_end is None else "t_end",
        given=f"{sample if t_end is None else end:g} s",
        allowed=f"at most {end / WINDOW:g} s" if t_end is None else f"at least {WINDOW * sample:g} s",
        hint=f"or give `last`, at least {sample:g} s",
    )


def check_gust_times(gusts: Sequence[Gust | RandomGust], end: float) -> None:
    """Raise InvalidValueError for a gust that begins at the end of the simulated time or after it."""
    for item in gusts:
        if not item.start < end:
            raise InvalidValueError(
                "the gust begins after the simulated time",
                where="gust.start",
                given=item.start,
                allowed=f"a number >= 0 and < {end:g} [s]",
                hint="an earlier start, or a larger `t_end`",
            )


def _is_least(value: float, sample: float) -> bool:
    """Return whether a time is at least a sample, but for rounding."""
    return value >= sample * (1.0 - ROUNDING)
