"""Random scenes and settings: a status never calls good what is not, nothing hangs, nothing crashes."""

from collections import Counter

import pytest
from hypothesis import HealthCheck, given, settings

from tensegrity_codegen.studies.stability.outcome import Limits
from tests.studies.fuzz import Example, examples, run_example

LIMITS = Limits(run=0.1, reference=0.2, peers=False, compiles=False)
GRACE = 60.0  # s; a run looks at the clock every 2 s, and the machine may be busy
SEEN: Counter[str] = Counter()


@pytest.mark.thorough
@settings(max_examples=100, suppress_health_check=[HealthCheck.too_slow])
@given(example=examples())
def test_a_result_called_good_is_within_ten_times_its_tolerance(example: Example) -> None:
    outcome = run_example(example, LIMITS)
    SEEN[outcome.verdict] += 1
    assert outcome.verdict != "wrong", (outcome.error, outcome.message)
    assert outcome.seconds < LIMITS.run + GRACE


def test_the_examples_are_neither_all_tame_nor_all_absurd() -> None:
    if SEEN:  # else another worker of this run has them
        assert SEEN["survived"] > 10
        assert SEEN["stopped"] > 3
