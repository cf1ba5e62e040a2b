"""The source of DAQP for tests: from the cache, else through pip from the index that it is configured for."""

import functools

import pytest

from tensegrity_codegen.control.embedded.daqp_source import find_daqp_archive
from tensegrity_codegen.system.errors import MissingSourceError


@functools.cache
def _find() -> bytes | str:
    try:
        return find_daqp_archive()
    except MissingSourceError as error:
        return f"{error.problem} ({error.given})"


def require_daqp_archive() -> bytes:
    """Return the archive, or skip the test where pip cannot download it."""
    found = _find()
    if isinstance(found, str):
        pytest.skip(found)
    return found
