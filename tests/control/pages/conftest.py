"""Pictures need the extra `plot`."""

import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("PIL")
