"""The comparison of stiff bars: like with like, and no search for an error that a program cannot reach."""

from collections.abc import Callable

import numpy as np
import pytest
import stiff_bars
from stiff_bars import BODIES, CVODE, DOOR, ELASTIC, PAIRS, RIGID, Found, compare, find_setting

from tensegrity_codegen.studies.work_precision.measure import Contender, Reference, Run

NAMES = ("node_position, rk853", "rigid_bar, corrected, rk853", "CVODE (C; Adams, fixed point)", DOOR)


def make_contender(name: str, floor: float, tried: list[float]) -> Contender:
    """Return one whose error is its step, but at least the floor."""

    def run(setting: float) -> Callable[[], Run]:
        tried.append(setting)
        return lambda: Run(np.full((1, 1, 3), max(setting, floor)), "ok", "", 1, 1)

    return Contender(name, "own", "", "", "step", (), run)


def test_pairs_compare_equal_equations() -> None:
    assert all("rigid" in name for name in RIGID)
    assert not [name for name in ELASTIC if "rigid" in name]
    for pair in PAIRS:
        kinds = {"rigid" in name for name in (*pair.ours, *pair.others)}
        expected = {"rigid bars": {True}, "elastic bars": {False}}.get(pair.words, {True, False})
        assert kinds == expected, pair.words


def test_a_row_states_both_sides_and_the_ratio() -> None:
    times = dict(zip(NAMES, (0.4e-3, 0.1e-3, 2e-3, 8e-3), strict=True))
    found = {n: Found(make_contender(n, 0.0, []), 1e-3, 1e-6, seconds) for n, seconds in times.items()}
    rows = [row for pair in PAIRS if pair.others != BODIES for row in compare("case", pair, found)]
    peer = f"{NAMES[2]} | 2.000"
    assert f"| case | elastic bars | {NAMES[0]} | 0.400 | {peer} | 5.0 |" in rows
    assert f"| case | any | {NAMES[1]} | 0.100 | {peer} | 20.0 |" in rows
    assert f"| case | any, ours called from Python | {DOOR} | 8.000 | {peer} | 0.25 |" in rows
    (bodies,) = compare("case", PAIRS[0], found)
    assert bodies == "| case | rigid bars | none of MuJoCo (rigid bars) ... reaches the error |  |  |  |  |"
    assert CVODE[0] in NAMES[2]


@pytest.mark.parametrize(("floor", "reaches"), [(0.0, True), (0.01, False)])
def test_shorter_steps_that_change_nothing_are_not_tried(floor: float, reaches: bool) -> None:
    tried: list[float] = []
    reference = Reference(np.zeros((1, 1, 3)), "", "", 0.0)
    found = find_setting(make_contender("x", floor, tried), reference, 1e-3, 9.0)
    assert (found is not None) == reaches
    assert min(tried) >= (1e-4 if reaches else 10 ** (-3 - 1 / stiff_bars.A_DECADE))
