"""The source archive of DAQP is the pinned one."""

import hashlib

from tensegrity_codegen.control.embedded.daqp_archive import DAQP_SHA256
from tests.control.embedded.daqp import require_daqp_archive


def test_the_archive_is_the_pinned_one() -> None:
    assert hashlib.sha256(require_daqp_archive()).hexdigest() == DAQP_SHA256
