"""Cases of parametrized tests that only `make test-all` runs, since others run the same lines."""

from typing import Any

import pytest


def thorough(*values: Any) -> list[Any]:
    """Return cases that `make test` leaves out; a case of several parameters is a tuple."""
    cases = [value if isinstance(value, tuple) else (value,) for value in values]
    return [pytest.param(*case, marks=pytest.mark.thorough) for case in cases]
