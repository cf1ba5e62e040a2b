"""How many cases a test has: those that only `make test-all` runs, and how many examples are drawn."""

import os
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

EXPLORES = os.environ.get("HYPOTHESIS_PROFILE") == "explore"


def thorough(*values: Any) -> list[Any]:
    """Return cases that `make test` leaves out; a case of several parameters is a tuple."""
    cases = [value if isinstance(value, tuple) else (value,) for value in values]
    return [pytest.param(*case, marks=pytest.mark.thorough) for case in cases]


def draws(examples: int) -> settings:
    """Return settings of a test that draws so many examples, and ten times as many if it is to explore."""
    count = 10 * examples if EXPLORES else examples
    return settings(max_examples=count, deadline=None, suppress_health_check=list(HealthCheck))
